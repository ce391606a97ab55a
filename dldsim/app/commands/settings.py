"""Settings of the commands: the configuration file with the command line over it."""

import argparse
import difflib
from pathlib import Path
from typing import Any

from dldsim.app.commands.options import option_of
from dldsim.config import limits
from dldsim.config.configuration import Partial, Sweep
from dldsim.config.explain import validate
from dldsim.config.presets import read_partial
from dldsim.config.sections import Geometry, Section
from dldsim.errors import DldsimError

DEFAULT_CONFIG = Path("config.yaml")


def configuration(path: Path | None) -> Partial | None:
    """The configuration file, by default ./config.yaml; None if there is none."""
    if path is None and not DEFAULT_CONFIG.exists():
        return None
    config = read_partial(path or DEFAULT_CONFIG)
    limits.enforce(config.limits)
    return config


def safety_distance_um(config: Partial | None) -> float:
    if config is None or config.sweep is None:
        return Sweep.model_fields["safety_distance_um"].default
    return config.sweep.safety_distance_um


def seed_of(config: Partial | None, args: argparse.Namespace) -> int:
    """The seed of the command line, else the configuration's, else the default."""
    if args.seed is not None:
        return args.seed
    return Partial.model_fields["seed"].default if config is None else config.seed


def given_by(model: type[Section], args: argparse.Namespace) -> dict:
    """The fields of a section that the command line names."""
    values = {key: getattr(args, key, None) for key in model.model_fields}
    return {key: value for key, value in values.items() if value is not None}


def refuse_idle(args: argparse.Namespace, why: str, *keys: str) -> None:
    """Refuse options that change nothing: ``why`` not. Raises DldsimError."""
    for key in keys:
        if (value := getattr(args, key)) is not None:
            raise DldsimError(
                f"{option_of(key)} {value:g} has no effect {why}.",
                key=option_of(key),
                value=value,
                remedy="Leave it out.",
            )


def section_of(model: type[Section], config: Partial | None, args: argparse.Namespace) -> Any:
    """A section of the configuration with the command line over it."""
    base = {}
    if config is not None:
        [base] = [s.model_dump() for _, s in config if type(s) is model]
    return validate(model, base | given_by(model, args))


def geometry_of(args: argparse.Namespace) -> Geometry:
    return validate(Geometry, given_by(Geometry, args))


def entry_of(config: Partial | None, section: str, name: str, option: str) -> Any:
    """An entry of a section by name."""
    if config is None:
        raise DldsimError(
            f"{option} {name}: {section} are read from a configuration file, and there is no "
            "config.yaml here. Name one with --config FILE."
        )
    entries = getattr(config, section)
    if not entries:
        raise DldsimError(
            f"{option} {name}: the configuration has no {section}.",
            key=section,
            allowed="entries by name",
            remedy="Add them, or name another file with --config FILE.",
        )
    if name not in entries:
        close = difflib.get_close_matches(name, entries, n=1)
        hint = f" Did you mean {close[0]}?" if close else ""
        raise DldsimError(f"{option} {name}: unknown, {section} has {', '.join(entries)}.{hint}")
    return entries[name]
