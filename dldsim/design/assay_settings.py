"""What the assays of a calibration were made with, and a configuration that says otherwise."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from dldsim.analysis.calibration import MODULI, default_curves
from dldsim.config.assay_sections import CIRCULARITY, Assay, ChannelAssay, TableAssay
from dldsim.config.configuration import Partial
from dldsim.config.identifiers import parse_point
from dldsim.config.provenance import flattened
from dldsim.errors import DldsimError
from dldsim.tables.parquet import describe
from dldsim.tables.user_values import as_keys

KEPT = "assays.json"
"""File of the settings of the assays, of the campaign that comes with the package."""
NOT_MEASURED = ("cells", "between", "label", "indices", "flow_rate_nl_per_s")
"""Settings of an assay that say of what there is an index, or that are compared by themselves."""


def read_made(directory: Path) -> dict[str, dict[str, Any]]:
    """Settings of each assay of a campaign, with its channel and viscosity in place: of the file
    KEPT, else of the passages in the campaign's folder; empty where there is neither."""
    directory = Path(directory)
    if (kept := directory / KEPT).exists():
        try:
            return json.loads(kept.read_text(encoding="utf-8"))
        except ValueError as error:
            raise DldsimError(
                f"{kept} is damaged: {str(error):.200}.",
                key=str(kept),
                remedy="Copy it anew from the campaign or the package, or delete it.",
            ) from error
    found: dict[str, dict[str, Any]] = {}
    for path in sorted((directory / "assays").glob("*.runs.parquet")):
        name = parse_point(path.name.removesuffix(".runs.parquet")).assay
        if name not in found:
            made = describe(path)["provenance"]["settings"]
            found[name] = made["assay"] | {"viscosity_mPa_s": made["flow"]["viscosity_mPa_s"]}
    return found


def check_assays(
    settings: Partial,
    calibration: pd.DataFrame | None,
    made: Mapping[str, Mapping[str, Any]],
    assay: str | None,
    membranes: bool = True,
) -> None:
    """Refuse a configuration whose assay differs from the one that a calibration was made with.

    ``made``: of `read_made`; without it, what the calibration tells is compared: kind, stress,
    velocity, viscosity and published indices. ``assay``: the one that is asked by; None: the
    calibration's default. ``membranes``: compare constriction groups, too. Compared are the
    settings that the configuration names. Raises DldsimError with assay, key and both values.
    """
    if calibration is None or not len(calibration):
        return
    by = assay or str(default_curves(calibration)["assay"].iloc[0])
    name = by.removesuffix(CIRCULARITY)
    wanted = settings.assays.get(name)
    rows = calibration[calibration["assay"] == by]
    if not len(rows):
        return
    known = _told(rows) | flattened(made.get(name, {}))
    if "flow_rate_nl_per_s" in known and (told := known.pop("flow_rate_nl_per_s")) is not None:
        known["velocity_mm_s"] = 1e3 * told / (known["width_um"] * known["height_um"])
    slit = known.get("kind") == "constriction"
    named = [] if wanted is None else _named(name, wanted, settings)
    named += _of_slit(settings) if slit and getattr(wanted, "channel", None) is None else []
    if (
        membranes
        and slit
        and known.get("groups", wanted is None or getattr(wanted, "groups", False))
    ):
        own = known.get("velocity_mm_s") is None or isinstance(known["velocity_mm_s"], str)
        known |= _told_of_groups(rows, own)
        named += _of_groups(settings)
    for path, key, value in named:
        if key in known and not _same(value, known[key]):
            raise DldsimError(
                f"{path} = {value} in the configuration, but the calibration by which indices of "
                f"assay {by} are read was made with {known[key]}.",
                key=path,
                value=value,
                allowed=str(known[key]),
                remedy=_remedy(wanted, name),
            )


def _same(value: Any, other: Any) -> bool:
    if isinstance(value, float) and isinstance(other, int | float):
        return math.isclose(value, other, rel_tol=1e-6)
    if isinstance(value, Mapping) and isinstance(other, Mapping):
        return all(key in other and _same(value[key], other[key]) for key in value)
    return bool(value == other)


def _remedy(wanted: Assay | None, name: str) -> str:
    if isinstance(wanted, TableAssay):
        return "Name the assay otherwise, or take it out of the configuration."
    return (
        f"Measure it as it is meant: python -m dldsim calibrate --assay {name}; its curve gives "
        f"k_s (python -m dldsim stiffness --calibration calibration-{name}/calibration.parquet), "
        "to be named instead of the index. Or take the setting out of the configuration."
    )


def _told(rows: pd.DataFrame) -> dict[str, Any]:
    """What the rows of an assay in a calibration tell of its settings."""
    columns = {"kind": "kind", "shear_stress_Pa": "stress_Pa", "viscosity_mPa_s": "viscosity_mPa_s"}
    known = {
        key: rows[column].iloc[0]
        for column, key in columns.items()
        if column in rows and rows[column].notna().all() and rows[column].nunique() == 1
    }
    if "velocity_mm_s" in rows and rows["velocity_mm_s"].notna().all():
        velocities = rows["velocity_mm_s"].unique()
        several = ", ".join(f"{v:g}" for v in velocities)
        known["velocity_mm_s"] = float(velocities[0]) if len(velocities) == 1 else several
    names = as_keys(rows["stiffness_set"])
    if known.get("kind") == "table":
        known["indices"] = dict(zip(names, rows["deformation_index"].astype(float), strict=True))
        known["error"] = rows["deformation_index_std"].fillna(0.0).iloc[0]
    return {key: value.item() if hasattr(value, "item") else value for key, value in known.items()}


def _named(name: str, assay: Assay, settings: Partial) -> list[tuple[str, str, Any]]:
    """What a configuration names of an assay: path there, key as in `read_made`, and value."""
    at = f"assays.{name}."
    given = assay.model_dump(mode="json", exclude_unset=True, exclude=set(NOT_MEASURED))
    found = [(at + k, k, value) for k, value in flattened(given).items() if value is not None]
    if isinstance(assay, TableAssay):
        found.append((f"{at}indices", "indices", assay.indices))
    if isinstance(assay, ChannelAssay) and assay.flow_rate_nl_per_s is not None:
        found.append((f"{at}flow_rate_nl_per_s", "velocity_mm_s", assay.mean_velocity_mm_s))
    return sorted(found, key=lambda one: one[1] != "kind")


def _of_slit(settings: Partial) -> list[tuple[str, str, Any]]:
    """The same of the section `constriction`, the channel of assays that have none of their own."""
    own = settings.constriction.model_dump(mode="json", exclude_unset=True)
    return [(f"constriction.{key}", f"channel.{key}", value) for key, value in own.items()]


def _of_groups(settings: Partial) -> list[tuple[str, str, Any]]:
    """The same of the section `constriction_groups`, the membranes of assays with groups."""
    return [
        (f"constriction_groups.{key}", f"groups.{key}", value)
        for key, value in flattened(
            {n: g.model_dump(exclude_unset=True) for n, g in settings.constriction_groups.items()}
        ).items()
    ]


def _told_of_groups(rows: pd.DataFrame, own_velocity: bool) -> dict[str, Any]:
    """What the rows of an assay tell of its groups."""
    columns = {f"stiffness.{name}": name for name in MODULI}
    if own_velocity:
        columns["velocity_mm_s"] = "velocity_mm_s"
    return {
        f"groups.{row['group']}.{key}": float(row[column])
        for _, row in rows.iterrows()
        for key, column in columns.items()
        if pd.notna(row[column])
    }
