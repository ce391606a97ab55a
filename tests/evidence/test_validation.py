"""The validation cases: registry, rows, marks, failures, reference files, command."""

import importlib
import inspect
import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from dldsim.app import cli, evidence_jobs
from dldsim.config.campaign import closing_sentence, count_crashes
from dldsim.errors import DldsimError
from dldsim.evidence import reference, validation, validation_fluid, validation_membrane
from dldsim.evidence.validation import BROKEN, CASES, Comparison, check_cases, run_case
from dldsim.report import validation_figures
from dldsim.tables.parquet import read_rows, read_table, write_csv, write_table
from dldsim.tables.registry import COLUMNS

ROOT = Path(__file__).parents[2]
CHEAP = ("membrane-forces", "plane-poiseuille")
ABOUT = {"config_hash": "x", "seed": None}


@pytest.fixture
def stand_in(monkeypatch):
    """Replace the case taylor-green by one that yields comparisons and raises exceptions."""

    def replace(*items):
        def case():
            for item in items:
                if isinstance(item, Exception):
                    raise item
                yield item

        monkeypatch.setattr(validation_fluid, "taylor_green", case)
        return "taylor-green"

    return replace


@pytest.fixture
def references(monkeypatch, tmp_path):
    """A copy of the reference files that may be damaged."""
    folder = tmp_path / "reference"
    shutil.copytree(reference.FOLDER, folder)
    monkeypatch.setattr(reference, "FOLDER", folder)
    return folder


@pytest.mark.parametrize("name", CASES)
def test_every_case_has_a_function_that_argues_its_mark(name):
    case = CASES[name]
    assert re.fullmatch(r"[a-z-]+", name)
    assert (
        case.title
        and case.source
        and case.group in ("fluid", "membrane", "cell", "assays", "scenes")
    )
    module, function = case.function.split(".")
    assert module.startswith("validation_") and function.replace("_", "-") == name
    made = getattr(importlib.import_module(f"dldsim.evidence.{module}"), function)
    assert inspect.isgeneratorfunction(made) and re.search(r"\b[Mm]arks?\b", made.__doc__)


@pytest.mark.parametrize("name", CHEAP)
def test_cheap_cases_keep_to_their_marks_and_make_a_table(name, tmp_path):
    rows = run_case(name)
    assert validation.failures(rows) == [] and any(row["passed"] for row in rows)
    path = tmp_path / "validation.parquet"
    write_table("validation", rows, path, ABOUT)
    assert read_rows("validation", path) == [
        {c.name: row[c.name] for c in COLUMNS["validation"]} for row in rows
    ]
    [verdict] = validation.verdicts(rows)
    assert verdict["case"] == name and verdict["failed"] == 0 < verdict["error_over_mark"] < 1


def test_order_is_that_of_the_same_quantity_at_the_next_coarser_resolution(stand_in):
    errors = {
        "half-way": (0.4, 0.2, 0.1),
        "interpolated": (0.16, 0.04, 0.01),
        "crossing": (0.1, -0.1, 0.1),
        "exact": (1e-9, 1e-10, 0.0),
    }
    name = stand_in(
        *(
            Comparison(
                "k",
                2 * (1 + error),
                2.0,
                0.05,
                variant=variant,
                resolution=8 * 2**i,
                resolution_of="nodes",
            )
            for variant, of_variant in errors.items()
            for i, error in enumerate(of_variant)
        )
    )
    rows = run_case(name)
    orders = {v: [r["observed_order"] for r in rows if r["variant"] == v] for v in errors}
    assert orders["half-way"] == [None, pytest.approx(1), pytest.approx(1)]
    assert orders["interpolated"] == [None, pytest.approx(2), pytest.approx(2)]
    assert orders["crossing"] == orders["exact"] == [None] * 3
    assert [r["passed"] for r in rows if r["variant"] == "interpolated"] == [False, True, True]
    assert all(math.isclose(r["relative_error"], r["value"] / r["reference"] - 1) for r in rows)


def test_what_is_only_shown_neither_passes_nor_fails(stand_in):
    rows = run_case(stand_in(Comparison("k", 3.0, 2.0)))
    assert rows[0]["passed"] is None and validation.failures(rows) == []


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_value_that_is_not_finite_fails(stand_in, value, tmp_path):
    rows = run_case(stand_in(Comparison("k", value, 2.0, 0.1), Comparison("k", 2.0, 2.0, 0.1)))
    assert [row["passed"] for row in rows] == [False, True]
    assert rows[0]["value"] is None and "not finite" in validation.failures(rows)[0]
    write_table("validation", rows, tmp_path / "table.parquet", ABOUT)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (DldsimError("Too few nodes."), "Too few nodes."),
        (MemoryError("no room"), "MemoryError: no room"),
    ],
)
def test_a_case_that_raises_fails_with_the_reason_and_keeps_its_rows(
    stand_in, error, reason, tmp_path
):
    name = stand_in(Comparison("k", 2.0, 2.0, 0.1), error)
    rows = run_case(name)
    assert [row["passed"] for row in rows] == [True, False]
    assert rows[1]["quantity"] == BROKEN and rows[1]["note"] == reason
    table = tmp_path / "case.parquet"
    evidence_jobs.validation_job(name, {}, table=table, crashes=tmp_path, progress=print)
    assert len(read_rows("validation", table)) == 2 and count_crashes(tmp_path, name) == 1


def test_unknown_case_is_refused_with_the_nearest_name():
    with pytest.raises(DldsimError, match="'taylor-gren' is unknown. Did you mean taylor-green?"):
        check_cases(["taylor-gren"])
    assert check_cases([]) == list(CASES)


# ------------------------------------------------------------------------------- reference files


def test_every_reference_file_is_listed_and_unaltered():
    files = [
        p.relative_to(reference.FOLDER).as_posix()
        for p in reference.FOLDER.rglob("*")
        if p.is_file()
    ]
    files.remove(reference.CHECKSUMS)
    listed = (reference.FOLDER / reference.CHECKSUMS).read_text().splitlines()
    assert sorted(files) == sorted(line.split()[1] for line in listed)
    assert all(reference.reference_path(name).is_file() for name in files)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda path: path.write_text(path.read_text().replace("0.035144", "0.035145")), "altered"),
        (lambda path: path.unlink(), "cannot be read"),
        (lambda path: path.with_name(reference.CHECKSUMS).unlink(), "cannot be read"),
        (lambda path: path.with_name(reference.CHECKSUMS).write_text(""), "not listed"),
    ],
)
def test_damaged_reference_is_refused_and_fails_its_case_alone(references, damage, says):
    damage(references / "duct_poiseuille.csv")
    with pytest.raises(DldsimError, match=says) as refusal:
        reference.read_reference("duct_poiseuille")
    assert "restore" in str(refusal.value)
    [row] = run_case("duct-poiseuille")
    assert row["passed"] is False and says in row["note"]
    assert not validation.failures(run_case("plane-poiseuille"))


# ---------------------------------------------------------------------------- parts of the cases


def test_wall_mark_is_the_change_by_a_displaced_wall():
    radii = np.linspace(0.1, 0.4, 31)
    exact = np.exp(-20 * radii)
    mark = validation_fluid.wall_mark(radii, exact, 0.25, 40, "half-way")
    assert mark == pytest.approx(20 * 0.5 / 40)
    assert validation_fluid.wall_mark(radii, exact, 0.25, 40, "interpolated") < mark / 4


def test_relaxation_that_does_not_come_to_rest_is_an_error(monkeypatch):
    monkeypatch.setattr(validation_membrane, "STEPS_AT_MOST", 3)
    [row] = run_case("static-stretching")
    assert row["passed"] is False and "not at rest after 3 steps" in row["note"]


# -------------------------------------------------------------------------------------- command


def call(capsys, *argv):
    code = cli.main([*map(str, argv)])
    out, err = capsys.readouterr()
    return code, out, err


def test_command_runs_the_other_cases_and_tells_the_failure(stand_in, capsys, tmp_path):
    stand_in(Comparison("k", 2.0, 2.0, 0.1), DldsimError("Too few nodes."))
    out = tmp_path / "table.parquet"
    code, text, _ = call(capsys, "validate", "taylor-green", "membrane-forces", "--out", out)
    assert code == 1
    assert "fails: taylor-green, the case itself: Too few nodes." in text
    assert re.search(r"taylor-green +FAILS +1 of 2", text)
    assert re.search(r"membrane-forces +passes +7 of 7", text)
    rows = read_rows("validation", out)
    assert {row["case"] for row in rows} == {"taylor-green", "membrane-forces"}
    assert out.with_suffix(".csv").exists()


def test_command_answers_in_json_and_with_zero_when_all_is_well(capsys):
    code, text, _ = call(capsys, "validate", "membrane-forces", "--json")
    summary = json.loads(text)
    assert code == 0 and summary["cases"][0]["failed"] == 0
    assert set(summary["rows"][0]) == {c.name for c in COLUMNS["validation"]}


def test_command_lists_cases_and_refuses_unknown_ones(capsys):
    code, text, _ = call(capsys, "validate", "--list")
    assert code == 0 and [line.split()[0] for line in text.splitlines()] == list(CASES)
    code, text, message = call(capsys, "validate", "square-array")
    assert (code, text) == (2, "") and "Did you mean square-arrays?" in message


def test_a_damaged_reference_and_an_unknown_name_leave_the_other_cases_alone(
    references, capsys, tmp_path
):
    table = references / "constriction_diameters.csv"
    table.write_text(table.read_text().replace("32.565", "32.5"))
    misspelt, out = "constriction-shapes", tmp_path / "table.parquet"
    (references / "duct_poiseuille.csv").unlink()
    code, text, _ = call(
        capsys, "validate", misspelt, "duct-poiseuille", "membrane-forces", "--out", out
    )
    assert code == 1
    assert f"{misspelt!r} is unknown. Did you mean constriction-shape?" in text
    assert "duct_poiseuille.csv cannot be read" in text
    assert re.search(r"membrane-forces +passes +7 of 7", text)
    assert len({row["case"] for row in read_rows("validation", out)}) == 3
    with pytest.raises(DldsimError, match="has been altered"):
        reference.read_reference("constriction_diameters")


# ----------------------------------------------------------------------------- figures and rules


def test_convergence_pools_the_series_of_a_level(stand_in, tmp_path):
    name = stand_in(
        *(
            Comparison(
                "k",
                1 + scale / n**2,
                1.0,
                1.0,
                variant="half-way",
                parameter=scale,
                resolution=n + scale,
            )
            for scale in (3.0, 4.0)
            for n in (10, 20)
        ),
        Comparison("k", 9.0, 1.0, resolution=5),
    )
    write_table("validation", run_case(name), tmp_path / "table.parquet", ABOUT)
    table = read_table("validation", tmp_path / "table.parquet")
    pooled = validation_figures.convergence(table)
    rms = np.sqrt(12.5)
    assert pooled["level"].tolist() == [0, 1]
    assert pooled["resolution"].tolist() == [13.5, 23.5]
    assert pooled["error"].tolist() == pytest.approx([rms / 100, rms / 400])
    [order] = validation_figures.observed_orders(table)["order"]
    assert order == pytest.approx(math.log(4) / math.log(23.5 / 13.5))


def test_closing_sentence_names_failing_cases(stand_in, tmp_path):
    rows = run_case("membrane-forces") + run_case(stand_in(Comparison("k", 3.0, 2.0, 0.1)))
    write_table("validation", rows, tmp_path / "validation.parquet", ABOUT)
    write_csv("validation", tmp_path / "validation.parquet")
    sentence = closing_sentence(tmp_path)
    assert "1 of 2 cases pass" in sentence and "taylor-green" in sentence
