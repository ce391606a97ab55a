"""One self-contained HTML page of one design request, from the tables beside it."""

import base64
import html
import json
from pathlib import Path

from dldsim.report import campaign_page, figures
from dldsim.tables.parquet import atomic_path, describe, read_table

KINDS = ("designs", "design_trials", "design_tolerances", "design_importance", "design_slices",
         "verifications", "verified_designs")  # fmt: skip


class _Page(campaign_page.Campaign):
    """A campaign's page whose figures are embedded and nowhere else, without links to tables."""

    def figure(self, name: str, figure, caption: str, kinds=(), extra: str = "") -> str:
        self.figure_count += 1
        return _embedded(name, figures.render(figure, "svg"), "svg+xml",
                         round(figure.get_figwidth() * 100),
                         f"<b>Figure {self.figure_count}.</b> {caption}")

    def sources(self, kinds) -> str:
        return ""


def write_report(directory: Path, output: Path) -> None:
    """Write the page of the tables in a folder and of the masks in its subfolder `files`.

    Raises DldsimError if a table of the search is missing or damaged.
    """
    directory = Path(directory)
    tables = {kind: read_table(kind, path) for kind in KINDS
              if (path := directory / f"{kind}.parquet").exists() or not kind.startswith("veri")}
    about = describe(directory / "designs.parquet")["provenance"]
    page = _Page(directory, Path(output), {}, tables)
    name = campaign_page.text(tables["designs"]["request"].iloc[0])
    parts = [
        "<h2>Candidates</h2>", *campaign_page._candidates(page),
        "<h2>Simulated designs</h2>",
        *(campaign_page._verified(page) if "verified_designs" in page else
          ['<p class="absent">None: these candidates are predicted, not simulated.</p>']),
        "<h2>Course of the search</h2>", *campaign_page._course(page),
        "<h2>Photomask</h2>", *map(_mask, sorted((directory / "files").glob("*.mask.png"))),
        "<h2>Where this comes from</h2>", *_origin(page, about),
    ]  # fmt: skip
    body = "\n".join(parts)
    with atomic_path(Path(output)) as part:
        part.write_text(f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Designs for {name}</title><style>{campaign_page.STYLE}</style></head>
<body><div class="page"><main>
<h1>Designs for “{name}”</h1>
<p class="lead">Pillar arrays that separate two cell types by deterministic lateral displacement.
Angles are predicted by a surrogate of simulations, with 90 % intervals, unless they are called
simulated.</p>
{body}
</main></div></body></html>
""", encoding="utf-8")


def _embedded(name: str, image: bytes, kind: str, width: int, caption: str) -> str:
    payload = base64.b64encode(image).decode()
    return (f'<figure><img alt="{html.escape(name)}" width="{width}" '
            f'src="data:image/{kind};base64,{payload}">\n'
            f"<figcaption>{caption}</figcaption></figure>")


def _mask(path: Path) -> str:
    name = campaign_page.text(path.name.removesuffix(".mask.png"))
    return _embedded(name, path.read_bytes(), "png", 920,
                     f"{name}: the mask as its GDSII file has it; green: where both cell types are "
                     "expected.")


def _origin(page: _Page, about: dict) -> list[str]:
    """Versions, seed, request and surrogate."""
    settings = about["settings"]
    [request] = settings["design_requests"]
    model = settings["surrogate"]
    scores, data = model["scores_by_geometry"], model["data"]
    rows = {
        "dldsim, physics": f"{about['dldsim_version']}, version {about['physics_version']}",
        "hash of the settings": about["config_hash"], "seed": str(about["seed"]),
        "surrogate learnt from": f"{data['used']} outcomes in {data['geometries']} arrays, "
                                 f"SHA-256 {data['sha256'][:16]}…",
        "its error on arrays never seen":
            f"median {scores['median_absolute_error_deg']:.2f}°, root mean square "
            f"{scores['rmse_deg']:.2f}°",
        "holds for": settings["holds_for"],
        "flow": json.dumps(settings["flow"], ensure_ascii=False),
        **{f"request: {key}": json.dumps(value, ensure_ascii=False)
           for key, value in request.items() if value is not None},
    }  # fmt: skip
    return [page.table({"": map(campaign_page.text, rows),
                        "value": map(campaign_page.text, rows.values())},
                       "Settings and origin.")]
