"""Commands answer in JSON with the tables' column names, and refuse bad input with exit code 2."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from dldsim import PHYSICS_VERSION
from dldsim.analysis.uncertainty import SIGMA
from dldsim.app import cli
from dldsim.app.commands import output
from dldsim.experiments.vtk import read_vtkhdf
from dldsim.tables.parquet import describe, read_rows, read_table, write_table
from dldsim.tables.registry import COLUMNS
from dldsim.tables.user_table import read_user_table

ROOT = Path(__file__).parents[2]
[COMMANDS] = [
    action.choices for action in cli.make_parser()._actions if action.dest == "==SUPPRESS=="
]
ARRAY = ["--pillar-radius-um", "5", "--gap-um", "20", "--periodicity", "4"]
OUTCOMES = ROOT / "dldsim" / "data" / "campaign" / "outcomes.parquet"
COARSE = ["--spacing-um", "2.5", "--config", str(ROOT / "config.yaml")]


def call(capsys, *argv):
    """Exit code, parsed JSON (None if there is none), and messages."""
    try:
        code = cli.main([*map(str, argv), "--json"])
    except SystemExit as stop:
        code = stop.code
    out, err = capsys.readouterr()
    return code, json.loads(out) if out else None, err


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command, capsys):
    with pytest.raises(SystemExit) as stop:
        cli.main([command, "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert f"example: python -m dldsim {command}" in text and "--json" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_help_names_kinds_and_choices_in_words(command, capsys):
    with pytest.raises(SystemExit):
        cli.main([command, "--help"])
    text = capsys.readouterr().out
    assert "<class" not in text and "None" not in text


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
@pytest.mark.parametrize("words", [["design", "--help"], ["info", str(OUTCOMES)]])
def test_any_terminal_shows_all_texts(words, encoding):
    done = subprocess.run(
        [sys.executable, "-m", "dldsim", *words],
        cwd=ROOT,
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding},
        check=False,
    )
    text = done.stdout.decode(encoding)
    assert done.returncode == 0, done.stderr
    assert "?" not in text and ("theta" in text or "angle" in text)


def test_every_character_of_the_texts_can_be_spelled(capsys):
    folder = Path(output.__file__).parent
    texts = [path.read_text(encoding="utf-8") for path in folder.glob("*.py")]
    assert len(texts) > 5
    for command in COMMANDS:
        with pytest.raises(SystemExit):
            cli.main([command, "--help"])
        texts.append(capsys.readouterr().out)
    texts += [f"{c.unit} {c.description}" for columns in COLUMNS.values() for c in columns]
    assert {c for c in "".join(texts) if ord(c) > 127} <= set(output.SPELLED)


@pytest.mark.parametrize("module", ["dldsim.app.cli", "argparse"])
def test_interrupted_before_it_begins_there_is_no_traceback(module, tmp_path):
    """Ctrl-C while the program is still being loaded."""
    code = (
        "import builtins, runpy, sys\n"
        "found = builtins.__import__\n"
        "def stop(name, *rest, **more):\n"
        f"    if name == {module!r}: raise KeyboardInterrupt\n"
        "    return found(name, *rest, **more)\n"
        "builtins.__import__ = stop\n"
        "sys.argv = ['dldsim', 'info', 'x']\n"
        "runpy.run_module('dldsim', run_name='__main__')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 130 and done.stderr == "\ndldsim: interrupted.\n"


@pytest.mark.parametrize(
    ("word", "value"), [("False", False), ("no", False), ("true", True), ("YES", True)]
)
def test_options_of_true_and_false(word, value):
    given = cli.make_parser().parse_args(["run", *ARRAY, "--set", "1", "--half-scene", word])
    assert given.half_scene is value


@pytest.mark.parametrize("command", COMMANDS)
def test_examples_parse(command):
    words = COMMANDS[command].epilog.split()[4:]
    assert cli.make_parser().parse_args(words).name == command


def test_the_example_of_an_index_is_answered(capsys):
    assert cli.main(COMMANDS["stiffness"].epilog.split()[4:]) == 0, capsys.readouterr().err


@pytest.mark.parametrize(
    ("argv", "parts"),
    [
        (["run", *ARRAY, "--set", "12"], ["--set 12", "1, 2, 3, 4, 5", "Did you mean"]),
        (["run", *ARRAY, "--set", "1", "--gap-um", "6"], ["gap_um = 6", "P_r + d_safety"]),
        (["run", *ARRAY, "--set", "1", "--height-um", "3"], ["height_um = 3", "squeezed"]),
        (["run", *ARRAY, "--set", "1", "--radius-um", "-1"], ["radius_um", "-1", "number ≥ 0.1"]),
        (["run", *ARRAY, "--set", "1", "--periodicity", "1"], ["periodicity", "1", "≥ 2"]),
        (["run", *ARRAY, "--set", "1", "--periodicity", "4.5"], ["--periodicity", "4.5"]),
        (["run", *ARRAY, "--set", "1", "--drive", "x"], ["--drive", "axial"]),
        (["run", *ARRAY, "--set", "1", "--half-scene", "0"], ["--half-scene", "'0'", "true"]),
        (["run", *ARRAY, "--set", "1", "--half-scene", "maybe"], ["--half-scene", "'maybe'"]),
        (["run", *ARRAY, "--set", "1", "--gap-um", "2_0"], ["--gap-um", "'2_0' is no finite"]),
        (["run", *ARRAY, "--set", "1", "--periodicity", "1_0"], ["--periodicity", "no whole"]),
        (["run", *ARRAY, "--set", "1", "--max-rows", "\N{FULLWIDTH DIGIT SIX}"], ["--max-rows"]),
        (["design", "--set1", "1", "--set2", "5", "--seed", "1_0"], ["--seed", "'1_0'"]),
        (["design", "--set1", "1", "--set2", "5", "--r1", "1_0"], ["--r1", "'1_0'"]),
        (["design", "--set1", "1", "--set2", "5", "--gap-um", "1_0", "20"], ["--gap-um", "'1_0'"]),
        (
            ["run", *ARRAY, "--set", "1", "--min-rows", "10", "--max-rows", "3"],
            ["min_rows, max_rows", "10, 3", "min_rows at most max_rows"],
        ),
        (["run", *ARRAY, "--set", "1", "--config", "no.yaml"], ["Cannot read", "no.yaml"]),
        (["flow", "--gap-um", "20"], ["required", "--pillar-radius-um"]),
        (["constrict", "--group", "G8"], ["--group G8", "G1", "G7"]),
        (["run", *ARRAY, "--set", "1", "--velocity", "0.05"], ["unrecognized", "--velocity"]),
        (["flow", *ARRAY, "--out", "."], ["--out .", "folder"]),
        (["flow", *ARRAY, "--kernel", "linear"], ["unrecognized", "--kernel"]),
        (["run", *ARRAY, "--set", "1", "--aspect-ratio", "0.3"], ["no effect", "no ellipsoid"]),
        (["run", *ARRAY, "--set", "1", "--friction-nN-s-per-m", "5"], ["no effect", "no-slip"]),
        (
            ["design", "--set1", "1", "--set2", "5", "--sampler", "grid", "--trials", "5"],
            ["--trials 5 has no effect on a grid"],
        ),
        (
            ["design", "--set1", "1", "--set2", "5", "--grid-steps", "5"],
            ["--grid-steps 5 has no effect without --sampler grid"],
        ),
        (["transition", "--figure", "build/x.pdf"], ["x.pdf", "PNG"]),
        (["flow", *ARRAY, "--out", ""], ["--out", "empty"]),
        (["constrict", "--set", "1", "--radius-um", "100"], ["approach_length_um", "200 µm"]),
        (
            ["design", "--di1", "0.08", "--di2", "0.09", "--shape1", "ellipsoid"],
            ["ellipsoid", "no assay measures this shape"],
        ),
        (["anova", "no.csv"], ["no.csv", "does not exist"]),
        (["anova", "table.txt"], ["table.txt", "does not exist"]),
        (["info", "no.parquet"], ["no.parquet", "does not exist"]),
        (["design", "--di1", "0.5"], ["--di2"]),
        (["design", "--set1", "1", "--set2", "5", "--seed", "-1"], ["--seed", "'-1'", "from 0"]),
        (["anova", "no.csv", "--seed", str(2**63)], ["--seed", "to 9223372036854775807"]),
        (
            ["design", "--set1", "1", "--set2", "5", "--safety-distance-um", "nan"],
            ["--safety-distance-um", "nan"],
        ),
        (
            ["constrict", "--set", "1", "--release-position-um", "-5"],
            ["release_positions_um", "-5 µm", "allowed 0 to 11"],
        ),
        (
            ["run", *ARRAY, "--set", "1", "--spacing-um", "0.05"],
            ["numerics.spacing_um = 0.05", "GB of memory", "limits.memory_GB"],
        ),
        (["design", "--di1", "1.5", "--di2", "0.5"], ["deformation_index_1", "1.5", "≤ 1"]),
        (["design", "--set1", "1", "--di2", "0.5", "--results", "no"], ["outcomes.parquet"]),
        (["run", *ARRAY, "--set", "1", "--outcome-rows-max", "9"], ["has no effect", "--releases"]),
        (
            ["run", *ARRAY, "--set", "1", "--releases", "--release-gap-fraction", "0.3"],
            ["--release-gap-fraction 0.3 has no effect with --releases"],
        ),
        (["run", *ARRAY, "--set", "1", "--releases", "0.5", "1.5"], ["release_gap_fractions"]),
        (["run", *ARRAY, "--set", "1", "--movie"], ["--movie", "--out DIR"]),
        (["run", *ARRAY, "--set", "1", "--vtk", "--out", "x", "--releases"], ["no --releases"]),
        (["constrict", "--set", "1", "--radius-um", "-1"], ["radius_um", "number ≥ 0.1"]),
        (["run", *ARRAY, "--set", "1", "--releases", "0.5", "nan"], ["--releases", "'nan'"]),
        (["run", *ARRAY, "--set", "1", "--gap-um", "nan"], ["--gap-um", "'nan'", "finite"]),
        (["constrict", "--set", "1", "--release-position-um", "inf"], ["--release-position-um"]),
        (["stiffness", "--di", "nan"], ["--di", "'nan'", "finite"]),
        (["stiffness", "--di", "0.7", "--error", "nan"], ["--error", "'nan'"]),
        (["anova", "table.csv", "--seed", "-1"], ["--seed", "'-1'"]),
    ],
)
def test_bad_input_is_told_without_a_traceback(argv, parts, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    code, summary, message = call(capsys, *argv)
    assert (code, summary) == (2, None)
    assert all(part in message for part in parts), message
    assert "Traceback" not in message


@pytest.mark.parametrize(
    ("argv", "place", "work"),
    [
        (["run", *ARRAY, "--set", "1"], "file", "experiments.array_run.simulate_run"),
        (["flow", *ARRAY], "folder", "solver.flow.solve_empty_array"),
        (["constrict", "--set", "1"], "file/x", "experiments.assays.simulate_passage"),
        (["validate", "duct-poiseuille"], "folder", "evidence.validation.run_case"),
        (["validate", "duct-poiseuille"], "x" * 250, "evidence.validation.run_case"),
    ],
)
def test_a_place_that_cannot_be_written_is_told_before_the_work(
    argv, place, work, capsys, monkeypatch, tmp_path
):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    monkeypatch.setattr(f"dldsim.{work}", None)
    monkeypatch.chdir(ROOT)
    code, summary, message = call(capsys, *argv, "--out", tmp_path / place)
    assert (code, summary) == (2, None)
    assert f"--out {tmp_path / place}" in message and "Nothing was calculated" in message
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


@pytest.mark.slow
def test_one_section_is_enough_for_a_command(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.yaml").write_text("flow: {height_um: 0}\nnumerics: {spacing_um: 4}\n")
    code, summary, message = call(capsys, "flow", *ARRAY, "--drive", "axial")
    assert code == 0 and summary["height_um"] == 0, message
    code, _, message = call(capsys, "run", *ARRAY, "--set", "1")
    assert code == 2 and "the configuration has no stiffness_sets" in message


def test_set_without_configuration(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    code, _, message = call(capsys, "run", *ARRAY, "--set", "1")
    assert code == 2 and "--config FILE" in message


def test_interruption_says_what_was_kept(capsys, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("dldsim.solver.flow.solve_empty_array", interrupt)
    code, summary, message = call(capsys, "flow", *ARRAY)
    assert (code, summary) == (130, None) and "untouched" in message


def test_flow_answers_with_the_columns_of_flows(capsys, tmp_path):
    out = tmp_path / "flow.npz"
    code, summary, _ = call(capsys, "flow", *ARRAY, *COARSE, "--height-um", 0, "--out", out)
    assert code == 0 and out.exists()
    assert set(summary) == {c.name for c in COLUMNS["flows"]} | {"files"}
    assert summary["permeability_over_pitch2"] > 0 and abs(summary["lateral_flux_ratio"]) < 1e-3


@pytest.mark.slow
def test_run_writes_the_tables_of_the_campaign(capsys, tmp_path):
    code, summary, _ = call(
        capsys,
        "run",
        *ARRAY,
        *COARSE,
        "--set",
        1,
        "--max-rows",
        2,
        "--out",
        tmp_path,
        "--movie",
        "--vtk",
    )
    assert code == 0
    row, trajectory, movie, cell, pillars = (Path(name) for name in summary["files"])
    assert read_vtkhdf(cell).departure_um(read_table("trajectory", trajectory)) == 0
    assert pillars.stat().st_size > 500
    with Image.open(movie) as picture:
        assert picture.format == "GIF" and picture.n_frames > 10
    [stored] = read_rows("runs", row)
    assert set(summary) == set(stored) | {"files", *SIGMA}
    assert summary["run_id"] == stored["run_id"] == "r05.0_g20.0_n04_s1_y0.50"
    assert stored["outcome_id"] == "r05.0_g20.0_n04_s1"
    assert describe(trajectory)["kind"] == "trajectory"
    assert "Cell" in describe(row)["provenance"]["settings"]


def test_run_with_releases_writes_an_outcome(capsys, tmp_path):
    code, summary, _ = call(
        capsys,
        "run",
        *ARRAY,
        *COARSE,
        "--set",
        1,
        "--max-rows",
        2,
        "--releases",
        0.5,
        0.4,
        "--out",
        tmp_path,
    )
    assert code == 0
    outcome, runs, _ = (Path(name) for name in summary["files"])
    [stored] = read_rows("outcomes", outcome)
    assert summary["outcome_id"] == stored["outcome_id"] == "r05.0_g20.0_n04_s1"
    assert stored["releases"] == 2 and stored["status"] == "undecided"
    assert [row["release_gap_fraction"] for row in read_rows("runs", runs)] == [0.5, 0.4]


def test_anova_refuses_a_table_of_another_physics_version(capsys, tmp_path, monkeypatch):
    path = tmp_path / "outcomes.parquet"
    write_table("outcomes", [], path, {})
    monkeypatch.setattr("dldsim.tables.user_table.PHYSICS_VERSION", PHYSICS_VERSION + 1)
    code, _, message = call(capsys, "anova", path)
    assert code == 2 and f"made by physics version {PHYSICS_VERSION}" in message


def test_constrict_answers_with_the_columns_of_assay_runs(capsys, tmp_path):
    code, summary, _ = call(
        capsys, "constrict", "--set", 1, "--radius-um", 6, *COARSE, "--out", tmp_path
    )
    assert code == 0
    row, _ = summary.pop("files")
    settings = describe(row)["provenance"]["settings"]
    assert settings["CellShape"]["radius_um"] == 6.0 and settings["Constriction"]["axis"] == "z"
    assert summary == read_rows("assay_runs", row)[0]


def test_stiffness_for_an_index_with_its_interval(capsys, tmp_path):
    from dldsim.analysis.passages import calibrate
    from tests.analysis.test_passages import assay_runs

    path = tmp_path / "calibration.parquet"
    write_table("calibration", calibrate(assay_runs(), "gauge"), path, {})
    code, found, _ = call(capsys, "stiffness", "--di", 0.55, "--error", 0.01, "--calibration", path)
    assert code == 0 and found["ks_uN_per_m"] == pytest.approx(7.5)
    assert found["ks_uN_per_m_low"] < 7 < 8 < found["ks_uN_per_m_high"]
    frame = read_user_table(path).frame
    frame.to_csv(tmp_path / "mine.csv", index=False, sep=";", decimal=",")
    again = call(
        capsys, "stiffness", "--di", 0.55, "--error", 0.01, "--calibration", tmp_path / "mine.csv"
    )
    assert again[:2] == (0, found)
    code, _, message = call(capsys, "stiffness", "--di", 0.9, "--calibration", path)
    assert code == 2 and "0.5 to 0.7" in message


def test_anova_reads_the_csv_of_anybody(capsys, tmp_path):
    rng = np.random.default_rng(1)
    levels = [(r, g, n, d) for r in (5, 8) for g in (14, 20) for n in (4, 8) for d in (0.4, 0.7)]
    frame = pd.DataFrame(
        levels, columns=["pillar_radius_um", "gap_um", "periodicity", "deformation_index"]
    )
    frame["stiffness_set"] = np.where(frame.deformation_index < 0.5, "soft", "stiff")
    frame["migration_angle_deg"] = 3 * frame.pillar_radius_um + rng.normal(size=len(frame))
    frame.to_csv(tmp_path / "table.csv", index=False)
    code, summary, _ = call(capsys, "anova", tmp_path / "table.csv")
    assert code == 0
    assert set(summary["rows"][0]) == {c.name for c in COLUMNS["anova"]}
    assert set(summary["diagnostics"][0]) == {c.name for c in COLUMNS["anova_diagnostics"]}
    assert summary["sobol"] or summary["sobol_refused"]
    assert call(capsys, "anova", tmp_path / "table.csv", "--seed", 2**63 - 1)[0] == 0
    effects = {r["term"]: r["p_value"] for r in summary["rows"] if r["model"] == "main_effects"}
    assert effects["pillar_radius_um"] < 1e-6 < effects["gap_um"]


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("anova_excel_semicolon_decimal_comma.csv", "decimal commas"),
        ("anova_r_factors_dictionary.parquet", "dictionary"),
        ("anova_inf_angle.csv", ""),
        ("anova_missing_stiffness_set_3_rows.csv", ""),
    ],
)
def test_anova_reads_the_tables_of_strangers_and_counts_rows(name, found, capsys):
    path = ROOT / "tests" / "data" / "user_tables" / name
    code, summary, _ = call(capsys, "anova", path)
    assert code == 0 and any(found in note for note in summary["found"]) or not found
    notes = {row["note"] for row in summary["rows"] if row["term"] == "rows"}
    left_out = {
        "anova_inf_angle.csv": {"1 of 12 rows left out: infinite migration_angle_deg"},
        "anova_missing_stiffness_set_3_rows.csv": {"3 of 12 rows left out: no stiffness_set"},
    }
    assert notes == left_out.get(name, set())


def test_indices_fail_alone_and_say_why(capsys, tmp_path):
    table = pd.read_csv(ROOT / "tests" / "data" / "user_tables" / "ANOVA_EXPORT.CSV")
    table.assign(cell_radius_um="7.5 um").to_csv(tmp_path / "table.csv", index=False)
    code, summary, _ = call(capsys, "anova", tmp_path / "table.csv")
    assert code == 0 and summary["rows"] and summary["sobol"] == []
    assert "'7.5 um' is no number" in summary["sobol_refused"]


def test_info_describes_a_table(capsys, tmp_path):
    path = tmp_path / "table.parquet"
    rows = [
        {"assay": "group-velocity", "variable_a": "a", "variable_b": "b", "pearson_r": None, "n": 2}
    ]
    write_table("calibration_correlations", rows, path, {"config_hash": "x", "seed": None})
    code, summary, _ = call(capsys, "info", path)
    assert code == 0 and summary["rows"] == 1 and summary["provenance"]["config_hash"] == "x"
    assert cli.main(["info", str(path)]) == 0
    assert "null: not measured" in capsys.readouterr().out


def test_closed_pipe_is_no_error():
    command = f"{sys.executable} -m dldsim run --help | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and "Traceback" not in done.stderr


def test_transition_answers_and_draws(capsys, tmp_path):
    code, found, _ = call(capsys, "transition", "--figure", tmp_path / "map.png")
    assert code == 0 and Image.open(tmp_path / "map.png").format == "PNG"
    known = [row for row in found["rows"] if row["gap_over_2R"] is not None]
    assert {row["periodicity"] for row in known} >= {6, 8}
    assert all(
        row["gap_over_2R_low"] <= row["gap_over_2R"] <= row["gap_over_2R_high"] for row in known
    )
    (tmp_path / "folder").mkdir()
    code, _, told = call(capsys, "transition", "--figure", tmp_path / "folder")
    assert code == 2 and "--figure" in told


@pytest.mark.parametrize(
    ("words", "cell"),
    [
        ([], ("biconcave", 7.5)),
        (["--radius", 6.7], ("biconcave", 6.7)),
        (["--shape", "sphere"], ("sphere", 7.5)),
        (["--shape", "sphere", "--radius", 7], ("sphere", 7)),
    ],
)
def test_the_cell_of_a_stiffness_is_by_default_the_campaigns(capsys, words, cell):
    code, summary, _ = call(capsys, "stiffness", "--di", 0.08, *words)
    assert code == 0 and (summary["cell_shape"], summary["cell_radius_um"]) == cell


def test_a_radius_of_nothing_is_a_radius(capsys):
    code, _, message = call(capsys, "stiffness", "--di", 0.08, "--radius", 0)
    assert code == 2 and "of radius 6 to 9 µm, not 0 µm" in message


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", b"rank,gap_um\n1,12\n", "no Parquet file. Name the .parquet file"),
        ("a.parquet", b"PAR1 cut off", "truncated"),
        ("folder", None, "is a folder. Name a table in it"),
    ],
)
def test_what_is_no_table_is_said_to_be_what_it_is(capsys, tmp_path, name, content, words):
    path = tmp_path / name
    path.mkdir() if content is None else path.write_bytes(content)
    code, _, message = call(capsys, "info", path)
    assert code == 2 and words in message
    assert ("Delete it" in message) == (words == "truncated")


def test_a_spread_of_an_index_that_is_not_there_is_refused_with_the_reason(capsys):
    cells = ["--set1", "3", "--r1", 4, "--di1-std", 0.01, "--set2", "3", "--r2", 8.8]
    code, _, message = call(capsys, "outcome", *ARRAY, *cells)
    assert code == 2 and "--ks1-cv" in message
    assert "no index that would spread" in message and "of radius 6 to 9 µm, not 4 µm" in message


def test_nothing_said_of_a_cell_type_names_the_columns_that_were_not_used(capsys, tmp_path):
    (tmp_path / "a.csv").write_text("radius_um,DI\n6.4,0.08\n6.6,0.08\n")
    words = ["outcome", *ARRAY, "--set2", "3", "--population1", tmp_path / "a.csv"]
    code, _, message = call(capsys, *words)
    assert code == 2 and "is deformation_index meant by DI?" in message
