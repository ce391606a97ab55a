"""From YAML files, their presets and the command line to one configuration."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dldsim.config.configuration import Config, Partial
from dldsim.config.explain import did_you_mean, validate
from dldsim.config.feasibility import check_campaign
from dldsim.config.provenance import flattened
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
    raw: Mapping, overrides: Mapping | None = None, files: Sequence[Mapping] = ()
) -> Config:
    """The validated configuration of one campaign.

    `raw` holds shared sections, `presets` and the name of one `preset`; `files` are further
    configurations that the user names, and `overrides` the command line, where numbers may come as
    text. Later ones win, and so do their names of a preset. Of each the preset in force goes over
    its own shared sections. Raises DldsimError with every problem's key, value and allowed values.
    """
    config = validate(Config, _overlaid(raw, overrides, files))
    check_campaign(config)
    return config


def _overlaid(
    raw: Mapping, overrides: Mapping | None = None, files: Sequence[Mapping] = ()
) -> dict[str, Any]:
    """The settings that all layers make together, as in `resolve`, not validated."""
    overrides = _typed(overrides or {})
    layers = [raw, *files, overrides]
    for layer in layers:
        if not isinstance(layer, Mapping):
            raise DldsimError(
                "The configuration is not a mapping of keys to values.",
                value=layer,
                allowed="sections",
                remedy="See config.yaml.",
            )
        _check_presets(layer.get("presets"))
    empty = {key for key in Config.model_fields if overrides.get(key, "") is None}
    empty |= {"preset" for layer in layers if layer.get("preset", "") is None}
    for key in sorted(empty):
        raise DldsimError(
            f"{key}: no value is given.", key=key, remedy=f"Give {key} a value or leave it out."
        )
    name = preset_of(layers)
    presets = {key: None for layer in layers for key in layer.get("presets") or {}}
    if presets or any("preset" in layer for layer in layers):
        known = ", ".join(presets) or "none"
        if not isinstance(name, str) or name not in presets:
            raise DldsimError(
                f"Unknown preset {name!r}.{did_you_mean(name, presets)} Presets: {known}.",
                key="preset",
                value=name,
                allowed=known,
            )
    whole: dict[str, Any] = {}
    for layer in layers:
        for part in in_force(layer, name):
            whole = merge(whole, part)
    whole["preset"] = name
    return whole


def preset_of(layers: Iterable[Mapping]) -> str:
    """Name of the preset in force: the last that is named."""
    names = [layer["preset"] for layer in layers if layer.get("preset") is not None]
    return names[-1] if names else Config.model_fields["preset"].default


def in_force(layer: Mapping, preset: str) -> list[Mapping]:
    """What one configuration says under this preset: its shared sections, and the preset's."""
    shared = {key: value for key, value in layer.items() if key not in ("preset", "presets")}
    return [shared, (layer.get("presets") or {}).get(preset) or {}]


def origins(layers: Mapping[str, Mapping]) -> str:
    """What the configuration was made of, in a sentence: sources by name, the lowest first."""
    preset = preset_of(layers.values())
    lowest, *others = layers
    sentence = f"Configuration: {lowest}, preset {preset}"
    for name in others:
        keys = dict.fromkeys(
            key for part in in_force(layers[name], preset) for key in flattened(part)
        )
        keys |= {"preset": None} if "preset" in layers[name] else {}
        if keys:
            sentence += f"; over it {name}: {', '.join(keys)}"
    return f"{sentence}."


def _check_presets(presets: Any) -> None:
    """Refuse presets that are no mapping of names to mappings."""
    if presets is None:
        return
    wrong = None if isinstance(presets, Mapping) else "presets"
    if not wrong:
        wrong = next(
            (
                f"presets.{name}"
                for name, preset in presets.items()
                if not isinstance(preset, Mapping | None)
            ),
            None,
        )
    if wrong:
        value = presets if wrong == "presets" else presets[wrong.partition(".")[2]]
        allowed = "names with partial configurations" if wrong == "presets" else "sections"
        raise DldsimError(key=wrong, value=value, allowed=allowed, remedy="See config.yaml.")


def read_layer(path: Path) -> Mapping:
    """What a configuration file holds, not validated."""
    values = read_yaml(path)
    if not isinstance(values, Mapping):
        raise DldsimError(
            f"The configuration {path} is not a mapping of keys to values.",
            key=str(path),
            value=values,
            allowed="sections",
            remedy="See config.yaml.",
        )
    return values


def read_config(path: Path, overrides: Mapping | None = None) -> Config:
    """The validated configuration in a YAML file."""
    return resolve(read_layer(path), overrides)


def read_partial(path: Path) -> Partial:
    """The settings in a YAML file that need not hold a whole campaign: a single command needs no
    sweep, and what is left out has its default."""
    return validate(Partial, _overlaid(read_layer(path)))
