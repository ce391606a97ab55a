"""What the pages say can be typed, followed and computed."""

import json
import re
import shlex

import pytest

from dldsim.app import cli
from tests.pages import ROOT, renewed

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
LINK = re.compile(r"\]\(([^)#\s]+)[^)]*\)")
COMMAND = "python -m dldsim "


def commands(text: str) -> list[list[str]]:
    """Words of each command of the package that stands in a block; a pipe ends it."""
    joined = re.sub(r"\\\n\s*", "", text)
    found = re.findall(rf"^ {{4,}}(?:\$ )?{COMMAND}(.*)$", joined, re.MULTILINE)
    return [
        shlex.split(words.partition(" | ")[0], comments=True) for words in found if "…" not in words
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    links = [link for link in LINK.findall(page.read_text("utf-8")) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_have_their_options(page):
    for words in commands(page.read_text("utf-8")):
        cli.make_parser().parse_args(words)


def test_commands_are_found_in_blocks():
    text = "    $ python -m dldsim info \\\n        a.parquet  # what\n`python -m dldsim none`\n"
    assert commands(text) == [["info", "a.parquet"]]
    assert sum(len(commands(page.read_text("utf-8"))) for page in PAGES) > 20


def test_answers_take_the_place_of_older_ones():
    text = "Say\n\n    $ one\n    old\n\n    older\n\n    $ two\n\nand\n\n    kept\n"
    new = renewed(text, lambda command: f"new {command}\n\nend\n")
    assert new == (
        "Say\n\n    $ one\n    new one\n\n    end\n\n    $ two\n    new two\n\n    end\n\n"
        "and\n\n    kept\n"
    )
    assert renewed(new, lambda command: f"new {command}\n\nend\n") == new


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """What the commands of the README's three questions answer, by command."""
    text = (ROOT / "README.md").read_text("utf-8").partition("## Three questions")[2]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("questions"))
        return {words[0]: _answer(words) for words in commands(text)}


def _answer(words: list[str]) -> dict:
    import contextlib
    import io

    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert cli.main([*words, "--json"]) == 0
    return json.loads(said.getvalue())


@pytest.mark.slow
def test_the_answers_in_the_readme_are_those_of_its_commands(answers):
    told = " ".join((ROOT / "README.md").read_text("utf-8").split())
    best = answers["design"]["designs"][0]
    assert (
        f"P_r {best['pillar_radius_um']:.2f}, P_g {best['gap_um']:.2f} µm, N_p "
        f"{best['periodicity']} parts them by {best['separation_deg']:.1f} ± "
        f"{best['uncertainty_deg']:.1f}°" in told
    )
    found = answers["stiffness"]
    assert (
        f"k_s {found['ks_uN_per_m']:.1f} µN/m, between {found['ks_uN_per_m_low']:.1f} (the softest "
        f"calibrated) and {found['ks_uN_per_m_high']:.1f}" in told
    )
    rows = [
        row
        for row in answers["transition"]["rows"]
        if row["cell_shape"] == "sphere" and row["periodicity"] == 6
    ]
    stiffest, softest = (
        "{:.2f} ({:.2f} to {:.2f})".format(*(row[n] / 2 for n in ("gap", "gap_low", "gap_high")))
        for row in (rows[0], rows[-1])
    )
    assert f"falls from {stiffest} for the stiffest to {softest} for the softest" in told
