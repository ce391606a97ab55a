"""From a YAML file, its presets and the command line to one configuration."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dldsim.config.configuration import Config
from dldsim.config.explain import did_you_mean, validate
from dldsim.config.feasibility import check_sweep
from dldsim.errors import DldsimError


def merge(base: Mapping, over: Mapping) -> dict:
    """`base` overlaid with `over`: mappings are merged, a null takes the key out, and everything
    else is replaced."""
    merged = dict(base)
    for key, value in over.items():
        if value is None:
            merged.pop(key, None)
            continue
        both = isinstance(merged.get(key), Mapping) and isinstance(value, Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def _typed(value: Any) -> Any:
    """Texts inside a value read as YAML."""
    import yaml

    if isinstance(value, Mapping):
        return {key: _typed(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_typed(entry) for entry in value]
    try:
        return yaml.safe_load(value) if isinstance(value, str) else value
    except yaml.YAMLError:
        return value


def resolve(raw: Mapping, overrides: Mapping | None = None) -> Config:
    """The validated configuration of one campaign.

    `raw` holds shared sections, `presets` and the name of one `preset`. The preset goes over the
    shared sections, and `overrides` (the command line, where numbers may come as text) over both.
    Raises DldsimError with every problem's key, value and allowed values.
    """
    overrides = _typed(overrides or {})
    if not isinstance(raw, Mapping):
        raise DldsimError("The configuration is not a mapping of keys to values. See config.yaml.")
    raw = merge(raw, overrides)
    presets = raw.pop("presets", None) or {}
    if not isinstance(presets, Mapping):
        raise DldsimError("presets must be a mapping of names to partial configurations.")
    name = raw.get("preset", Config.model_fields["preset"].default)
    if presets or "preset" in raw:
        if name not in presets:
            raise DldsimError(
                f"Unknown preset {name!r}.{did_you_mean(name, presets)} "
                f"Presets: {', '.join(presets) or 'none'}."
            )
        raw = merge(merge(raw, presets[name] or {}), overrides)
        raw.pop("presets", None)
        raw["preset"] = name
    config = validate(Config, raw)
    check_sweep(config)
    return config


def read_config(path: Path, overrides: Mapping | None = None) -> Config:
    """The validated configuration in a YAML file."""
    import yaml

    try:
        raw = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise DldsimError(f"Cannot read the configuration {path}: {error.strerror}.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DldsimError(f"The configuration {path} is not valid YAML: {error}") from error
    return resolve(raw, overrides)
