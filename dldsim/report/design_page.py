"""One self-contained HTML page of one design request, from the tables beside it."""

import json
from pathlib import Path

from dldsim.report.formats import text
from dldsim.report.page import Page, Section, render_sections, write_page
from dldsim.report.sections import designs, outlets, search
from dldsim.tables.parquet import describe, read_table

OUTLETS = outlets.NEEDED
OPTIONAL = ("verifications", "verified_designs", *OUTLETS)
KINDS = (
    "design_populations",
    "designs",
    "design_trials",
    "design_tolerances",
    "design_importance",
    "design_slices",
    "verifications",
    "verified_designs",
    *OUTLETS,
)


def write_report(directory: Path, output: Path) -> None:
    """Write the page of the tables in a folder and of the masks in its subfolder `files`.

    Raises DldsimError if a table of the search is missing or damaged.
    """
    directory = Path(directory)
    tables = {
        kind: read_table(kind, path)
        for kind in KINDS
        if (path := directory / f"{kind}.parquet").exists() or kind not in OPTIONAL
    }
    page = Page(directory, Path(output), {}, tables, linked=False)
    shown, failed = render_sections(page, SECTIONS)
    name = text(tables["designs"]["request"].iloc[0])
    write_page(
        page,
        title=f"Designs for {name}",
        heading=f"Designs for “{name}”",
        contents=False,
        lead="Pillar arrays that separate two cell types by deterministic lateral "
        "displacement. Angles are predicted by a surrogate of simulations, with 90 % "
        "intervals, unless they are called simulated.",
        scope=designs.scope(page),
        sections=shown,
        notices=[f"Missing: {m.what}. {m.why}" for m in failed],
    )


def _masks(page: Page) -> dict | None:
    request = page["designs"]["request"].iloc[0]
    paths = sorted((page.results / "files").glob(f"{request}-*.mask.png"))
    return {"masks": [page.image(path) for path in paths]} if paths else None


def _origin(page: Page) -> dict:
    """Versions, seed, request and surrogate."""
    about = describe(page.results / "designs.parquet")["provenance"]
    settings = about["settings"]
    [request] = settings["design_requests"]
    model = settings["surrogate"]
    scores, data = model["scores_by_geometry"], model["data"]
    rows = {
        "dldsim, physics": f"{about['dldsim_version']}, version {about['physics_version']}",
        "hash of the settings": about["config_hash"],
        "seed": str(about["seed"]),
        "surrogate learnt from": f"{data['used']} outcomes in {data['geometries']} arrays, "
        f"SHA-256 {data['sha256'][:16]}…",
        "its error on arrays never seen": f"median "
        f"{scores['median_absolute_error_deg']:.2f}°, root mean square {scores['rmse_deg']:.2f}°",
        "learnt of": settings["holds_for"],
        "flow": json.dumps(settings["flow"], ensure_ascii=False),
        **{
            f"request: {key}": json.dumps(value, ensure_ascii=False)
            for key, value in request.items()
            if value is not None
        },
    }
    return {"settings": page.table({"setting": rows, "value": map(text, rows.values())})}


SECTIONS = (
    Section("answer", "Best design", ("designs",), designs.answer),
    Section("outlets", "At the outlets", OUTLETS, outlets.contents),
    Section("candidates", "Candidates", ("designs",), designs.candidates),
    Section("verified", "Simulated designs", (), designs.verified),
    Section("search", "Course of the search", ("design_trials",), search.contents),
    Section("masks", "Photomask", (), _masks),
    Section("origin", "Where this comes from", ("designs",), _origin),
)
