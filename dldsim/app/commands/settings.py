"""Settings of the commands: the configuration file with the command line over it."""

import argparse
import difflib
from pathlib import Path
from typing import Any

from pydantic import create_model

from dldsim.config.sections import Config, Geometry, Section, Sweep, read_config, validate
from dldsim.errors import DldsimError

DEFAULT_CONFIG = Path("config.yaml")


def configuration(path: Path | None) -> Config | None:
    """The configuration file, by default ./config.yaml; None if there is none."""
    if path is None and not DEFAULT_CONFIG.exists():
        return None
    return read_config(path or DEFAULT_CONFIG)


def safety_distance_um(config: Config | None) -> float:
    if config is None:
        return Sweep.model_fields["safety_distance_um"].default
    return config.sweep.safety_distance_um


def given_by(model: type[Section], args: argparse.Namespace) -> dict:
    """The fields of a section that the command line names."""
    values = {key: getattr(args, key, None) for key in model.model_fields}
    return {key: value for key, value in values.items() if value is not None}


def section_of(model: type[Section], config: Config | None, args: argparse.Namespace) -> Any:
    """A section of the configuration with the command line over it."""
    base = {}
    if config is not None:
        [base] = [s.model_dump() for _, s in config if type(s) is model]
    return validate(model, base | given_by(model, args))


def check_field(model: type[Section], key: str, value: Any) -> Any:
    """A value of one field of a section. Raises DldsimError that names it."""
    field = model.model_fields[key]
    one = create_model(model.__name__, __base__=Section, **{key: (field.annotation, field)})
    return getattr(validate(one, {key: value}), key)


def geometry_of(args: argparse.Namespace) -> Geometry:
    return validate(Geometry, given_by(Geometry, args))


def entry_of(config: Config | None, section: str, name: str, option: str) -> Any:
    """An entry of a section by name."""
    if config is None:
        raise DldsimError(
            f"{option} {name}: {section} are read from a configuration file, and there is no "
            "config.yaml here. Name one with --config FILE."
        )
    entries = getattr(config, section)
    if name not in entries:
        close = difflib.get_close_matches(name, entries, n=1)
        hint = f" Did you mean {close[0]}?" if close else ""
        raise DldsimError(
            f"{option} {name}: unknown, {section} has {', '.join(entries)}.{hint}"
        )
    return entries[name]
