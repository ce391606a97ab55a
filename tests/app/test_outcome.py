"""The command `outcome`, outlets in `design`, and what is refused; on a made-up campaign."""

import contextlib
import json
import shutil
import time

import numpy as np
import pytest

from dldsim.app import cli, outcome_answers
from dldsim.app.asked import ask, with_measured
from dldsim.app.design_answers import resolve_by
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.design.finished_campaign import packaged_campaign, read_campaign
from dldsim.design.measured_cells import read_measured
from dldsim.errors import DldsimError
from dldsim.tables.parquet import read_rows
from tests.app.test_cli import call

pytestmark = pytest.mark.usefixtures("nowhere")

ARRAY = ["--pillar-radius-um", 7, "--gap-um", 16, "--periodicity", 6]
CELLS = ["--set1", "1", "--set2", "3", "--r1", 5.5, "--r2", 8, "--r1-cv", 0.05]
FEW = ["--draws", 16, "--cells", 64]


def outcome(capsys, campaign, *words):
    return call(capsys, "outcome", *words, "--results", campaign)


def test_an_array_by_itself(capsys, campaign, tmp_path):
    code, summary, _ = outcome(capsys, campaign, *ARRAY, *CELLS, *FEW, "--output", tmp_path / "o")
    assert code == 0
    assert [row["population"] for row in summary["outcomes"]] == [1, 2]
    assert {row["outlet"] for row in summary["outcomes"]} == {"lower", "upper"}
    for kind in ("device_outcomes", "device_outlets", "device_positions", "device_exits"):
        assert read_rows(kind, tmp_path / "o" / f"{kind}.parquet")
        assert (tmp_path / "o" / f"{kind}.csv").exists()
    assert (tmp_path / "o" / "outcome.html").exists() and (tmp_path / "o" / "outcome.png").exists()
    table = tmp_path / "o.csv"
    again = outcome(capsys, campaign, *ARRAY, *CELLS, *FEW, "--csv", table)[1]
    assert table.read_text().startswith("request,device,stage,population,outlet,purity")
    assert again["outcomes"] == summary["outcomes"]


def test_a_summary_to_be_read(capsys, campaign):
    words = ["outcome", *ARRAY, *CELLS, *FEW, "--results", campaign]
    assert cli.main([*map(str, words)]) == 0
    text = capsys.readouterr().out
    for part in ("purity", "recovery", "nine of ten exceed", "wall at [µm]", "Add --simulate"):
        assert part in text


@pytest.fixture(scope="module")
def designed(campaign, tmp_path_factory):
    """Files of a search for outlets."""
    folder = tmp_path_factory.mktemp("designed")
    words = ["design", *CELLS, *FEW, "--objective", "purity-recovery", "--trials", 25]
    words += ["--startup-trials", 15, "--candidates", 2, "--footprint-max-mm2", 6]
    start = time.process_time()
    with contextlib.chdir(folder):
        assert cli.main([*map(str, words), "--results", str(campaign), "--output", "."]) == 0
    return folder, time.process_time() - start


def test_a_design_by_its_outlets(designed):
    folder, _ = designed
    designs = read_rows("designs", folder / "designs.parquet")
    rows = read_rows("device_outcomes", folder / "device_outcomes.parquet")
    first = [row for row in rows if row["device"] == "request-candidate-1"]
    assert designs[0]["objective"] == "purity-recovery"
    assert designs[0]["value"] == pytest.approx(first[0]["purity_recovery"])
    assert 0 <= designs[0]["value"] <= 1
    assert first[0]["array_length_mm"] <= 3.0  # 6 mm² of an array 2 mm wide
    assert "At the outlets" in (folder / "report.html").read_text(encoding="utf-8")


def test_the_mask_follows_the_outcome(designed):
    folder, _ = designed
    record = json.loads((folder / "files/request-candidate-1.json").read_text(encoding="utf-8"))
    rows = read_rows("device_outcomes", folder / "device_outcomes.parquet")
    device = record["device"]
    assert device["outlet_walls_um"] == pytest.approx([rows[0]["cut_um"]])
    assert device["array_length_um"] / 1e3 == pytest.approx(rows[0]["array_length_mm"])
    assert device["array_width_um"] / 1e3 == pytest.approx(rows[0]["array_width_mm"])
    assert record["outcome"]["populations"][0]["purity"] == rows[0]["purity"]


def test_a_design_and_a_cascade_by_files(capsys, campaign, designed):
    folder, _ = designed
    one, two = (folder / f"files/request-candidate-{k}.json" for k in (1, 2))
    code, summary, _ = outcome(capsys, campaign, "--design", one, *FEW)
    assert code == 0 and summary["request"]["radius_1_um"] == 5.5
    assert summary["designs"][0]["name"] == "request-candidate-1"
    upper = [row for row in summary["outlets"] if row["outlet"] == 2][0]
    fed = upper["cells_1"] + upper["cells_2"] > 0
    code, summary, message = outcome(
        capsys, campaign, "--design", one, *FEW, "--then", two, "--from-outlet", 2
    )
    assert code == 0 or not fed and "no cell leaves" in message
    if code == 0:
        assert [row["stage"] for row in summary["outcomes"]] == [1, 1, 2, 2]


def test_a_design_by_its_file_has_the_device_of_its_mask(capsys, campaign, designed):
    """Array length and wall are those of the mask, and so is what was said to come out of it."""
    folder, _ = designed
    path = folder / "files/request-candidate-1.json"
    mask = json.loads(path.read_text(encoding="utf-8"))["device"]
    rows = read_rows("device_outcomes", folder / "device_outcomes.parquet")
    code, summary, _ = outcome(capsys, campaign, "--design", path, *FEW)
    assert code == 0
    found = summary["outcomes"][0]
    assert found["array_length_mm"] == pytest.approx(mask["array_length_um"] / 1e3)
    assert found["array_length_mm"] < 4  # the setting is 5 mm
    assert [row["low_um"] for row in summary["outlets"]][1:] == mask["outlet_walls_um"]
    for name in ("purity", "recovery", "purity_recovery", "cut_um"):
        assert found[name] == pytest.approx(rows[0][name], abs=1e-12)


def test_the_wall_of_a_mask_stays_where_it_is(capsys, campaign, designed):
    path = designed[0] / "files/request-candidate-1.json"
    words, short = ["--design", path, *FEW], ["--array-length-mm", 1.5]
    walls = [
        outcome(capsys, campaign, *words, *more)[1]["outlets"][1]["low_um"]
        for more in ([], short, [*short, "--outlets", 2])
    ]
    mask = json.loads(path.read_text(encoding="utf-8"))["device"]
    assert walls[:2] == 2 * mask["outlet_walls_um"] and walls[2] != walls[0]
    notes = outcome(capsys, campaign, *words, *short)[1]["notes"]
    assert "--outlets places them anew" in notes[0]
    narrow = ["--array-width-mm", 0.5]
    code, _, message = outcome(capsys, campaign, *words, *narrow)
    assert code == 2 and "--outlets places them anew" in message


def test_settings_that_a_design_was_made_without_are_refused(capsys, campaign, designed, tmp_path):
    """As without a design; what the design was made with may be named, and an option goes over."""
    path, config = designed[0] / "files/request-candidate-1.json", tmp_path / "other.yaml"
    words = ["--design", path, *FEW, "--config", config]
    for text, parts in (
        ("device: {array_width_mm: 1.5}", ["array_width_mm = 1.5", "candidate-1", "with 2.0"]),
        ("device: {outlets: 3}", ["outlets = 3", "made with 2", "--outlets"]),
        ("device: {outlet_walls_um: [900]}", ["outlet_walls_um"]),
        ("flow: {mean_velocity_mm_s: 2}", ["mean_velocity_mm_s = 2", "--velocity"]),
        ("flow: {height_um: 60}", ["height_um = 60", "--height"]),
        ("cell: {shape: sphere}", ["cell.shape = sphere", "--shape1"]),
    ):
        config.write_text(text + "\n", encoding="utf-8")
        code, _, message = outcome(capsys, campaign, *words)
        assert code == 2 and all(part in message for part in parts), message
    config.write_text("device: {array_length_mm: 5, outlets: 2, array_width_mm: 1.9}\n")
    assert outcome(capsys, campaign, *words, "--array-width-mm", 1.8)[0] == 0


def test_a_second_design_that_was_made_for_others_is_told(capsys, campaign, designed, tmp_path):
    one = designed[0] / "files/request-candidate-1.json"
    record = json.loads(one.read_text(encoding="utf-8"))
    record["request"] |= {"radius_2_um": 9.0, "height_um": 60.0}
    two = tmp_path / "two.json"
    two.write_text(json.dumps(record), encoding="utf-8")
    words = ["--design", one, *FEW, "--from-outlet", 2, "--then"]
    code, summary, message = outcome(capsys, campaign, *words, two)
    assert code == 0, message
    [note] = [note for note in summary["notes"] if "was made for" in note]
    assert "radius_2_um = 9.0, height_um = 60.0; here" in note and "radius_2_um = 8.0" in note
    summary = outcome(capsys, campaign, *words, one)[1]
    assert not any("was made for" in note for note in summary["notes"])


def test_both_commands_draw_the_same(capsys, campaign):
    bounds = [w for name, v in zip(ARRAY[::2], ARRAY[1::2], strict=True) for w in (name, v, v)]
    words = [*CELLS, *FEW, "--seed", 3]
    found = [
        call(capsys, "design", *bounds, *words, "--trials", 2, "--results", campaign)[1],
        outcome(capsys, campaign, *ARRAY, *words)[1],
    ]
    one, two = ([{**row, "device": ""} for row in f["outcomes"]] for f in found)
    for row in (*one, *two):
        row.pop("request")
    assert one == two


def test_a_device_that_was_not_learnt_is_warned_of(capsys, campaign):
    words = [*ARRAY, *CELLS, *FEW, "--height", 300]
    code, summary, message = outcome(capsys, campaign, *words)
    assert code == 0, message
    assert [row["extrapolated"] for row in summary["outcomes"]] == [1.0, 1.0]
    assert sum(note.startswith("extrapolated: 100%") for note in summary["notes"]) == 2
    assert "height/R 54.5 of cell type 1 was not learnt" in " ".join(summary["notes"])
    assert all(row["recovery_low"] < 0.2 for row in summary["outcomes"])
    assert cli.main(["outcome", *map(str, words), "--results", str(campaign)]) == 0
    assert "note: extrapolated" in capsys.readouterr().out


def test_options_go_over_the_design(capsys, campaign, designed):
    path = designed[0] / "files/request-candidate-1.json"
    words = ["--design", path, *FEW, "--ks1", 12, "--array-length-mm", 2, "--outlets", 3]
    code, summary, _ = outcome(capsys, campaign, *words)
    assert code == 0
    assert summary["request"]["stiffness_set_1"] is None
    assert summary["request"]["ks_1_uN_per_m"] == 12
    assert len(summary["outlets"]) == 3 and summary["outcomes"][0]["array_length_mm"] <= 2


def test_another_deformability_has_no_spread_of_the_one_before(
    capsys, campaign, designed, tmp_path
):
    record = json.loads((designed[0] / "files/request-candidate-1.json").read_text())
    request = record["request"]
    for i in "12":
        request |= {f"ks_cv_{i}": 0.2}
    path = tmp_path / "spread.json"
    path.write_text(json.dumps(record), encoding="utf-8-sig")
    code, summary, _ = outcome(capsys, campaign, "--design", path, *FEW, "--ks1", 12)
    assert code == 0
    assert (summary["request"]["ks_cv_1"], summary["request"]["ks_cv_2"]) == (None, 0.2)


@pytest.mark.parametrize("content", [b'{"request": null}', b"[]", b"\xff\xfe" + b"\0" * 9000])
def test_what_is_no_design_is_said_in_a_line(capsys, campaign, tmp_path, content):
    path = tmp_path / "x.json"
    path.write_bytes(content)
    code, _, message = outcome(capsys, campaign, "--design", path, *FEW)
    assert code == 2 and "is no file of a design" in message and len(message) < 600


def test_measured_cells(capsys, campaign, tmp_path):
    radii = np.random.default_rng(1).normal(5.5, 0.2, 50)
    (tmp_path / "a.csv").write_text("radius_um\n" + "\n".join(f"{r:.3f}" for r in radii))
    words = [*ARRAY, "--set1", "1", "--set2", "3", "--r2", 8, *FEW]
    code, summary, _ = outcome(capsys, campaign, *words, "--population1", tmp_path / "a.csv")
    assert code == 0
    assert summary["request"]["radius_1_um"] == pytest.approx(radii.mean(), abs=1e-3)
    assert summary["request"]["radius_std_1_um"] == pytest.approx(radii.std(ddof=1), abs=1e-3)
    assert summary["outcomes"][0]["radius_mean_um"] == pytest.approx(radii.mean(), abs=0.02)


def test_measured_indices_give_stiffnesses(capsys, campaign, tmp_path):
    (tmp_path / "a.csv").write_text("radius_um,deformation_index\n7.5,0.55\n7.5,0.6\n7.5,0.65\n")
    words = [*ARRAY, "--set2", "3", "--r2", 5, *FEW, "--population1", tmp_path / "a.csv"]
    code, summary, message = outcome(capsys, campaign, *words)
    assert code == 0, message
    assert summary["request"]["deformation_index_1"] == pytest.approx(0.6)
    far = tmp_path / "b.csv"
    far.write_text("radius_um,deformation_index\n7.5,0.05\n7.5,0.06\n7.5,0.6\n")
    words[-1] = far
    code, _, message = outcome(capsys, campaign, *words)
    assert code == 2 and "deformation_index" in message


def test_measured_indices_are_read_at_every_radius_that_is_calibrated():
    """The packaged campaign calibrates discs of 7.5 µm, its library those of other radii."""
    known = read_campaign(packaged_campaign(), Device(), 1.0)
    table = b"radius_um,deformation_index\n6.9,0.10\n7.1,0.11\n7.3,0.12\n"
    cells = read_measured(table, "a.csv"), None
    request = DesignRequest(name="a", **with_measured({"stiffness_set_2": "3"}, cells))
    asked = ask(request, resolve_by(known, request), known.tables, cells)
    ks = asked.sources[0].measured_ks
    assert ks is not None and list(ks) == sorted(ks, reverse=True)
    assert ks.min() < asked.populations[0].stiffness.ks_uN_per_m < ks.max()


def test_what_was_measured_replaces_what_was_said():
    cells = read_measured(b"radius_um,ks_uN_per_m\n6,10\n8,40\n", "a.csv")
    said = {"stiffness_set_1": "3", "deformation_index_std_1": 0.1, "radius_cv_1": 0.2}
    values = with_measured(said | {"radius_2_um": 5.0}, (cells, None))
    assert values["ks_1_uN_per_m"] == pytest.approx(20) and values["radius_1_um"] == 7
    assert not {"stiffness_set_1", "deformation_index_std_1", "radius_cv_1"} & values.keys()
    assert values["radius_2_um"] == 5.0


def test_a_simulated_check(capsys, campaign, tmp_path, monkeypatch):
    """Cells as a simulator would return them: at its outlet those that move as predicted."""

    def simulate(drawn, setting, directory, progress, processes):
        progress("cell 6 of 6")
        angle = {1: 0.0, 2: float(np.degrees(np.arctan(1 / setting.geometry.periodicity)))}
        return [
            {
                "status": "converged",
                "stop_reason": "",
                "mode": "bump",
                "migration_angle_deg": angle[d.population],
                "lateral_steps_um": [0.0] * 6,
                "cell_radius_um": d.cell.radius_um,
                "rows_completed": 6,
            }
            for d in drawn
        ]

    monkeypatch.setattr(outcome_answers, "simulate_cells", simulate)
    words = [*ARRAY, *CELLS, *FEW, "--simulate", 6, "--output", tmp_path / "o"]
    code, summary, message = outcome(capsys, campaign, *words)
    assert code == 0 and "cell 6 of 6" in message
    assert [row["simulated"] for row in summary["checks"]] == [3, 3]
    cells = read_rows("checked_cells", tmp_path / "o" / "checked_cells.parquet")
    assert [cell["population"] for cell in cells] == [1, 1, 1, 2, 2, 2]
    upper = cells[-1]["exit_um"] - cells[-1]["start_um"]
    array = summary["outcomes"][0]["array_length_mm"] * 1e3
    assert upper == pytest.approx((array - 6 * 30) / 6, abs=1)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ([], ["--design FILE", "--pillar-radius-um"]),
        ([*ARRAY, "--design", "x.json"], ["--design FILE"]),
        (["--design", "no.json"], ["no.json", "cannot be read", ".json file of a design"]),
        (["--pillar-radius-um", 7], ["gap_um", "missing"]),
        ([*ARRAY, *CELLS, "--then", "x.json"], ["--from-outlet N go together"]),
        ([*ARRAY, "--set1", "1"], ["cell type 2", "--di2, --set2"]),
        ([*ARRAY, *CELLS, "--r1-cv", "0.6"], ["radius_cv_1", "would be negative", "lognormal"]),
        ([*ARRAY, *CELLS, "--r1-cv", "-0.1"], ["radius_cv_1", "-0.1", "≥ 0"]),
        ([*ARRAY, *CELLS, "--array-length-mm", "0.1"], ["array_length_mm", "one period of 6"]),
        ([*ARRAY, *CELLS, "--draws", "4096", "--cells", "65536"], ["draws times cells at most"]),
        ([*ARRAY, *CELLS, "--cells", "70000"], ["cells", "70000", "≤ 65536"]),
        ([*ARRAY, *CELLS, "--simulate", "1"], ["simulate = 1", "2 to 1000"]),
        ([*ARRAY, *CELLS, "--population2", "no.csv"], ["no.csv", "does not exist"]),
        (
            [*ARRAY, "--set1", "1", "--set2", "1", "--r1", 6, "--r2", 6],
            ["both cell types", "no array separates equals"],
        ),
    ],
)
def test_bad_input_is_refused_with_what_to_do(words, parts, capsys, campaign):
    code, summary, message = outcome(capsys, campaign, *words)
    assert (code, summary) == (2, None)
    assert all(part in message for part in parts), message
    assert "Traceback" not in message


def test_seed_and_default_assay_of_the_configuration_are_honoured(capsys, campaign, tmp_path):
    (tmp_path / "config.yaml").write_text("seed: 7\ndefault_assay: gauge\n", encoding="utf-8")
    code, summary, _ = outcome(capsys, campaign, *ARRAY, *CELLS, *FEW)
    assert code == 0 and summary["seed"] == 7
    by_option = outcome(capsys, campaign, *ARRAY, *CELLS, *FEW, "--seed", 8)[1]
    assert by_option["seed"] == 8 and by_option["outcomes"] != summary["outcomes"]
    by_index = ["--di1", 0.7, "--set2", "3", "--r1", 7.5, "--r2", 8]
    code, _, message = outcome(capsys, campaign, *ARRAY, *by_index, *FEW)
    assert code == 2 and "no assay 'gauge'. Calibrated: group-velocity" in message


@pytest.mark.parametrize("cells", [CELLS, ["--ks1", 10, "--set2", "3", "--r1", 5.5, "--r2", 8]])
def test_an_unknown_assay_is_refused_even_where_nothing_is_read_by_it(capsys, campaign, cells):
    code, _, message = outcome(capsys, campaign, *ARRAY, *cells, *FEW, "--assay", "nonsense")
    assert code == 2 and "no assay 'nonsense'" in message


@pytest.mark.parametrize(
    ("column", "options"),
    [
        ("deformation_index", ["--di1", 0.1]),
        ("deformation_index", ["--set1", "3"]),
        ("deformation_index", ["--ks1", 5]),
        ("deformation_index", ["--di1-std", 0.1]),
        ("deformation_index", ["--ks1-cv", 0.1]),
        ("deformation_index", ["--rigid1", "--shape1", "sphere"]),
        ("ks_uN_per_m", ["--set1", "3"]),
        ("ks_uN_per_m", ["--ks1-cv", 0.1]),
        ("", ["--r1", 5]),
        ("", ["--r1-std", 1]),
        ("", ["--r1-cv", 0.1]),
        ("", ["--radius-distribution", "lognormal"]),
    ],
)
def test_options_that_measured_cells_make_idle_are_refused(capsys, tmp_path, column, options):
    table = tmp_path / "a.csv"
    value = {"deformation_index": ",0.08", "ks_uN_per_m": ",9"}.get(column, "")
    table.write_text(f"radius_um{',' * bool(column)}{column}\n7.4{value}\n7.5{value}\n")
    cells = ["--set2", "3", "--r2", 8, *([] if column else ["--set1", "3"])]
    words = ["outcome", *ARRAY, *cells, *FEW, "--population1", table]
    code, _, message = call(capsys, *words, *options)
    assert code == 2 and f"{options[0]} would change nothing" in message and "a.csv" in message


def test_options_over_a_design_may_be_measured_cells(capsys, campaign, designed, tmp_path):
    """What the file of a design says of its cells is not said beside them."""
    (tmp_path / "a.csv").write_text("radius_um\n5.4\n5.6\n")
    words = ["--design", designed[0] / "files/request-candidate-1.json", *FEW]
    words += ["--population1", tmp_path / "a.csv", "--r2-cv", 0.05]
    words += ["--radius-distribution", "lognormal"]  # of type 2
    code, summary, _ = outcome(capsys, campaign, *words)
    assert code == 0 and summary["request"]["radius_1_um"] == pytest.approx(5.5)


def by_index(table: str, shape: str = "biconcave"):
    known = read_campaign(packaged_campaign(), Device(), 1.0)
    cells = read_measured(table.encode(), "a.csv"), None
    said = {"stiffness_set_2": "3", "shape_1": shape}
    request = DesignRequest(name="a", **with_measured(said, cells))
    return ask(request, resolve_by(known, request), known.tables, cells)


def test_some_measured_cells_may_be_beyond_the_calibrated_radii():
    """The library of the packaged campaign reaches from 6 to 9 µm."""
    rows = ["6.0,0.08", "6.2,0.08", "6.4,0.08", "6.6,0.08", "6.8,0.08"]
    head = "radius_um,deformation_index\n"
    asked = by_index(head + "\n".join([*rows, "5.7,0.08"]))
    ks = asked.sources[0].measured_ks
    assert ks is not None and ks[0] == ks[1] < ks[2]  # as the smallest that is calibrated
    assert any("16.7% of the radii are beyond" in note for note in asked.notes)
    assert asked.sources[0].measured.radius_um[0] == 5.7
    with pytest.raises(DldsimError) as caught:
        by_index(head + "\n".join([*rows, "5.7,0.08", "5.66,0.08"]))
    told = "29% of the measured cells are outside the calibration, radii of 6 to 9 µm"
    assert told in str(caught.value) and "…" not in str(caught.value)
    command = "dldsim calibrate --assay gauge --shape biconcave --radius 5.66 5.7"
    assert command in str(caught.value)


def test_a_cell_that_is_not_calibrated_has_a_command_that_measures_it():
    with pytest.raises(DldsimError, match=r"--assay gauge --shape sphere --radius 5\.5$"):
        by_index("radius_um,deformation_index\n5.4,0.08\n5.6,0.08\n", "sphere")


def test_measured_cells_need_no_distribution(capsys, campaign, tmp_path):
    """Of a normal distribution of their spread a part would be negative."""
    radii = [2.0] * 30 + [25.0]
    (tmp_path / "a.csv").write_text("radius_um\n" + "\n".join(map(str, radii)))
    words = [*ARRAY, "--set1", "1", "--set2", "3", "--r2", 8, *FEW]
    code, summary, message = outcome(capsys, campaign, *words, "--population1", tmp_path / "a.csv")
    assert code == 0, message
    assert summary["request"]["radius_std_1_um"] > 2


def names_in(folder):
    return sorted(path.name for path in (folder / "files").iterdir())


def test_files_of_another_request_of_this_name_go(capsys, campaign, tmp_path):
    """Three candidates, then one of other cells: the others' masks would look like its own."""
    few = [*FEW, "--trials", 20, "--startup-trials", 15, "--results", campaign]
    out = tmp_path / "used"
    words = ["design", *CELLS, *few, "--output", out, "--candidates"]
    assert call(capsys, *words, 3)[0] == 0
    first = names_in(out)
    (out / "files" / "request-notes.txt").write_text("mine")
    shutil.copy(out / "files" / "request-candidate-3.gds", out / "files" / "other-candidate-3.gds")
    shutil.copy(out / "files" / "request-candidate-3.json", out / "files" / "request-1.json")
    code, summary, _ = call(capsys, *words, 3)  # the same once more: nothing is of another
    assert (code, summary["removed"]) == (0, [])
    assert set(first) | {"request-1.json"} < set(names_in(out))
    # as if it were of a simulated check
    shutil.copy(out / "device_outlets.parquet", out / "verified_designs.parquet")
    assert cli.main([*map(str, [*words, 1, "--r2", 8.5])]) == 0
    left = names_in(out)
    assert [n for n in left if n.startswith("request-candidate-")] == [
        n for n in first if n.startswith("request-candidate-1.")
    ]
    assert {"request-notes.txt", "other-candidate-3.gds"} < set(left)
    assert "request-1.json" not in left and not (out / "verified_designs.parquet").exists()
    assert capsys.readouterr().out.count("removed, of an earlier request: ") == 4 + 4 + 1 + 1


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ([], "as long as device.array_length_mm, 5 mm, in whole rows"),
        (
            ["--objective", "purity-recovery", "--footprint-max-mm2", 3],
            "as long as footprint_max_mm2 and device.array_length_mm, 5 mm, allow",
        ),
    ],
)
def test_how_long_the_array_of_a_mask_is(words, part, capsys, campaign, tmp_path):
    few = [*FEW, "--trials", 15, "--startup-trials", 15, "--candidates", 1, "--results", campaign]
    asked = ["design", *CELLS, *few, *words, "--output", tmp_path / "a"]
    assert cli.main([*map(str, asked)]) == 0
    assert part in capsys.readouterr().out
    record = json.loads((tmp_path / "a/files/request-candidate-1.json").read_text("utf-8"))
    length = f"whole rows that fit into {'1.5' if words else '5'} mm"
    assert any(length in note for note in record["device"]["notes"])
