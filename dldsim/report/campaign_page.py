"""One self-contained HTML page from the tables of a campaign: results/report.html.

Figures are saved as PNG and SVG under results/figures/ and embedded; beside each stand relative
links to the tables that it was drawn from. Designs come first, since they are what a campaign is
for; a chapter without its tables is left out and named at the end with the reason.
"""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from markupsafe import Markup

from dldsim.errors import DldsimError
from dldsim.files import why_not_written
from dldsim.report.formats import listing
from dldsim.report.inputs import TABLES, Missing, read_inputs
from dldsim.report.page import Grid, Page, Section, render_sections, write_page
from dldsim.report.sections import (
    accuracy,
    angles,
    anova,
    benchmark,
    calibration,
    designs,
    flow,
    modes,
    numerics,
    origin,
    outcomes,
    robustness,
    runs,
    search,
    stability,
    summary,
    trajectories,
    validation,
)

SECTIONS = (
    Section("designs", "Designs", (), designs.contents),
    Section("summary", "Summary", ("outcomes",), summary.contents),
    Section("trajectories", "Trajectories", ("runs",), trajectories.contents),
    Section("angles", "Migration angle", ("outcomes",), angles.contents),
    Section("modes", "Migration modes", ("outcomes",), modes.contents),
    Section(
        "calibration", "Assays and calibration", ("assay_runs", "calibration"), calibration.contents
    ),
    Section("anova", "Analysis of variance", ("anova",), anova.contents),
    Section("robustness", "Robustness map", ("robustness",), robustness.contents),
    Section(
        "benchmark", "Regressors", ("benchmark", "predictions", "outcomes"), benchmark.contents
    ),
    Section("search", "Course of the design search", ("design_trials",), search.contents),
    Section("flow", "Flow without a cell", ("flows",), flow.contents),
    Section("numerics", "Numerics", ("runs",), numerics.contents),
    Section("validation", "Validation", ("validation",), validation.contents),
    Section("accuracy", "Accuracy", ("outcomes",), accuracy.contents),
    Section("stability", "Stability", ("stability",), stability.contents),
    Section("outcomes", "All outcomes", ("outcomes",), outcomes.contents),
    Section("runs", "All runs", ("runs",), runs.contents),
    Section("origin", "Settings and versions", ("outcomes",), origin.contents),
)


NAMED = 5
"""Missing things that are named at the top; all of them are at the end."""


def make_report(results_dir: Path, output: Path, config: Mapping[str, Any]) -> None:
    """Write the report of a results folder as one self-contained HTML file.

    Figures go to results_dir/figures as PNG and SVG. A table that is absent, damaged or of another
    physics version, a design request without a row and a chapter that cannot be made are named on
    the page with the reason. Raises DldsimError only where there is nothing to show.
    """
    results, output = Path(results_dir), Path(output)
    inputs = read_inputs(results)
    page = Page(results, output, config, inputs.tables)
    shown, failed = render_sections(page, SECTIONS)
    missing = [*inputs.missing, *failed]
    if missing or inputs.studies:
        shown.append(
            (
                "missing",
                "Not in this report",
                page.render(
                    "parts/missing.html",
                    {
                        "missing": _grid(page, missing) if missing else None,
                        "studies": inputs.studies,
                    },
                ),
            )
        )
    preset = page.setting("preset")
    name = f"Campaign “{preset}”" if preset else "Campaign"
    write_page(
        page,
        title=f"{name}: deformable cells in DLD arrays",
        heading=name,
        contents=True,
        lead=_lead(page),
        scope=designs.scope(page),
        sections=shown,
        notices=_notices(page, missing, inputs.outdated),
    )


def renew_report(results_dir: Path, config: Mapping[str, Any]) -> str:
    """After a failure: the report of what there is in place of an older one; says what came of it.

    Where there is nothing to show, an older report is removed.
    """
    output = Path(results_dir) / "report.html"
    try:
        make_report(results_dir, output, config)
    except DldsimError as error:
        output.unlink(missing_ok=True)
        return f"No report: {error}"
    except OSError as error:
        if (reason := why_not_written(error)) is None:
            raise
        return f"No report: {reason}"
    return f"The report of what there is, with what is missing and why: {output}"


def _grid(page: Page, missing: list[Missing]) -> Grid:
    return page.table(
        {"what": (m.what for m in missing), "made by": (m.command for m in missing)},
        notes=(m.why for m in missing),
    )


def _lead(page: Page) -> str:
    written = f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}"
    lead = (
        "Deformable cells in deterministic lateral displacement arrays: designs, simulated "
        f"trajectories, statistics and surrogate. Written {written}"
    )
    if "outcomes" not in page:
        return f"{lead}."
    made = (page.results / TABLES["outcomes"][0]).stat().st_mtime
    return f"{lead} from outcomes of {datetime.fromtimestamp(made).astimezone():%Y-%m-%d %H:%M}."


def _notices(page: Page, missing: list[Missing], outdated: list[str]) -> list[Markup | str]:
    """What a reader must know before the numbers."""
    found = []
    if missing:
        names = listing(m.what for m in missing[:NAMED])
        rest = len(missing) - NAMED
        found.append(
            Markup(
                "This report is not complete. Missing: {}{}. The reasons are "
                '<a href="#missing">at its end</a>.'
            ).format(names, f", and {rest} more" if rest > 0 else "")
        )
    if outdated:
        found.append(
            "Older than the table of outcomes, so made from earlier ones: "
            f"{listing(outdated)}. Bring them up to date with snakemake -j2 all."
        )
    if "outcomes" in page and len(only := summary.modes_of(page["outcomes"])) == 1:
        found.append(
            f"Every measured outcome has the same mode ({only[0]}). Angles then follow from the "
            "geometry alone, and neither the analysis nor the designs say anything about the cell. "
            "Widen the sweep across the critical diameter (see Migration modes)."
        )
    return found
