"""What the pages show of the package's own data: outputs of commands, and figures.

`python -m tests.pages` runs the commands that stand behind a "$" again, writes what they say below
them, and draws the figures.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = (DOCS / "tutorial.md", DOCS / "source.md")
INDENT = "    "
PROMPT = f"{INDENT}$ "


def renewed(text: str, run: Callable[[str], str]) -> str:
    """The text with what `run` answers below each command; what stood there is gone."""
    lines, inside = [], False
    for line in text.splitlines():
        inside = line.startswith(PROMPT) or (inside and (line.startswith(INDENT) or not line))
        if line.startswith(PROMPT):
            answer = run(line.removeprefix(PROMPT)).rstrip().splitlines()
            lines += [line, *((INDENT + said).rstrip() for said in answer), ""]
        elif not inside:
            lines.append(line)
    return "\n".join(lines) + "\n"


def answer(command: str) -> str:
    """What a command of a page says. Ends with its error, if it has one."""
    sys.stderr.write(f"{command}\n")
    folder = Path(sys.executable).parent
    return subprocess.run(
        ["bash", "-c", f"set -eo pipefail; {command}"],
        cwd=ROOT,
        env={**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    ).stdout


def draw() -> None:
    """Figures of the packaged campaign that the pages show."""
    from dldsim.analysis.anova import analyse
    from dldsim.analysis.robustness import robustness
    from dldsim.analysis.surrogate import LEVEL, load
    from dldsim.analysis.transition import transition_map
    from dldsim.config.provenance import derive_seed
    from dldsim.design.finished_campaign import packaged_campaign
    from dldsim.files import atomic_path
    from dldsim.report import angle_figures, statistics_figures, transition_figures
    from dldsim.report.style import render
    from dldsim.tables.parquet import read_table

    folder = packaged_campaign()
    outcomes = read_table("outcomes", folder / "outcomes.parquet")
    surrogate = load(folder / "surrogate.json", folder / "surrogate_card.json")
    effects, _ = analyse(outcomes, derive_seed(1, "anova"))
    for name, figure in {
        "angle_density": angle_figures.draw_density(outcomes),
        "angle_boxes": angle_figures.draw_boxes(outcomes),
        "anova_effects": statistics_figures.draw_effects(effects),
        "robustness": statistics_figures.draw_robustness(robustness(outcomes)),
        "transition": transition_figures.draw_transition(transition_map(surrogate), LEVEL),
    }.items():
        with atomic_path(DOCS / "images" / f"{name}.png") as part:
            part.write_bytes(render(figure, "png"))


if __name__ == "__main__":
    draw()
    for page in PAGES:
        page.write_text(renewed(page.read_text(encoding="utf-8"), answer), encoding="utf-8")
