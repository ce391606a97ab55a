"""What figures show, computed apart from drawing."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from dldsim.report import (
    angle_figures,
    calibration_figures,
    style,
    surrogate_figures,
    trajectory_figures,
)
from dldsim.report.sections.benchmark import of_all_rows
from dldsim.vocabulary import SETTLED
from tests.report.made_runs import SETS, make_outcome, make_run


def test_critical_size_ratio():
    assert angle_figures.critical_size_ratio(0.1) == pytest.approx(1.4 * 0.1**0.48)
    assert angle_figures.critical_size_ratio([0.05, 0.2]) == pytest.approx([0.3324, 0.6466], 1e-3)


def test_volume_equivalent_diameter():
    volume = np.pi / 6 * angle_figures.volume_equivalent_diameter("biconcave", 3.91, 1.0) ** 3
    assert volume == pytest.approx(94.1, abs=0.1)  # µm³, Evans & Fung 1972
    assert angle_figures.volume_equivalent_diameter("sphere", 7.5, 0.3) == pytest.approx(15)
    assert angle_figures.volume_equivalent_diameter("ellipsoid", 4.0, 0.125) == pytest.approx(4)


def test_cumulated_row_shifts_of_a_full_bump_count_rows():
    run = {"pitch_um": 36.0, "row_shift_fraction": 0.125, "lateral_steps_um": [4.5] * 6}
    total = trajectory_figures.cumulated_row_shifts(run)
    assert total.tolist() == pytest.approx([0, 1, 2, 3, 4, 5, 6])


def test_row_map_of_a_bump_is_a_point_and_of_a_straight_path_a_line():
    run = {
        "pitch_um": 36.0,
        "row_shift_fraction": 0.125,
        "pillar_radius_um": 9.0,
        "gap_um": 18.0,
        "release_gap_fraction": 0.5,
        "probe_offsets": [],
        "probe_steps": [],
    }
    height, steps = trajectory_figures.row_map({**run, "lateral_steps_um": [4.5] * 6})
    assert height.tolist() == pytest.approx([0.5] * 6) and steps.tolist() == pytest.approx([1] * 6)
    # Straight on, the pillars climb by a quarter of the gap per row.
    height, steps = trajectory_figures.row_map({**run, "lateral_steps_um": [0.0] * 9})
    expected = [0.5, 0.25, 0.0, -0.25, -0.5, -0.75, -1.0, 0.75, 0.5]
    assert (height - expected) % 2 == pytest.approx(0, abs=1e-9)
    assert ((-1 <= height) & (height <= 1)).all() and not steps.any()
    # A row shift, a quarter of the gap, nearer to the pillar than where it bumps.
    probes = {"lateral_steps_um": [4.5] * 2, "probe_offsets": [1.0], "probe_steps": [1.2]}
    height, steps = trajectory_figures.row_map(run | probes)
    assert height.tolist() == pytest.approx([0.5, 0.5, 0.25])
    assert steps.tolist() == pytest.approx([1, 1, 1.2])


def test_row_maps_show_every_row_of_every_run():
    row = {
        "pitch_um": 36.0,
        "row_shift_fraction": 0.125,
        "pillar_radius_um": 9.0,
        "gap_um": 18.0,
        "periodicity": 8,
        "stiffness_set": "1",
        "release_gap_fraction": 0.5,
        "probe_offsets": [],
        "probe_steps": [],
    }
    steps = [1.0, 2.0, 4.5]
    probes = {"probe_offsets": [0.2, 0.1], "probe_steps": [1.2, 1.1]}
    runs = [
        {**row, "run_id": "a", "lateral_steps_um": steps, **probes},
        {**row, "run_id": "b", "lateral_steps_um": steps[:2]},
        {**row, "run_id": "c", "gap_um": 20.0, "lateral_steps_um": steps},
    ]
    figure = trajectory_figures.draw_row_maps(pd.DataFrame(runs))
    points = [[len(line.get_xdata()) for line in axes.lines[1:]] for axes in figure.axes]
    assert points == [[3, 2, 2, 0], [3, 0]]


def test_gap_height_is_constant_when_the_cell_follows_the_rows():
    run = {"pitch_um": 36.0, "row_shift_fraction": 0.125, "pillar_radius_um": 9.0, "gap_um": 18.0}
    x = np.linspace(12.0, 300.0, 500)
    track = pd.DataFrame({"x_um": x, "y_um": 9.0 + 4.5 + 4.5 * x / 36.0})
    rows, heights = trajectory_figures.gap_heights(track, run)
    assert rows.tolist() == list(range(1, 9))
    assert heights == pytest.approx(np.full(8, 0.25))


def test_pillars_stand_on_the_shifted_lattice():
    run = {"pitch_um": 30.0, "row_shift_fraction": 0.2, "pillar_radius_um": 5.0}
    centres = trajectory_figures.pillars_in(run, (-1.0, 61.0), (0.0, 40.0))
    rows = np.round(centres[:, 0] / 30.0)
    lanes = (centres[:, 1] - 6.0 * rows) / 30.0
    assert centres[:, 0] == pytest.approx(30.0 * rows) and lanes == pytest.approx(np.round(lanes))
    assert sorted(set(rows)) == [0, 1, 2]
    assert [0.0, 0.0] in centres.tolist() and [30.0, 36.0] in centres.tolist()


@pytest.mark.parametrize("status", ["converged", "undecided"])
def test_sets_are_shown_to_part_only_if_settled_from_every_place(status):
    runs = pd.DataFrame(
        [
            {
                "run_id": f"s{name}_y{place}",
                "outcome_id": f"s{name}",
                "stiffness_set": name,
                "pillar_radius_um": 5.0,
                "gap_um": 16.0,
                "periodicity": 10,
                "mode": mode,
                "migration_angle_deg": angle,
                "bump_angle_deg": 5.71,
                "status": status if (name, place) == ("5", 0.2) else "periodic",
            }
            for name, mode, angle in (("1", "bump", 5.71), ("5", "mixed", 1.0))
            for place in (0.5, 0.2)
        ]
    )
    picked = trajectory_figures.pick_trajectories(runs)
    pairs = [ids for heading, ids in picked if "apart" in heading]
    assert pairs == ([["s1_y0.5", "s5_y0.5"]] if status == "converged" else [])


def test_pooled_scores():
    predictions = pd.DataFrame(
        {
            "model": ["A"] * 4 + ["B"] * 2,
            "split": "geometry",
            "repeat": 0,
            "observed_deg": [0.0, 2.0, 4.0, 6.0, 1.0, 3.0],
            "predicted_deg": [1.0, 1.0, 5.0, 5.0, 1.5, 3.5],
        }
    )
    scores = surrogate_figures.pooled_scores(predictions).set_index("model")
    assert list(scores.index) == ["B", "A"]  # best by geometry first
    assert scores.loc["A", ["rmse_deg", "mae_deg", "r2"]].tolist() == pytest.approx([1, 1, 0.8])
    assert scores.loc["B", "rmse_deg"] == pytest.approx(0.5)


def test_the_sources_form_is_compared_on_the_same_rows():
    """The second model on Ca has an outcome more, which the one on DI could not see."""
    rows = [("A", "x", 0.1), ("A", "y", 3.0), ("A on DI", "x", 0.4), ("B", "x", 1.0)]
    predictions = pd.DataFrame(rows, columns=["model", "outcome_id", "predicted_deg"]).assign(
        split="geometry", repeat=0, observed_deg=0.0
    )
    [row] = surrogate_figures.on_same_rows(predictions).to_dict("records")
    assert (row["model"], row["n"]) == ("A", 1)
    assert (row["rmse_deg_ca"], row["rmse_deg_index"]) == pytest.approx((0.1, 0.4))


def test_errors_by_shape_and_source():
    predictions = pd.DataFrame(
        {
            "model": "A",
            "split": ["geometry"] * 3 + ["random"],
            "cell_shape": ["sphere", "sphere", "biconcave", "sphere"],
            "source": ["survey", "survey", "campaign", "survey"],
            "observed_deg": 0.0,
            "predicted_deg": [1.0, -1.0, 2.0, 9.0],
        }
    )
    found = surrogate_figures.by_kind(predictions, "A").set_index(["cell_shape", "source"])
    assert found["rmse_deg"].to_dict() == {("biconcave", "campaign"): 2, ("sphere", "survey"): 1}


def test_correlation_matrix_is_symmetric():
    pairs = pd.DataFrame(
        {"variable_a": ["x", "x"], "variable_b": ["y", "z"], "pearson_r": [0.5, None]}
    )
    matrix = calibration_figures.correlation_matrix(pairs)
    assert matrix.loc["y", "x"] == matrix.loc["x", "y"] == 0.5
    assert matrix.loc["z", "z"] == 1 and np.isnan(matrix.loc["y", "z"])


def test_angles_of_an_aliased_sweep_are_drawn_against_periodicity():
    rng = np.random.default_rng(0)
    rows = [make_run(r, r + 10, n, s, rng)[0] for r in (4.0, 8.0) for n in (4, 8) for s in SETS]
    figure = angle_figures.draw_angles(pd.DataFrame([make_outcome([row]) for row in rows]))
    assert [axes.get_xlabel() for axes in figure.axes] == ["periodicity $N_p$"] * 2


def test_conditions_that_the_source_does_not_vary_are_drawn(tables):
    predictions = tables["predictions"]
    predictions = predictions.assign(
        cell_shape=np.where(predictions.index % 2, "sphere", "biconcave")
    )
    figure = surrogate_figures.draw_conditions(predictions, "XGBoost")
    left, right = figure.axes
    assert (left.get_xscale(), right.get_xscale()) == ("log", "linear")
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["biconcave", "sphere"]


def test_picked_trajectories_show_each_mode_and_prefer_settled_runs(tables):
    runs = tables["runs"]
    picked = dict(trajectory_figures.pick_trajectories(runs))
    for mode in ("bump", "zigzag"):
        [run_id] = picked[f"{mode} mode"]
        run = runs.set_index("run_id").loc[run_id]
        assert run["mode"] == mode and run["status"] in SETTLED


def test_trajectory_panel_shows_a_period_in_true_proportion(tables):
    runs, tracks = tables["runs"], tables["trajectory"]
    run = runs[runs["mode"] == "bump"].iloc[0]
    panel = trajectory_figures.trajectory_panel("bump", [run["run_id"]], runs, tracks)
    assert np.ptp(panel.paths[0]["x"]) >= run["periodicity"] * run["pitch_um"]
    axes = trajectory_figures.draw_trajectories([panel]).axes[0]
    box = axes.get_window_extent()
    scale = box.width / np.ptp(panel.xlim) / (box.height / np.ptp(panel.ylim))
    assert scale == pytest.approx(1, rel=1e-3)


def test_mode_points_place_outcomes_against_the_critical_diameter(tables):
    points = angle_figures.mode_points(tables["outcomes"], 1.0)
    assert len(points) == len(style.measured(tables["outcomes"]))
    run = points.iloc[0]
    law = 1.4 * run["gap_um"] * run["periodicity"] ** -0.48
    assert run["size_over_critical"] == pytest.approx(run["size_um"] / law)


def test_equal_figures_give_equal_files(tables):
    scores = surrogate_figures.pooled_scores(tables["predictions"])
    first, second = (
        style.render(surrogate_figures.draw_benchmark(scores, tables["benchmark"]), "svg")
        for _ in range(2)
    )
    assert first == second


def test_both_files_of_a_figure_are_laid_out_alike(tables):
    scores = surrogate_figures.pooled_scores(tables["predictions"])
    figure = surrogate_figures.draw_benchmark(scores, tables["benchmark"])
    places = []
    for kind in ("svg", "png"):
        style.render(figure, kind)
        places.append([axes.get_position().bounds for axes in figure.axes])
    assert places[0] == places[1]


def test_a_short_run_beside_a_long_one_is_seen_whole_in_the_window(tables):
    runs, trajectories = tables["runs"], tables["trajectory"]
    measured = runs[runs["migration_angle_deg"].notna()]
    array = next(
        a for _, a in measured.groupby(["pillar_radius_um", "gap_um", "periodicity"]) if len(a) > 1
    )
    long, short = array["run_id"].iloc[:2]
    whole = trajectories[trajectories["run_id"] == short]
    cut = whole["x_um"].min() + 0.2 * np.ptp(whole["x_um"])
    kept = (trajectories["run_id"] != short) | (trajectories["x_um"] <= cut)
    panel = trajectory_figures.trajectory_panel("two", [long, short], runs, trajectories[kept])
    assert all(len(path["x"]) > 1 for path in panel.paths)
    assert all(path["x"].max() <= cut for path in panel.paths)
    # Of the long one what it settled into, which is its last rows.
    own = trajectories[trajectories["run_id"] == long]
    seen = np.ptp(panel.paths[0]["x"]) + array["pitch_um"].iloc[0]
    last = own[own["x_um"] >= own["x_um"].max() - seen]
    assert set(panel.paths[0]["deformation_index"]) <= set(last["deformation_index"])


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (0.0056, 0.0164, {"0.0075", "0.01", "0.0125", "0.015"}),
        (0.016, 0.16, {"0.02", "0.05", "0.1"}),
        (0.016, 0.8, {"0.03", "0.1", "0.3"}),
        (0.9, 9000, {"1", "10", "100", "1000"}),
    ],
)
def test_a_logarithmic_axis_has_few_plain_labels(low, high, labels):
    """By itself a short axis labels what lies between as well, one over another."""

    @style.styled
    def draw():
        figure = Figure()
        panel = figure.subplots()
        panel.plot([low, high], [1, 2])
        panel.set(xscale="log", xlim=(low, high))
        return figure

    axis = draw().axes[0].xaxis
    shown = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=True)
    assert {label.get_text() for place, label in shown if low <= place <= high} == labels
    assert not any(label.get_text() for label in axis.get_minorticklabels())


def test_the_best_regressor_is_of_those_that_learn_from_all_outcomes():
    assert of_all_rows(["XGBoost on DI", "curve", "XGBoost"]) == ["curve", "XGBoost"]
    assert of_all_rows(["XGBoost on DI"]) == ["XGBoost on DI"]
