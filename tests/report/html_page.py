"""A page of the report, as tests read it."""

import re
from html.parser import HTMLParser
from pathlib import Path


class Page(HTMLParser):
    """Links, image sources, tables (rows of cell texts) and the text of a report."""

    def __init__(self, path: Path):
        super().__init__()
        self.links, self.sources, self.tags, self.rows, self.words = [], [], set(), [], []
        self.in_cell = False
        self.path, self.raw = path, path.read_text(encoding="utf-8")
        self.feed(self.raw)
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.tags.add(tag)
        if "href" in attrs:
            self.links.append(attrs["href"])
        if "src" in attrs:
            self.sources.append(attrs["src"])
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self.in_cell = True

    def handle_endtag(self, tag):
        self.in_cell = self.in_cell and tag not in ("td", "th")

    def handle_data(self, data):
        if self.lasttag != "style":
            self.words.append(data)
        if self.in_cell:
            self.rows[-1][-1] += data

    def row(self, first: str) -> list[str]:
        """The first table row that begins with this cell."""
        return next([cell.strip() for cell in row] for row in self.rows if row[0] == first)


def rules_of(selector, text):
    """Declarations of a selector in a part of a style sheet."""
    return " ".join(
        body
        for names, body in re.findall(r"([^{}]+)\{([^{}]*)\}", text)
        if selector in [name.strip() for name in names.split(",")]
    )
