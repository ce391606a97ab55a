"""The design service: `serve`."""

import argparse
from collections.abc import Iterable

from dldsim.app.commands.options import add_command, place, whole
from dldsim.app.commands.output import Display
from dldsim.app.commands.settings import given_by


def serve(args: argparse.Namespace) -> tuple[dict, Iterable[str], int]:
    """The design service, until it is interrupted."""
    from dldsim.app.web import serve as parts
    from dldsim.app.web.api.settings import Settings

    settings = Settings.read(given_by(Settings, args))
    if args.part == "api":
        parts.serve_api(settings)
        return {}, [], 0
    if args.part == "ui":
        parts.serve_page(settings.host, args.page_port, args.api)
    with Display() as progress:
        return {}, [], parts.serve_both(settings, args.page_port, progress)


def add_serve(commands) -> None:
    """The command `serve`."""
    parser = add_command(
        commands,
        "serve",
        serve,
        "the design service: API, page, or both",
        "serve both --results results",
    )
    parser.add_argument("part", choices=["api", "ui", "both"])
    parser.add_argument(
        "--results",
        type=place,
        metavar="DIR",
        help="campaign that answers come from; default: the one that comes with the package",
    )
    parser.add_argument(
        "--config",
        type=place,
        metavar="FILE",
        help="configuration for device, safety distance and verification; "
        "default: ./config.yaml if present, else defaults",
    )
    parser.add_argument(
        "--state",
        type=place,
        metavar="DIR",
        help="folder of queue and results; default: dldsim-web in ~/.local/state",
    )
    parser.add_argument("--host", metavar="ADDRESS", help="default 127.0.0.1")
    parser.add_argument("--port", type=whole, metavar="N", help="of the API; default 8000")
    parser.add_argument(
        "--page-port", type=whole, default=8501, metavar="N", help="default %(default)s"
    )
    parser.add_argument(
        "--api",
        metavar="URL",
        help="API that a page alone asks; default DLDSIM_WEB_API, or http://127.0.0.1:8000",
    )
    parser.add_argument(
        "--workers", type=whole, metavar="N", help="processes that search; default 1"
    )
    parser.add_argument(
        "--verify-workers", type=whole, metavar="N", help="processes that simulate; default 1"
    )
