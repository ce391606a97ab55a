"""The page of one design request, and what it says of bounds, intervals and scope."""

import pandas as pd
import pytest
from matplotlib.colors import to_hex

from dldsim.config.design_sections import DesignRequest
from dldsim.config.sections import CellShape, Flow
from dldsim.design.export import passage_label
from dldsim.report import design_figures
from dldsim.report.design_page import write_report
from dldsim.report.scope import holds_for, meaning_of_radius
from dldsim.report.sections.designs import judged, on_bounds
from dldsim.tables.parquet import write_table
from tests.report.design_tables import make_design_tables
from tests.report.html_page import Page, rules_of


def request_of(name, **changes):
    return DesignRequest(
        name=name, stiffness_set_1="3", stiffness_set_2="3", radius_1_um=5, radius_2_um=9, **changes
    ).model_dump(mode="json")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("design")
    about = {
        "config_hash": "0123abcd",
        "seed": 7,
        "settings": {
            "cell": CellShape().model_dump(mode="json"),
            "flow": Flow().model_dump(mode="json"),
            "design_requests": [request_of("pair", pillar_radius_um=(6, 12), periodicity=(4, 8))],
            "surrogate": {
                "scores_by_geometry": {"median_absolute_error_deg": 0.3, "rmse_deg": 1.2},
                "data": {"used": 81, "geometries": 27, "sha256": "c34d39417d799b9d4f"},
            },
            "holds_for": "biconcave discs (Ca 0.02 to 1)",
        },
    }
    for kind, table in make_design_tables("pair").items():
        write_table(kind, table, folder / f"{kind}.parquet", about)
    write_report(folder, folder / "report.html")
    return Page(folder / "report.html")


def test_answer_stands_first_and_the_page_stands_alone(page):
    assert page.rows[1][:4] == ["pair", "7.00", "14.30", "8"]
    assert not page.links and "<script" not in page.raw
    assert not (page.path.parent / "figures").exists()
    assert page.sources and all(source.startswith("data:image/") for source in page.sources)


def test_a_verdict_stands_with_its_notes(page):
    said = [row[0] for row in page.rows if row[0].startswith("resolved; extrapolated: ")]
    assert len(said) == 1 and "geometries; N_p is the highest that" in said[0]


def test_no_column_is_kept_for_contents_that_the_page_has_not(page):
    """Above 960 px the text stood in a column of 224 px, made for a navigation."""
    assert "<nav" not in page.raw and '<div class="page">' in page.raw
    rules = rules_of(".page", page.raw.split("@media print")[0])
    assert "max-width: 61rem" in rules and "grid" not in rules


def test_first_lines_name_cells_channel_and_velocity(page):
    where = "at rest in a channel 20 µm high at a mean velocity of 0.5 mm/s."
    before = page.text[: page.text.index("Table 1.")]
    assert f"Holds for biconcave discs of radius 5 µm {where}" in before
    assert f"Holds for spheres of radius 9 µm {where}" in before
    disc = "is a biconcave disc of that radius, 10 µm across, not a bead"
    assert f"A cell “of radius 5 µm” {disc}" in before


def test_what_the_assay_does_not_tell_stands_before_the_answer(page):
    doubt = "“pair”: The assay mine does not tell the two cell types apart."
    assert page.text.index(doubt) < page.text.index("Table 1.")


def test_cell_types_stand_step_by_step(page):
    [disc] = [row for row in page.rows[:8] if row[:3] == ["pair", "1", "biconcave"]]
    assert disc[6:] == [
        "0.700 ± 0.020",
        "mine",
        "10.0 (8.00 to 14.0)",
        "0.0750 (0.0540 to 0.0940)",
        "6.60",
    ]
    [bead] = [row for row in page.rows[:8] if row[:3] == ["pair", "2", "bead"]]
    assert bead[6:10] == ["–", "–", "75.0", "0.0100"]


def test_a_design_on_a_bound_of_the_search_is_flagged(page):
    best = page.rows[page.rows.index(next(r for r in page.rows if "2.50 to 4.40" in r)) + 1][0]
    assert "P_r is the lowest that the search allows (6 µm)" in best
    assert "N_p is the highest that the search allows (8)" in best and "P_g" not in best
    assert "The best design for “pair” lies on a bound of the search: N_p" in page.text


@pytest.mark.parametrize(("gap", "side"), [(12.05, "lowest"), (21.95, "highest"), (17.0, None)])
def test_near_a_bound_counts_as_on_it(gap, side):
    row = {"pillar_radius_um": 8.0, "gap_um": gap, "periodicity": 6}
    bounds = {"pillar_radius_um": [8, 8], "gap_um": [12, 22], "periodicity": [4, 8]}
    found = on_bounds(row, bounds)
    assert [side in text for text in found] == ([] if side is None else [True])
    assert on_bounds(row, None) == []


def test_scope_of_other_shapes():
    assert holds_for("sphere", [5, 5.0], 0, 0.5) == (
        "Holds for spheres of radius 5 µm at rest in a channel without top or bottom at a mean "
        "velocity of 0.5 mm/s."
    )
    assert "sphere 10 µm across" in meaning_of_radius("sphere", 5)
    assert "oblate ellipsoid" in meaning_of_radius("ellipsoid", 5, 0.6)
    assert "sphere of 8.4 µm" in meaning_of_radius("ellipsoid", 5, 0.6)


@pytest.mark.parametrize(
    ("half", "agrees", "words"),
    [
        (2.82, True, "uninformative: includes zero"),
        (2.82, None, "uninformative: includes zero"),
        (1.0, True, "confirmed"),
        (1.0, None, "–"),
        (1.0, False, "missed"),
        (2.82, False, "missed"),
    ],
)
def test_a_prediction_whose_interval_includes_zero_is_not_confirmed(half, agrees, words):
    design = {"predicted_separation_deg": 2.07, "uncertainty_deg": half, "agrees": agrees}
    assert judged(design) == words


def test_an_interval_that_includes_zero_is_drawn_apart():
    table = pd.DataFrame(
        [
            {
                "request": "a",
                "round": 1,
                "role": "design",
                "array": k,
                "population": "difference",
                "pillar_radius_um": 6.0,
                "gap_um": 14.0,
                "periodicity": 8,
                "height_um": 20.0,
                "predicted_deg": 2.07,
                "predicted_low_deg": 2.07 - half,
                "predicted_high_deg": 2.07 + half,
                "simulated_deg": 0.19,
                "sigma_num_deg": None,
                "agrees": None,
            }
            for k, half in enumerate((2.82, 1.0))
        ]
    )
    assert design_figures.tells_order(table).tolist() == [False, True]
    figure = design_figures.draw_rounds(table)
    bars = {to_hex(c.get_color()[0]).upper(): c.get_segments() for c in figure.axes[0].collections}
    [uninformative] = bars[design_figures.UNINFORMATIVE]
    assert uninformative[:, 1].tolist() == pytest.approx([-0.75, 4.89])
    assert "includes zero" in " ".join(t.get_text() for t in figure.legends[0].get_texts())


def test_a_passage_is_labelled_by_what_the_cell_is():
    row = {
        "stiffness_set": "request-1",
        "ks_uN_per_m": 5.123,
        "cell_radius_um": 7.5,
        "migration_angle_deg": 3.3,
        "mode": "mixed",
        "status": "decided",
    }
    assert passage_label(1, row) == "cell 1, k_s 5.12 µN/m, R 7.5 µm: 3.30°, mixed"
    assert passage_label(2, {**row, "migration_angle_deg": None, "status": "stuck"}).endswith(
        ": stuck"
    )
