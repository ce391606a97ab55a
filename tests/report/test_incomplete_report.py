"""The report of a campaign that lacks something: what is said instead, and which rule makes it."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from dldsim.errors import DldsimError
from dldsim.report import campaign_page
from dldsim.report.inputs import CARD, STUDIES, TABLES
from dldsim.tables.parquet import write_table
from dldsim.tables.registry import COLUMNS
from tests.report.design_tables import make_design_tables
from tests.report.html_page import Page
from tests.report.made_results import CONFIG, PROVENANCE
from tests.report.made_runs import SETS, make_outcome, make_run

pytestmark = pytest.mark.slow


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


def test_rules_named_for_missing_tables_make_them():
    rules = {}
    for path in (Path(__file__).parents[2] / "workflow" / "rules").glob("*.smk"):
        _, *blocks = re.split(r"^rule (\w+):", path.read_text(), flags=re.M)
        rules |= dict(zip(blocks[::2], blocks[1::2], strict=True))
    for name, rule in (*TABLES.values(), CARD):
        assert f"/{name}" in rules[rule].split("output:")[1]
