"""What the pages have in common: numbered figures and tables, links to data, the skeleton.

A chapter computes; its template in `templates/sections` says it. Templates escape every string that
is not Markup.
"""

import base64
import functools
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure

from dldsim.errors import DldsimError
from dldsim.files import atomic_path
from dldsim.report import formats, style
from dldsim.report.inputs import TABLES, Missing

EMBED_SVG_BELOW = 260_000
"""Bytes up to which a figure is embedded as SVG; a larger one is embedded as PNG."""
LONG_TABLE = 24
"""Rows from which on a table may be broken over printed pages."""


class Link(NamedTuple):
    """A relative link from the page."""

    target: str
    name: str


class Picture(NamedTuple):
    """An embedded image, the kinds of tables it was drawn from, and its files."""

    name: str
    source: str
    width: int
    data: list[Link]
    files: list[Link]


class Row(NamedTuple):
    """Cells of a row, whether it is shaded, and what is said below it over the whole width."""

    cells: tuple
    marked: bool
    note: str | None


class Grid(NamedTuple):
    """A table: headings, rows and where the data are."""

    headings: list[str]
    rows: list[Row]
    data: list[Link]

    @property
    def long(self) -> bool:
        return len(self.rows) > LONG_TABLE


class Section(NamedTuple):
    """A chapter: the anchor names its template; without the tables it needs it is left out.

    ``contents`` returns the values of the template, or None if there is nothing to show.
    """

    anchor: str
    title: str
    needs: tuple[str, ...]
    contents: Callable[["Page"], dict[str, Any] | None]


@dataclass
class Page:
    """Tables of one folder and the page that grows from them.

    Without `linked` the page stands alone: nothing is written beside it and no table is linked.
    """

    results: Path
    output: Path
    config: Mapping[str, Any]
    tables: dict[str, pd.DataFrame]
    linked: bool = True
    counts: dict[str, int] = field(default_factory=lambda: {"figure": 0, "table": 0})

    def __contains__(self, kind: str) -> bool:
        return kind in self.tables

    def __getitem__(self, kind: str) -> pd.DataFrame:
        return self.tables[kind]

    def some(self, kind: str) -> bool:
        """Whether there is a table of this kind with a row in it."""
        return kind in self.tables and len(self.tables[kind]) > 0

    def setting(self, *keys: str):
        """Value of the configuration, None where it has none."""
        value = self.config
        for key in keys:
            value = value.get(key) if isinstance(value, Mapping) else None
        return value

    def link(self, path: Path) -> Link:
        """Relative link to a file or folder."""
        target = Path(os.path.relpath(path, self.output.parent)).as_posix()
        return Link(target, path.name + ("/" if path.is_dir() else ""))

    def sources(self, kinds: Iterable[str]) -> list[Link]:
        """Links to the tables, and to their CSV twins where these exist."""
        paths = (self.results / TABLES[kind][0] for kind in kinds)
        pairs = ((path, path.with_suffix(".csv")) for path in paths if self.linked)
        return [self.link(path) for pair in pairs for path in pair if path.exists()]

    def figure(
        self, name: str, figure: Figure, kinds: Iterable[str], extra: Iterable[Link] = ()
    ) -> Picture:
        """A figure as the template embeds it; of a linked page also saved as PNG and SVG."""
        images = {"svg": style.render(figure, "svg")}
        files = []
        if self.linked or len(images["svg"]) > EMBED_SVG_BELOW:
            images["png"] = style.render(figure, "png")
        if self.linked:
            for kind, image in images.items():
                path = self.results / "figures" / f"{name}.{kind}"
                with atomic_path(path) as part:
                    part.write_bytes(image)
                files.append(self.link(path))
        kind = "svg" if len(images["svg"]) <= EMBED_SVG_BELOW else "png"
        return Picture(
            name,
            _data_uri(images[kind], kind),
            round(figure.get_figwidth() * 100),
            [*self.sources(kinds), *extra],
            files,
        )

    def image(self, path: Path) -> Picture:
        """A PNG file as the template embeds it."""
        return Picture(
            path.name.partition(".")[0], _data_uri(path.read_bytes(), "png"), 920, [], []
        )

    def table(
        self,
        columns: Mapping[str, Iterable],
        kinds: Iterable[str] = (),
        marked: Iterable[bool] | None = None,
        notes: Iterable[str | None] | None = None,
    ) -> Grid:
        """A table as the template shows it: cells by heading; marked rows are shaded."""
        cells = list(zip(*columns.values(), strict=True))
        marked = [False] * len(cells) if marked is None else map(bool, marked)
        notes = [None] * len(cells) if notes is None else notes
        rows = [Row(*row) for row in zip(cells, marked, notes, strict=True)]
        return Grid(list(columns), rows, self.sources(kinds))

    def count(self, what: str) -> int:
        """The next number of a figure or table; called where it is shown."""
        self.counts[what] += 1
        return self.counts[what]

    def render(self, template: str, values: Mapping[str, Any]) -> Markup:
        return Markup(_environment().get_template(template).render(page=self, **values))


def render_sections(
    page: Page, sections: Iterable[Section]
) -> tuple[list[tuple[str, str, Markup]], list[Missing]]:
    """Anchor, title and body of every chapter that has something to show, and those that failed."""
    shown, failed = [], []
    for anchor, title, needs, contents in sections:
        if not set(needs) <= set(page.tables):
            continue
        try:
            values = contents(page)
        except DldsimError as error:
            failed.append(Missing(f"chapter “{title}”", str(error), "snakemake -j2 all"))
            continue
        if values is not None:
            shown.append((anchor, title, page.render(f"sections/{anchor}.html", values)))
    return shown, failed


def write_page(page: Page, **values: Any) -> None:
    """Write the skeleton around the chapters; `values`: title, heading, lead, notices, sections."""
    with atomic_path(page.output) as part:
        part.write_text(page.render("page.html", values), encoding="utf-8")


def _data_uri(image: bytes, kind: str) -> str:
    mime = {"svg": "image/svg+xml", "png": "image/png"}[kind]
    return f"data:{mime};base64,{base64.b64encode(image).decode()}"


@functools.cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("dldsim.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    for name in ("number", "fixed", "percent", "counted", "duration", "listing", "text"):
        environment.filters[name] = getattr(formats, name)
    return environment
