"""What the pages say can be typed, followed and computed."""

import json
import re
import shlex

import pytest
import yaml

from dldsim import __version__
from dldsim.app import cli
from dldsim.tables.parquet import read_table
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


def test_version_is_the_same_everywhere():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    [latest, *_] = re.findall(r"^## (\S+?)(?:,|$)", changes, re.MULTILINE)
    assert cited["version"] == latest == __version__


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
        f"k_s {found['ks_uN_per_m']:.1f} µN/m, between {found['ks_uN_per_m_low']:.1f} and "
        f"{found['ks_uN_per_m_high']:.1f}" in told
    )
    rows = [
        row
        for row in answers["transition"]["rows"]
        if row["cell_shape"] == "sphere" and row["periodicity"] == 5
    ]
    stiffest, softest = (
        "{:.2f} ({:.2f} to {:.2f})".format(
            *(row[f"gap_over_2R{end}"] for end in ("", "_low", "_high"))
        )
        for row in (rows[0], rows[-1])
    )
    assert f"falls from {stiffest} for the stiffest to {softest} for the softest" in told


def test_the_numbers_on_trust_are_those_of_the_packaged_data():
    told = " ".join((ROOT / "docs" / "trust.md").read_text("utf-8").split())
    data = ROOT / "dldsim" / "data"
    outcomes = read_table("outcomes", data / "campaign" / "outcomes.parquet")
    card = json.loads((data / "campaign" / "surrogate_card.json").read_text())
    sigma = json.loads((data / "reference_outcomes" / "biconcave" / "sigma_num.json").read_text())
    shut = outcomes[~outcomes["mode_open"].astype(bool)]["sigma_num_deg"]
    coexisting = (outcomes["status"] == "coexisting").sum()
    by = [card["scores_by_geometry"], *map(card["scores_by_shape"].get, ("biconcave", "sphere"))]
    held = {(m["shape"], m["level"]): m for m in card["conformal"]["measured"]}

    def row(name: str, form: str, key: str) -> str:
        return f"| {name} | " + " | ".join(form.format(s[key]) for s in by) + " |"

    def cover(level: float) -> str:
        cells = (
            f"{100 * m['coverage']:.0f} ± {100 * m['coverage_error']:.0f} %; "
            f"{m['mean_half_width_deg']:.1f}°"
            for m in (held[shape, level] for shape in ("biconcave", "sphere"))
        )
        name = f"{100 * level:.0f} % intervals that held; mean half-width"
        return f"| {name} | | {' | '.join(cells)} |"

    for said in (
        f"Of the {len(outcomes)} outcomes of the packaged campaign {len(shut)} have a mode that is "
        f"not open, with σ_num of {shut.median():.2f}° in the median and {shut.max():.2f}° at most",
        f"these are {coexisting} of {len(outcomes)}",
        f"{coexisting} of {len(outcomes)} outcomes have two motions",
        f"hold {sigma['check']['within_2_sigma']} of the {sigma['check']['pairs']} within 2 σ and "
        f"{sigma['check']['within_1_sigma']} within 1 σ",
        f"{sigma['distance']['bump lane']['rms']:.3f} row shifts in the bump lane and "
        f"{sigma['distance']['no bump lane']['rms']:.3f} outside",
        f"{100 * sigma['share']['rms']:.1f} % of the bump angle",
        row("R²", "{:.2f}", "r2"),
        row("median error", "{:.2f}°", "median_absolute_error_deg"),
        row("root mean square error", "{:.2f}°", "rmse_deg"),
        cover(0.9),
        cover(0.68),
    ):
        assert said in told
