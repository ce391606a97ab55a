"""Commands for one-off use: simulations, tables, designs, validation, the service.

Summaries go to standard output, as text or as one JSON object; all else goes to standard error.
Keys of the summaries are the tables' column names.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence

from dldsim import __version__
from dldsim.app.commands.calibration import add_calibrate
from dldsim.app.commands.design import add_design
from dldsim.app.commands.options import Parser
from dldsim.app.commands.outcome import add_outcome
from dldsim.app.commands.output import make_printable, plain_value
from dldsim.app.commands.service import add_serve
from dldsim.app.commands.simulation import add_constrict, add_flow, add_run
from dldsim.app.commands.tables import add_anova, add_info, add_stiffness, add_transition
from dldsim.app.commands.validation import add_validate
from dldsim.errors import DldsimError


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code.

    0; 1 (a validation case fails); 2 (bad input); 130 (interrupted).
    """
    make_printable(sys.stdout, sys.stderr)
    args = make_parser().parse_args(argv)
    try:
        summary, lines, *code = args.command(args)
    except DldsimError as error:
        sys.stderr.write(f"dldsim {args.name}: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write(
            f"\ndldsim {args.name}: interrupted. What was being written is gone, files that were "
            "complete before are untouched.\n"
        )
        return 130
    if args.json:
        lines = [json.dumps(summary, default=plain_value, allow_nan=False)]
    try:
        sys.stdout.writelines(f"{line}\n" for line in lines)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code[0] if code else 0


def make_parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="python -m dldsim",
        description="Deformable cells in deterministic lateral displacement arrays. A whole "
        "campaign is run by: snakemake -j2 all",
    )
    parser.add_argument("--version", action="version", version=f"dldsim {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for add in (
        add_run,
        add_flow,
        add_constrict,
        add_calibrate,
        add_anova,
        add_stiffness,
        add_transition,
        add_design,
        add_outcome,
        add_validate,
        add_serve,
        add_info,
    ):
        add(commands)
    return parser
