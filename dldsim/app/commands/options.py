"""Options of the commands, from the sections of the configuration, and their kinds."""

import argparse
import math
import re
import types
import typing
from collections.abc import Callable, Iterable
from pathlib import Path

from dldsim.config.configuration import SEED_MAX, Config
from dldsim.config.explain import check_value
from dldsim.config.sections import Geometry, Section
from dldsim.errors import DldsimError

UNITS = {"_um": "µm", "_mm_s": "mm/s", "_mPa_s": "mPa·s", "_nN_s_per_m": "nN·s/m", "_pg": "pg"}
"""Unit suffixes of option names."""


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong without the whole usage, and guesses at no option."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, allow_abbrev=False, **kwargs)

    def error(self, message: str):
        self.exit(2, f"{self.prog}: {message}\nSee {self.prog} --help\n")


def add_command(
    commands, name: str, function: Callable, purpose: str, example: str
) -> argparse.ArgumentParser:
    """The parser of a command that ``function`` carries out."""
    parser = commands.add_parser(
        name,
        help=purpose,
        description=f"{purpose.capitalize()}.",
        epilog=f"example: python -m dldsim {example}",
    )
    parser.set_defaults(command=function, name=name)
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the summary as one JSON object; keys are column names",
    )
    return parser


def option_of(key: str) -> str:
    return "--" + key.replace("_", "-")


def add_geometry(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("geometry")
    for key in Geometry.model_fields:
        add_option(group, Geometry, key, required=True)


def add_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config",
        type=place,
        metavar="FILE",
        help="configuration that the options go over; default: ./config.yaml if "
        "present, else the defaults above",
    )


def add_seed(parser: argparse.ArgumentParser) -> None:
    default = Config.model_fields["seed"].default
    parser.add_argument(
        "--seed",
        type=seed,
        metavar="N",
        help=f"of everything random; default: the configuration's, or {default}",
    )


def add_fields(
    parser: argparse.ArgumentParser, title: str, model: type[Section], without: Iterable[str] = ()
) -> None:
    group = parser.add_argument_group(title)
    for key in [key for key in model.model_fields if key not in without]:
        add_option(group, model, key, "--cell-shape" if key == "shape" else None)


def add_option(
    parser, model: type[Section], key: str, option: str | None = None, required: bool = False
) -> None:
    """An option for one field of a section, with its unit, choices, meaning, range and default."""
    field = model.model_fields[key]
    kind, choices, unit = field.annotation, None, None
    if typing.get_origin(kind) in (typing.Union, types.UnionType):  # with None for "not given"
        [kind] = (part for part in typing.get_args(kind) if part is not type(None))
    bounds = list(field.metadata)
    if typing.get_origin(kind) is typing.Annotated:
        kind, *extra = typing.get_args(kind)
        bounds += [m for info in extra for m in getattr(info, "metadata", ())]
    if typing.get_origin(kind) is typing.Literal:
        choices = typing.get_args(kind)
        kind = type(choices[0])
    else:
        unit = next(
            (text for end, text in UNITS.items() if key.endswith(end)), "N" if kind is int else "X"
        )
    signs = {"gt": "> ", "ge": "≥ ", "lt": "< ", "le": "≤ "}
    limits = [
        f"{sign}{getattr(m, name):g}"
        for m in bounds
        for name, sign in signs.items()
        if getattr(m, name, None) is not None
    ]
    about = f"{field.description} ({', '.join(limits)})" if limits else field.description
    if not (required or field.is_required()) and "default" not in about:
        default = str(field.default).lower() if kind is bool else field.default
        about += f"; default {'none' if field.default is None else default}"
    if kind is bool:
        unit = "true|false"
    parser.add_argument(
        option or option_of(key),
        dest=key,
        type={float: number, int: whole, bool: truth}.get(kind, kind),
        choices=choices,
        required=required,
        metavar=unit,
        help=about.replace("%", "%%"),
    )


TRUTHS = {"true": True, "yes": True, "false": False, "no": False}


def truth(text: str) -> bool:
    """True or false of the command line."""
    if text.lower() not in TRUTHS:
        raise argparse.ArgumentTypeError(f"{text!r} is neither true nor false")
    return TRUTHS[text.lower()]


def whole(text: str) -> int:
    """A whole number of the command line, in plain digits."""
    if not re.fullmatch(r"[+-]?[0-9]+", text.strip()):
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number")
    return int(text)


def number(text: str) -> float:
    """A finite number of the command line, in plain digits."""
    try:
        value = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is no finite number")
    return value


def place(text: str) -> Path:
    """A file or a folder of the command line; an empty one, such as of a variable that is not set,
    is none."""
    if not text.strip():
        raise argparse.ArgumentTypeError("it is empty: name a file or a folder")
    return Path(text)


def seed(text: str) -> int:
    """A seed of the command line."""
    try:
        return check_value(Config, "seed", whole(text))
    except (argparse.ArgumentTypeError, DldsimError):
        raise argparse.ArgumentTypeError(
            f"{text!r}: a seed is a whole number from 0 to {SEED_MAX}"
        ) from None
