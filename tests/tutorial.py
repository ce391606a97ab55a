"""Outputs of the commands in docs/tutorial.md, shown as they are.

`python -m tests.tutorial` runs the commands again and writes what they say below them.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "tutorial.md"
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
    """What a command of the page says. Ends with its error, if it has one."""
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


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8"), answer), encoding="utf-8")
