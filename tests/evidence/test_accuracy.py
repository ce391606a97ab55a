"""The study of error against run time: runs, errors, figures."""

import math

import numpy as np
import pandas as pd
import pytest

from dldsim.config.presets import read_config
from dldsim.config.study_sections import Accuracy
from dldsim.errors import DldsimError
from dldsim.evidence import accuracy
from dldsim.evidence.accuracy import DEFAULT, LONG, REFERENCE, SETTING, Variant
from dldsim.report import accuracy_figures, style
from dldsim.tables.parquet import write_table
from dldsim.tables.registry import COLUMNS

ONE = "r05.0_g20.0_n04_s1"
BUMP = math.degrees(math.atan(1 / 4))


def study(**changes):
    return Accuracy(
        **{
            "migration_angle": {
                "cases": {"one": ONE},
                "other_starts": [0.4],
                "long_rows": 60,
                "knobs": {"spacing_um": [2.0, 1.25, 0.5], "max_rows": [8, 50], "axis": ["z", "y"]},
                "alternatives": {"cheap": {"spacing_um": 2.0, "velocity_lu": 0.05}},
                "reference": {"spacing_um": 0.5, "rows": 2},
            },
            "deformation_index": {
                "cases": ["G1"],
                "knobs": {"spacing_um": [2.0, 1.0], "release_position_um": [3.0, 0.0]},
                "reference": {"velocity_lu": 0.005, "spacing_um": 0.8},
            },
        }
        | changes
    )


@pytest.fixture(scope="module")
def config():
    return read_config("config.yaml").model_copy(update={"accuracy": study()})


def zigzag(rows, drop=0.0):
    """Lateral steps of a zigzag of period four rows, after a transient of ``drop`` in all."""
    steps = np.tile([5.0, 5.0, 5.0, -15.0], rows // 4 + 1)[:rows]
    return (steps - drop * np.exp(-np.arange(rows) / 2)).tolist()


def interval(angle, half):
    """Ends of a 95 % interval; 0.196° of half width is a standard deviation of 0.1°."""
    ends = (None, None) if angle is None else (angle - half, angle + half)
    return dict(zip(("angle_low_deg", "angle_high_deg"), ends, strict=True))


def row(angle, run=ONE, **changes):
    """A row of `runs` as far as the study reads it."""
    return {
        "run_id": f"{run}--default--0--0",
        "migration_angle_deg": angle,
        "bump_angle_deg": BUMP,
        "mode": "zigzag" if angle is not None else "none",
        "status": "periodic" if angle is not None else "unstable",
        **interval(angle, 0.196),
        "processor_time_s": 6.0,
        "steps": 600,
        "nodes": 3,
        "vertices": 4,
        "spacing_um": 1.25,
        "rows_completed": 60,
        "lateral_steps_um": zigzag(60),
        "pitch_um": 20.0,
        "periodicity": 4,
        "pillar_radius_um": 5.0,
        "gap_um": 20.0,
        "stiffness_set": "1",
        "cell_shape": "biconcave",
        "cell_radius_um": 7.5,
        "height_um": 20.0,
        "mean_velocity_mm_s": 0.5,
    } | changes


def channel(index):
    return {"deformation_index": index, "status": "converged", "processor_time_s": 2.0, "steps": 10}


# -------------------------------------------------------------------------------- which runs


def test_identifiers_are_their_own_inverse(config):
    for variant in accuracy.variants(config):
        assert accuracy.parse_variant(accuracy.variant_id(variant)) == variant


def test_each_run_once_from_each_start(config):
    runs = accuracy.variants(config)
    assert len(set(runs)) == len(runs)
    points = [(v.knob, v.rank) for v in runs if v.run == ONE and v.start == 1]
    assert points == [
        (DEFAULT, 0),
        ("spacing_um", 0),
        ("spacing_um", 2),
        (LONG, 0),
        ("axis", 0),
        (SETTING, 0),
        (REFERENCE, 0),
    ]
    assert {v.start for v in runs if v.run == "G1"} == {0}


def test_a_variant_changes_what_it_names(config):
    def of(*variant):
        return accuracy.settings_for(Variant(*variant), config)

    default = of(ONE, DEFAULT)
    assert of(ONE, "spacing_um", 2)["numerics"] == default["numerics"] | {"spacing_um": 0.5}
    assert of(ONE, "axis", 0)["cell"]["axis"] == "z"
    assert of(ONE, DEFAULT, 0, 1)["cell"]["release_gap_fraction"] == 0.4
    assert of(ONE, LONG)["run_control"]["max_rows"] == 60
    whole = of(ONE, REFERENCE)["numerics"]
    assert (whole["spacing_um"], whole["rows"]) == (0.5, 2)
    channel = of("G1", "release_position_um", 0)
    assert channel["assay"]["channel"]["release_positions_um"] == [3.0]
    assert channel["membrane"]["velocity_mm_s"] == config.constriction_groups["G1"].velocity_mm_s
    fine = of("G1", REFERENCE)
    assert (
        fine["assay"]["channel"]["spacing_um"] == 0.8 and fine["numerics"]["velocity_lu"] == 0.005
    )
    assert fine["numerics"]["spacing_um"] == default["numerics"]["spacing_um"]


@pytest.mark.parametrize(
    ("part", "knobs", "word"),
    [
        ("migration_angle", {"colour": [1, 2]}, "colour"),
        ("migration_angle", {"release_gap_fraction": [0.4, 0.5]}, "other_starts"),
        ("deformation_index", {"rows": [1, 2], "gap_um": [1, 2]}, "gap_um"),
    ],
)
def test_an_impossible_knob_is_named(config, part, knobs, word):
    changed = study(**{part: {"knobs": knobs}})
    with pytest.raises(DldsimError, match=word):
        accuracy.variants(config.model_copy(update={"accuracy": changed}))


@pytest.mark.parametrize(
    ("part", "knobs", "key"),
    [
        ("migration_angle", {"rows": [1, 100]}, "numerics.rows"),
        ("migration_angle", {"spacing_um": [20.0, 1.25]}, "gap_um"),
        ("deformation_index", {"release_position_um": [-3.0, 0.0]}, "release_positions_um.0"),
        (
            "deformation_index",
            {"release_position_um": [20.0, 0.0]},
            "constriction.release_positions_um",
        ),
        ("deformation_index", {"throat_width_um": [50.0, 8.0]}, "constriction.throat_width_um"),
    ],
)
def test_a_value_that_no_run_can_have_is_refused(config, part, knobs, key):
    cases = {"migration_angle": {"one": ONE}, "deformation_index": ["G1"]}[part]
    changed = study(**{part: {"cases": cases, "knobs": knobs}})
    config = config.model_copy(update={"accuracy": changed})
    with pytest.raises(DldsimError) as caught:
        for variant in accuracy.variants(config):
            accuracy.settings_for(variant, config)
    assert caught.value.key == key


# ---------------------------------------------------------------------------------- replaying


def test_a_replay_is_the_run_that_would_have_been():
    """Against the run's own rule of stopping: first orbit after N_p rows, or the last row."""
    long = row(0.0, lateral_steps_um=zigzag(60, drop=3.0))
    strict, loose = (accuracy.replay(long, tolerance, 60) for tolerance in (0.001, 0.3))
    assert {strict["status"], loose["status"]} <= {"converged", "periodic"}
    assert loose["rows_completed"] < strict["rows_completed"] < 60
    assert accuracy.half_width(loose) > accuracy.half_width(strict)
    assert strict["processor_time_s"] == pytest.approx(6.0 * strict["rows_completed"] / 60)
    cut = accuracy.replay(long, 1e-9, 10)
    assert (cut["rows_completed"], cut["status"]) == (10, "undecided")
    total = sum(long["lateral_steps_um"][5:10])
    assert cut["migration_angle_deg"] == pytest.approx(math.degrees(math.atan(total / (5 * 20.0))))


def test_a_broken_run_is_not_replayed():
    assert accuracy.replay(row(None), 0.03, 20)["status"] == "unstable"


# ------------------------------------------------------------------------------------- errors


@pytest.fixture(scope="module")
def runs(config):
    """Angles of the two starts by point, and indices."""
    angles = {
        (DEFAULT, 0): (1.0, 1.2),
        ("spacing_um", 0): (3.0, 3.0),
        ("spacing_um", 2): (0.5, 0.5),
        (LONG, 0): (0.0, 0.0),
        ("axis", 0): (1.1, None),
        (SETTING, 0): (2.0, 2.2),
        (REFERENCE, 0): (0.2, 0.4),
    }
    found = {
        Variant(ONE, *point, start): row(angle)
        for point, pair in angles.items()
        for start, angle in enumerate(pair)
    }
    found |= {
        Variant("G1", DEFAULT): channel(0.70),
        Variant("G1", "spacing_um", 0): channel(0.73),
        Variant("G1", "release_position_um", 0): channel(0.71),
        Variant("G1", REFERENCE): channel(0.75),
    }
    return found


@pytest.fixture(scope="module")
def points(config, runs):
    return accuracy.table(runs.items(), config)


def at(points, knob, rank):
    return next(p for p in points if (p["knob"], p["rank"]) == (knob, rank))


def test_errors_are_of_the_mean_over_the_starts(points):
    angle = [p for p in points if p["quantity"] == "migration_angle"]
    coarse, default, fine = (at(angle, "spacing_um", rank) for rank in range(3))
    assert [p["error"] for p in (coarse, default, fine)] == pytest.approx([2.5, 0.6, 0.0])
    assert default["error_share"] == pytest.approx(0.6 / BUMP)
    assert default["error_to_reference"] == pytest.approx(1.1 - 0.3)
    assert default["is_default"] and fine["is_reference"] and not default["is_reference"]
    assert at(angle, "cheap", 1)["error"] == pytest.approx(2.1 - 0.3)
    assert at(angle, "axis", 0)["value"] is None  # one start gave no angle
    index = [p for p in points if p["quantity"] == "deformation_index"]
    assert at(index, "spacing_um", 0)["error_to_reference_share"] == pytest.approx(0.02 / 0.75)
    assert at(index, "spacing_um", 0)["noise"] is None


def test_noise_is_that_of_a_difference_of_means(points, runs):
    """Pooled variance s² between starts; a mean of two has s²/2, a difference of two means s²."""
    angle = [p for p in points if p["quantity"] == "migration_angle" and len(p["values"]) == 2]
    pooled = np.mean([np.var(p["values"], ddof=1) for p in angle])
    assert angle[0]["noise"] == pytest.approx(math.sqrt(2 * pooled / 2))


def test_rows_are_those_of_the_tables(points, config, runs, tmp_path):
    assert all(set(p) == {c.name for c in COLUMNS["accuracy"]} for p in points)
    write_table("accuracy", points, tmp_path / "a.parquet", {})


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (2.0, "2"),
        (0.075, "0.075"),
        (False, "false"),
        ("compact", "compact"),
        ({}, ""),
        ({"spacing_um": 2.0, "half_scene": True}, "spacing_um = 2, half_scene = true"),
    ],
)
def test_a_setting_in_words(value, text):
    assert accuracy.in_words(value) == text


# -------------------------------------------------------------------------------- figures


def test_front_holds_what_nothing_beats():
    def point(knob, error, time, kind="setting", default=False, case="a"):
        return {
            "quantity": "migration_angle",
            "kind": kind,
            "case": case,
            "knob": knob,
            "rank": 0,
            "setting": "",
            "is_default": default,
            "error_to_reference_share": error,
            "noise_share": 0.01,
            "processor_time_s": time,
            "rows": None,
            "settled": True,
        }

    rows = [
        point("default", 0.04, 2, default=True),
        point("cheap", 0.05, 1),
        point("worse", 0.06, 4),
        point("careful", 0.01, 8),
        point("broken", None, 1),
    ]
    twice = [
        *rows,
        *({**r, "case": "b", "processor_time_s": 3 * r["processor_time_s"]} for r in rows),
    ]
    table = accuracy_figures.overall(pd.DataFrame(twice), "migration_angle").set_index("knob")
    assert table["front"].to_dict() == {
        "cheap": True,
        "default": True,
        "worse": False,
        "careful": True,
    }
    assert table["cost"].to_dict() == pytest.approx(
        {"cheap": 0.5, "default": 1, "worse": 2, "careful": 4}
    )
    slow = [rows[0] | {"rows": 20.0}, rows[1] | {"rows": 40.0}, rows[3] | {"rows": 20.0}]
    per_row = accuracy_figures.overall(pd.DataFrame(slow), "migration_angle").set_index("knob")
    assert per_row["cost"]["cheap"] == pytest.approx(0.25)
    knobs = pd.DataFrame([*rows, point("rows", 0.02, 8, "knob")])
    gain = accuracy_figures.gains(knobs, "migration_angle").iloc[0]
    assert gain["error_change"] == pytest.approx(-0.02) and gain["cost"] == pytest.approx(4)
    assert gain["per_doubling"] == pytest.approx(-0.01)


def test_every_figure_draws(points, config, runs):
    table = pd.DataFrame(points)
    for figure in (
        accuracy_figures.draw_knobs(table, "migration_angle"),
        accuracy_figures.draw_knobs(table, "deformation_index"),
        accuracy_figures.draw_pareto(table),
        accuracy_figures.draw_gains(table),
    ):
        assert style.render(figure, "svg").startswith(b"<?xml")
