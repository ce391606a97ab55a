"""From YAML files, their presets and the command line to one configuration."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from dldsim.config.configuration import Config, Partial
from dldsim.config.explain import did_you_mean, validate
from dldsim.config.feasibility import check_campaign
from dldsim.config.yaml_files import parse_yaml, read_yaml
from dldsim.errors import DldsimError


def merge(base: Mapping, over: Mapping) -> dict:
    """`base` overlaid with `over`: mappings are merged, a null takes a key out that is there, and
    everything else is replaced. A null for a key that is not there stays, to be validated."""
    merged = dict(base)
    for key, value in over.items():
        if value is None and key in merged:
            del merged[key]
            continue
        both = isinstance(merged.get(key), Mapping) and isinstance(value, Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def _typed(value: Any) -> Any:
    """Texts inside a value read as YAML; an empty one stays a text."""
    import yaml

    if isinstance(value, Mapping):
        return {key: _typed(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_typed(entry) for entry in value]
    try:
        return parse_yaml(value) if isinstance(value, str) and value else value
    except yaml.YAMLError:
        return value


def resolve(
    raw: Mapping, overrides: Mapping | None = None, *, partial: bool = False
) -> Config | Partial:
    """The validated configuration of one campaign.

    `raw` holds shared sections, `presets` and the name of one `preset`. The preset goes over the
    shared sections, and `overrides` (the command line, where numbers may come as text) over both.
    `partial`: a single command, which needs no sweep; what is left out has its default.
    Raises DldsimError with every problem's key, value and allowed values.
    """
    overrides = _typed(overrides or {})
    if not isinstance(raw, Mapping):
        raise DldsimError(
            "The configuration is not a mapping of keys to values.", value=raw,
            allowed="sections", remedy="See config.yaml.",
        )  # fmt: skip
    for key, value in overrides.items():
        if value is None and key in Config.model_fields:
            raise DldsimError(
                f"{key}: no value is given.", key=key, remedy=f"Give {key} a value or leave it out."
            )
    whole = merge(raw, overrides)
    presets = whole.get("presets")
    _check_presets(presets)
    name = whole.get("preset", Config.model_fields["preset"].default)
    if presets or "preset" in whole:
        known = ", ".join(presets or ()) or "none"
        if not isinstance(name, str) or name not in (presets or {}):
            raise DldsimError(
                f"Unknown preset {name!r}.{did_you_mean(name, presets or ())} Presets: {known}.",
                key="preset", value=name, allowed=known,
            )  # fmt: skip
        whole = merge(merge(raw, presets[name] or {}), overrides) | {"preset": name}
    whole.pop("presets", None)
    if partial:
        return validate(Partial, whole)
    config = validate(Config, whole)
    check_campaign(config)
    return config


def _check_presets(presets: Any) -> None:
    """Refuse presets that are no mapping of names to mappings."""
    if presets is None:
        return
    wrong = None if isinstance(presets, Mapping) else "presets"
    if not wrong:
        wrong = next((f"presets.{name}" for name, preset in presets.items()
                      if not isinstance(preset, Mapping | None)), None)  # fmt: skip
    if wrong:
        value = presets if wrong == "presets" else presets[wrong.partition(".")[2]]
        allowed = "names with partial configurations" if wrong == "presets" else "sections"
        raise DldsimError(key=wrong, value=value, allowed=allowed, remedy="See config.yaml.")


def read_files(paths: Iterable[Path]) -> dict:
    """The values of configuration files, later ones over earlier ones."""
    raw: dict = {}
    for path in paths:
        values = read_yaml(path)
        if not isinstance(values, Mapping):
            raise DldsimError(
                f"The configuration {path} is not a mapping of keys to values.", key=str(path),
                value=values, allowed="sections", remedy="See config.yaml.",
            )  # fmt: skip
        raw = merge(raw, values)
    return raw


def read_config(path: Path, overrides: Mapping | None = None) -> Config:
    """The validated configuration in a YAML file."""
    return resolve(read_files([path]), overrides)


def read_partial(path: Path) -> Partial:
    """The settings in a YAML file that need not hold a whole campaign."""
    return resolve(read_files([path]), partial=True)
