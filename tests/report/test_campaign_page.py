"""The report against a small made-up campaign: numbers, labels, escapes, links."""

import json
import re
import shutil
import tomllib
from pathlib import Path

import pytest
from markupsafe import Markup

import dldsim
from dldsim.analysis.regressors import SURROGATE
from dldsim.report import campaign_page
from dldsim.report import page as report_page
from dldsim.report.formats import number
from dldsim.report.inputs import TABLES
from dldsim.report.sections import summary
from dldsim.tables.parquet import write_table
from tests.report.html_page import Page, rules_of
from tests.report.made_results import CONFIG, PROVENANCE
from tests.report.made_runs import NASTY

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def campaign(results):
    """Tables of a campaign and the page that is made of them."""
    folder, tables = results
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


def test_error_of_the_surrogate_is_one_number_and_the_other_is_explained(
    tmp_path, blank_figures, tables
):
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
