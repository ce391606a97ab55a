"""The report against a small made-up campaign: numbers, labels, escapes, links, missing tables."""

import json
import os
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup

import dldsim
from dldsim.analysis.regressors import SURROGATE
from dldsim.errors import DldsimError
from dldsim.report import angle_figures, campaign_page, style, surrogate_figures, trajectory_figures
from dldsim.report import page as report_page
from dldsim.report.formats import number
from dldsim.report.inputs import CARD, STUDIES, TABLES
from dldsim.report.sections import summary
from dldsim.tables.parquet import write_table
from dldsim.tables.registry import COLUMNS
from dldsim.vocabulary import SETTLED
from tests.report.design_tables import make_design_tables
from tests.report.html_page import Page, rules_of
from tests.report.made_results import PROVENANCE, make_results
from tests.report.made_runs import NASTY, SETS, make_outcome, make_run

pytestmark = pytest.mark.slow
CONFIG = {
    "preset": "tiny",
    "seed": 7,
    "cell": {"shape": "biconcave", "radius_um": 7.5},
    "run_control": {"max_rows": 12},
    "constriction": {"width_um": 30.0},
}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign") / "results"
    tables = make_results(folder)
    campaign_page.make_report(folder, folder / "report.html", CONFIG)
    return tables, Page(folder / "report.html")


def test_status_table_counts_the_outcomes(campaign):
    tables, page = campaign
    outcomes = tables["outcomes"]
    statuses = outcomes["status"].value_counts()
    # the made-up campaign has them all
    assert set(statuses.index) == set(summary.STATUS_MEANING)
    head = page.row("status")
    for status, count in statuses.items():
        row = dict(zip(head, page.row(status), strict=True))
        assert row["all"] == str(count)
        of_status = outcomes[outcomes["status"] == status]["mode"]
        for mode in ("bump", "mixed", "zigzag"):
            assert row[mode] == str((of_status == mode).sum())
    statuses = tables["runs"]["status"].value_counts()
    assert set(statuses.index) == set(summary.RUN_MEANING)
    for status in ("converged", "periodic", "stationary"):
        assert page.row(status)[1] == str(statuses[status])


def test_every_outcome_and_every_release_has_a_row(campaign):
    tables, page = campaign
    for _, outcome in tables["outcomes"].iterrows():
        if outcome["mode"] != "none":
            assert page.row(outcome["outcome_id"])[1] == outcome["status"]
    for _, run in tables["runs"].iterrows():
        assert page.row(run["run_id"])[1] == run["status"]
    [coexisting] = tables["outcomes"].query("status == 'coexisting'").to_dict("records")
    row = page.row(coexisting["outcome_id"])
    assert "50, 0, 50" in row and "2" in row  # shares of the flux, releases


def test_outcomes_without_an_angle_are_listed_with_their_reason(campaign):
    tables, page = campaign
    broken = tables["outcomes"].query("mode == 'none'")
    assert len(broken) == 3
    for _, outcome in broken.iterrows():
        row = page.row(outcome["outcome_id"])
        assert row[1] == outcome["status"] and row[-1] == NASTY


def test_text_from_tables_is_escaped(campaign):
    _, page = campaign
    assert "density 3.1 &lt;b&gt;&amp; more&lt;/b&gt;" in page.raw
    assert "<b>& more" not in page.raw
    assert "soft &lt;from&gt; stiff" in page.raw and "<from>" not in page.raw


def test_page_shows_no_missing_number_as_such(campaign):
    _, page = campaign
    assert not re.search(r"\b(nan|null|inf)\b", page.text, re.I)
    bare = [
        row for row in page.rows if {"", "none", "<na>", "nat"} & {c.strip().lower() for c in row}
    ]
    assert not bare


def test_page_loads_nothing(campaign):
    _, page = campaign
    assert page.sources and all(source.startswith("data:image/") for source in page.sources)
    assert not page.tags & {"link", "script", "iframe", "object"}
    assert not re.search(r"url\(|@import|https?:", re.sub(r'src="data:[^"]*"', "", page.raw))
    assert page.path.stat().st_size < 8e6


def test_every_link_leads_somewhere(campaign):
    _, page = campaign
    inside = [link[1:] for link in page.links if link.startswith("#")]
    files = [link for link in page.links if not link.startswith("#")]
    assert len(inside) >= len(campaign_page.SECTIONS)
    assert all(f'id="{anchor}"' in page.raw for anchor in inside)
    assert all((page.path.parent / link).exists() for link in files)
    linked = {link for link in files if link.endswith(".parquet")}
    assert linked == {name for name, _ in TABLES.values()}


def test_each_figure_is_saved_as_png_and_svg(campaign):
    _, page = campaign
    names = re.findall(r'<figure id="figure-(\w+)"', page.raw)
    assert len(names) == len(set(names)) == 46
    for name in names:
        assert (page.path.parent / "figures" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
        assert b"<svg" in (page.path.parent / "figures" / f"{name}.svg").read_bytes()


def test_benchmark_table_keeps_the_splits_apart(campaign):
    tables, page = campaign
    folds = tables["benchmark"]
    of_model = folds[folds["model"] == "XGBoost"].groupby("split")["rmse_deg"]
    rows = [row for row in page.rows if row[0] == "XGBoost" and len(row) == 10]
    for row, split in zip(rows, ("geometry", "random", "stiffness"), strict=True):
        mean, spread = of_model.mean()[split], of_model.std()[split]
        assert row[3] == f"{number(mean, 2)} ± {number(spread, 2)}"


def test_design_table_shows_separation_with_uncertainty(campaign):
    _, page = campaign
    [row] = [row for row in page.rows if "2.50 to 4.40" in row]
    assert row[5:8] == ["4.00 ± 1.70", "–", "2.50 to 4.40"]
    assert page.rows[page.rows.index(row) + 1] == ["resolved"]


def test_a_failed_request_gets_its_reason(campaign):
    _, page = campaign
    for what in ("candidates", "simulated designs"):
        assert f"{what} of the request dead" in page.text
    assert page.raw.count("no &lt;range&gt; left") >= 2


def test_verified_designs_show_simulation_beside_prediction(campaign):
    _, page = campaign
    row, checks = (r for r in page.rows if "made-up-1" in r)
    assert "3.00 ± 0.30" in row and "7.00" in row and "14.30" in row and "8" in row
    assert checks[2:] == [
        "4.00 ± 3.50",
        "confirmed",
        "3.00 ± 0.30",
        "2.80",
        "2.00 to 4.50",
        "2.50, –",
    ]
    verdict = page.rows[page.rows.index(row) + 1]
    assert verdict == ["separates by 3.00 ± 0.30°; prediction confirmed"]
    stuck = next(r for r in page.rows if "made-up-2" in r)
    assert page.rows[page.rows.index(stuck) + 1] == ["no separation measured"]


@pytest.fixture
def blank_figures(monkeypatch):
    """Figures are drawn and not rendered, which is most of the time that a page takes."""
    monkeypatch.setattr(style, "render", lambda figure, kind: b"<svg/>")


def write_campaign(folder, rows):
    """The tables of outcomes and runs of made-up runs, one of each outcome."""
    write_table(
        "outcomes", [make_outcome([row]) for row in rows], folder / "outcomes.parquet", PROVENANCE
    )
    write_table("runs", rows, folder / "runs.parquet", PROVENANCE)


def test_report_of_broken_outcomes_alone_says_what_is_missing(tmp_path, blank_figures):
    """No optional table and no angle: sentences and rules, no crash."""
    rng = np.random.default_rng(0)
    rows = [make_run(6.0, 18.0, 5, name, rng, "failed")[0] for name in SETS]
    blank = {c.name: None for c in COLUMNS["outcomes"] if c.nullable}
    outcomes = [make_outcome([row]) | blank | {"releases": 0} for row in rows]
    write_table("outcomes", outcomes, tmp_path / "outcomes.parquet", PROVENANCE)
    write_table("runs", [], tmp_path / "runs.parquet", PROVENANCE)
    campaign_page.make_report(tmp_path, tmp_path / "page" / "report.html", {})
    page = Page(tmp_path / "page" / "report.html")
    studies = [TABLES[kind][1] for kind in STUDIES]
    assert f"snakemake -j2 {' '.join(studies)}" in page.text
    for chapter in ("Validation", "Stability", "Analysis of variance"):
        assert f"<h2>{chapter}</h2>" not in page.raw
    assert "No outcome of this campaign has a migration angle" in page.text
    for name, rule in TABLES.values():
        if name != "outcomes.parquet" and name != "runs.parquet" and rule not in studies:
            row = page.row(name)
            assert row[1] == f"snakemake -j2 {rule}"
            assert page.rows[page.rows.index(row) + 1] == ["It does not exist."]
    assert all((page.path.parent / link).exists() for link in page.links if link[0] != "#")


def test_one_mode_alone_is_called_out(tmp_path, blank_figures):
    rng = np.random.default_rng(0)
    rows = [make_run(6.0, 12.0, n, name, rng)[0] for name in SETS for n in (8, 12)]
    assert {row["mode"] for row in rows} == {"bump"}
    write_campaign(tmp_path, rows)
    campaign_page.make_report(tmp_path, tmp_path / "report.html", CONFIG)
    text = Page(tmp_path / "report.html").text
    assert "Every measured outcome has the same mode (bump)" in text


def test_nothing_to_show_is_refused_with_the_reasons(tmp_path):
    write_table("outcomes", [], tmp_path / "outcomes.parquet", PROVENANCE)
    (tmp_path / "runs.parquet").write_bytes(b"PAR1 cut short")
    with pytest.raises(DldsimError, match="nothing to report") as refused:
        campaign_page.make_report(tmp_path, tmp_path / "report.html", CONFIG)
    for reason in (
        "outcomes.parquet: It has no row",
        "runs.parquet is not a readable Parquet",
        "flows.parquet: It does not exist",
    ):
        assert reason in str(refused.value)
    assert not (tmp_path / "report.html").exists()


def lacking(page, what):
    """Command and reason that a page gives for what it lacks."""
    row = page.row(what)
    return row[1], page.rows[page.rows.index(row) + 1][0]


def test_a_report_is_made_of_what_there_is(tmp_path, blank_figures):
    """Damaged, absent and older tables, a chapter that fails, requests that failed."""
    rng = np.random.default_rng(0)
    write_campaign(tmp_path, [make_run(6.0, 14.0, 8, name, rng)[0] for name in SETS])
    tables = make_design_tables("first")
    for kind in ("designs", "design_trials"):
        write_table(kind, tables[kind], tmp_path / TABLES[kind][0], PROVENANCE)
    told = [
        {"request": "first", "status": "answered", "reason": ""},
        {"request": "second", "status": "failed", "reason": "second: no array is feasible"},
    ]
    write_table("design_requests", told, tmp_path / TABLES["design_requests"][0], PROVENANCE)
    (tmp_path / "anova.parquet").write_bytes(b"PAR1 cut short")
    (tmp_path / "surrogate_card.json").write_text("{")
    os.utime(tmp_path / "designs.parquet", (1, 1))
    config = {**CONFIG, "design_requests": [{"name": "first"}, {"name": "second"}]}
    campaign_page.make_report(tmp_path, tmp_path / "report.html", config)
    page = Page(tmp_path / "report.html")
    assert "<h2>Designs</h2>" in page.raw and "<h2>Migration angle</h2>" in page.raw
    assert "This report is not complete" in page.text
    assert "made from earlier ones: designs.parquet." in page.text
    assert "not a readable Parquet file" in lacking(page, "anova.parquet")[1]
    assert "not readable as JSON" in lacking(page, "chapter “Summary”")[1]
    command, why = lacking(page, "candidates of the request second")
    assert command == "snakemake -j2 designs" and "second: no array is feasible" in why
    assert "request first" not in page.text


def test_after_a_failure_no_older_report_is_left(tmp_path, blank_figures):
    old = tmp_path / "report.html"
    old.write_text("old")
    assert "nothing to report" in campaign_page.renew_report(tmp_path, CONFIG)
    assert not old.exists()
    old.write_text("old")
    rng = np.random.default_rng(0)
    write_campaign(tmp_path, [make_run(6.0, 14.0, 8, name, rng)[0] for name in SETS])
    assert str(old) in campaign_page.renew_report(tmp_path, CONFIG)
    assert "designs.parquet" in Page(old).text


def test_designs_come_first_with_the_array(campaign):
    _, page = campaign
    assert page.raw.index("<h2>Designs</h2>") < page.raw.index("<h2>Summary</h2>")
    head, answer, verdict = page.rows[:3]
    assert answer[:4] == ["soft <from> stiff", "7.00", "14.30", "8"]
    assert head[1:4] == ["Pr [µm]", "Pg [µm]", "Np"] and "3.00 ± 0.30" in answer
    assert verdict == ["separates by 3.00 ± 0.30°; prediction confirmed"]
    assert re.search(
        r"largest simulated separation of a design \(soft <from> stiff\): "
        r"P_r 7\.00 µm, P_g 14\.3 µm, N_p 8",
        page.text,
    )


def test_first_lines_say_what_the_designs_hold_for(campaign):
    text = campaign[1].text
    assert text.index(
        "Holds for biconcave discs of radius 5 µm at rest in a channel 20 µm high "
        "at a mean velocity of 0.5 mm/s."
    ) < text.index("Table 1.")
    assert text.index("biconcave disc of that radius, 10 µm across, not a bead") < text.index(
        "Table 1."
    )


def test_tables_outside_folds_fit_the_page(campaign):
    """Twelve columns fit a column of text of 55 rem; verdicts run below over the whole width."""
    open_parts = re.sub(r"<details>.*?</details>", "", campaign[1].raw, flags=re.S)
    heads = re.findall(r"<thead>(.*?)</thead>", open_parts, flags=re.S)
    assert len(heads) > 15 and max(head.count("<th>") for head in heads) <= 12
    assert not [head for head in heads if "<th>verdict</th>" in head and head.count("<th>") > 6]


def test_internal_tables_are_folded(campaign):
    open_parts = re.sub(r"<details>.*?</details>", "", campaign[1].raw, flags=re.S)
    for caption in ("Settings and provenance.", "Numerics over all runs."):
        assert caption in campaign[1].raw and caption not in open_parts


def test_conditions_that_the_source_does_not_vary_are_drawn(campaign):
    predictions = campaign[0]["predictions"]
    predictions = predictions.assign(
        cell_shape=np.where(predictions.index % 2, "sphere", "biconcave")
    )
    figure = surrogate_figures.draw_conditions(predictions, "XGBoost")
    left, right = figure.axes
    assert (left.get_xscale(), right.get_xscale()) == ("log", "linear")
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["biconcave", "sphere"]


def test_error_of_the_surrogate_is_one_number_and_the_other_is_explained(
    tmp_path, blank_figures, campaign
):
    tables, _ = campaign
    for kind in ("outcomes", "benchmark", "predictions"):
        renamed = tables[kind].replace({"model": {"XGBoost": SURROGATE}})
        write_table(kind, renamed, tmp_path / TABLES[kind][0], PROVENANCE)
    card = Path(dldsim.__file__).parent / "data" / "campaign" / "surrogate_card.json"
    shutil.copy(card, tmp_path)
    error = number(json.loads(card.read_text())["scores_by_geometry"]["rmse_deg"], 2)
    campaign_page.make_report(tmp_path, tmp_path / "report.html", CONFIG)
    text = Page(tmp_path / "report.html").text
    assert f"± {error}° error of the surrogate ({SURROGATE})" in re.sub(" +", " ", text)
    assert f"The {error}° of the surrogate and the 0.99° of {SURROGATE} in the table" in text


def test_the_text_column_is_wide_and_printing_keeps_headings(campaign):
    style = re.search(r"<style>(.*?)</style>", campaign[1].raw, flags=re.S)[1]
    screen, printed = style.split("@media print")
    assert "max-width: 61rem" in rules_of(".page", screen)
    assert "grid" not in rules_of(".page", screen)
    assert "minmax(0, 58rem)" in rules_of(".page.with-contents", screen)
    for heading in ("h2", "h3", "caption"):
        assert "break-after: avoid" in rules_of(heading, printed)
    for block in ("figure", "tr", ".table"):
        assert "break-inside: avoid" in rules_of(block, printed)
    assert "break-inside: auto" in rules_of(".table.long", printed)


def test_a_page_without_contents_has_no_column_for_them(tmp_path):
    page = report_page.Page(tmp_path, tmp_path / "a.html", {}, {})
    for contents in (True, False):
        report_page.write_page(
            page,
            title="t",
            heading="<h>",
            lead="",
            contents=contents,
            scope=[],
            notices=[],
            sections=[("a", "A", Markup("<p>body</p>"))],
        )
        raw = page.output.read_text()
        assert ("<nav" in raw) == ('with-contents"' in raw) == contents
        assert "<h1>&lt;h&gt;</h1>" in raw and "<p>body</p>" in raw


def test_templates_come_with_the_package():
    root = Path(dldsim.__file__).parent
    project = tomllib.loads((root.parent / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["dldsim"]
    packaged = {path for pattern in patterns for path in root.glob(pattern)}
    files = {path for path in (root / "report").rglob("*") if path.suffix in (".html", ".css")}
    assert len(files) > 20 and files <= packaged


def test_rules_named_for_missing_tables_make_them():
    rules = {}
    for path in (Path(__file__).parents[2] / "workflow" / "rules").glob("*.smk"):
        _, *blocks = re.split(r"^rule (\w+):", path.read_text(), flags=re.M)
        rules |= dict(zip(blocks[::2], blocks[1::2], strict=True))
    for name, rule in (*TABLES.values(), CARD):
        assert f"/{name}" in rules[rule].split("output:")[1]


def test_picked_trajectories_show_each_mode_and_prefer_settled_runs(campaign):
    runs = campaign[0]["runs"]
    picked = dict(trajectory_figures.pick_trajectories(runs))
    for mode in ("bump", "zigzag"):
        [run_id] = picked[f"{mode} mode"]
        run = runs.set_index("run_id").loc[run_id]
        assert run["mode"] == mode and run["status"] in SETTLED


def test_trajectory_panel_shows_a_period_in_true_proportion(campaign):
    tables, _ = campaign
    runs, tracks = tables["runs"], tables["trajectory"]
    run = runs[runs["mode"] == "bump"].iloc[0]
    panel = trajectory_figures.trajectory_panel("bump", [run["run_id"]], runs, tracks)
    assert np.ptp(panel.paths[0]["x"]) >= run["periodicity"] * run["pitch_um"]
    axes = trajectory_figures.draw_trajectories([panel]).axes[0]
    box = axes.get_window_extent()
    scale = box.width / np.ptp(panel.xlim) / (box.height / np.ptp(panel.ylim))
    assert scale == pytest.approx(1, rel=1e-3)


def test_mode_points_place_outcomes_against_the_critical_diameter(campaign):
    points = angle_figures.mode_points(campaign[0]["outcomes"], 1.0)
    assert len(points) == len(style.measured(campaign[0]["outcomes"]))
    run = points.iloc[0]
    law = 1.4 * run["gap_um"] * run["periodicity"] ** -0.48
    assert run["size_over_critical"] == pytest.approx(run["size_um"] / law)


def test_equal_figures_give_equal_files(campaign):
    scores = surrogate_figures.pooled_scores(campaign[0]["predictions"])
    first, second = (
        style.render(surrogate_figures.draw_benchmark(scores, campaign[0]["benchmark"]), "svg")
        for _ in range(2)
    )
    assert first == second


def test_both_files_of_a_figure_are_laid_out_alike(campaign):
    scores = surrogate_figures.pooled_scores(campaign[0]["predictions"])
    figure = surrogate_figures.draw_benchmark(scores, campaign[0]["benchmark"])
    places = []
    for kind in ("svg", "png"):
        style.render(figure, kind)
        places.append([axes.get_position().bounds for axes in figure.axes])
    assert places[0] == places[1]


def test_a_short_run_beside_a_long_one_is_seen_whole_in_the_window(campaign):
    tables, _ = campaign
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
