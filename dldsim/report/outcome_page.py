"""One self-contained HTML page of what comes out of a device, from the tables beside it."""

import json
from pathlib import Path

from dldsim.report.formats import text
from dldsim.report.page import Page, Section, render_sections, write_page
from dldsim.report.sections import outlets
from dldsim.tables.parquet import describe, read_table

KINDS = (*outlets.NEEDED, "device_checks", "checked_cells")


def write_outcome_page(directory: Path, output: Path) -> None:
    """Write the page of the tables in a folder.

    Raises DldsimError if a table of the device is missing or damaged.
    """
    directory = Path(directory)
    tables = {
        kind: read_table(kind, path)
        for kind in KINDS
        if (path := directory / f"{kind}.parquet").exists() or kind in outlets.NEEDED
    }
    page = Page(directory, Path(output), {}, tables, linked=False)
    shown, failed = render_sections(page, SECTIONS)
    about = describe(directory / "device_outcomes.parquet")["provenance"]["settings"]
    name = text(tables["device_outcomes"]["device"].iloc[0])
    write_page(
        page,
        title=f"Outcome of {name}",
        heading=f"What comes out of “{name}”",
        contents=False,
        lead="Two populations of cells, carried through pillar arrays by deterministic lateral "
        "displacement to the outlets of a device. Predicted by a surrogate of simulations unless "
        "it is called simulated.",
        scope=[f"Learnt: {about['holds_for']}."],
        sections=shown,
        notices=[f"Missing: {m.what}. {m.why}" for m in failed],
    )


def _origin(page: Page) -> dict:
    """Versions, seed, request, arrays and device."""
    about = describe(page.results / "device_outcomes.parquet")["provenance"]
    settings = about["settings"]
    [request] = settings["design_requests"]
    rows = {
        "dldsim, physics": f"{about['dldsim_version']}, version {about['physics_version']}",
        "hash of the settings": about["config_hash"],
        "seed": str(about["seed"]),
        **{
            f"array {i}": json.dumps(array, ensure_ascii=False)
            for i, array in enumerate(settings["arrays"], start=1)
        },
        "device": json.dumps(settings["device"], ensure_ascii=False),
        **{
            f"request: {key}": json.dumps(value, ensure_ascii=False)
            for key, value in request.items()
            if value is not None
        },
    }
    return {"settings": page.table({"setting": rows, "value": map(text, rows.values())})}


SECTIONS = (
    Section("outlets", "At the outlets", outlets.NEEDED, outlets.contents),
    Section("origin", "Where this comes from", ("device_outcomes",), _origin),
)
