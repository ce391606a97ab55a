"""What a file was made with: hashes of settings, seeds, versions."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dldsim import PHYSICS_VERSION, __version__
from dldsim.errors import DldsimError
from dldsim.files import atomic_path


def derive_seed(seed: int, name: str) -> int:
    """A seed for one named task of a campaign, below 2³¹."""
    digest = hashlib.sha256(f"{seed}/{name}".encode()).digest()
    return int.from_bytes(digest[:4], "big") >> 1


def settings_hash(settings: Mapping[str, Any]) -> str:
    """Short hash of the settings that a file depends on."""
    text = json.dumps(settings, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def provenance(settings: Mapping[str, Any], seed: int | None = None) -> dict:
    """Metadata of a file that depends on these settings and this seed."""
    settings = dict(settings)
    return {"config_hash": settings_hash(settings), "seed": seed, "settings": settings}


def flattened(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Values by dotted key."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping) and value:
            flat |= flattened(value, f"{above}{key}.")
        else:
            flat[f"{above}{key}"] = value
    return flat


STAMP = ".dldsim.json"


def stamp() -> dict:
    """Versions that a results folder is stamped with."""
    return {"dldsim_version": __version__, "physics_version": PHYSICS_VERSION}


def write_stamp(directory: Path) -> None:
    """Stamp a results folder with the versions that fill it."""
    with atomic_path(Path(directory) / STAMP) as part:
        part.write_text(json.dumps(stamp()) + "\n", encoding="utf-8")


def check_stamp(directory: Path) -> None:
    """Refuse a results folder of another physics version."""
    path = Path(directory) / STAMP
    if not path.exists():
        return
    try:
        made_by = json.loads(path.read_text(encoding="utf-8"))
        physics, version = made_by["physics_version"], made_by["dldsim_version"]
    except (ValueError, KeyError, TypeError) as error:
        raise DldsimError(
            f"{path} is damaged, so that the physics version of what lies in {directory}/ is not "
            "known.",
            key=str(path),
            allowed=str(PHYSICS_VERSION),
            remedy=f"If it is this one ({PHYSICS_VERSION}), delete {path} alone, and all results "
            f"are used. Otherwise: mv {directory} {directory}-old.",
        ) from error
    if physics != PHYSICS_VERSION:
        raise DldsimError(
            f"{directory} holds results of physics version {physics} (dldsim {version}); this is "
            f"version {PHYSICS_VERSION} (dldsim {__version__}), whose results differ.",
            key=str(path),
            value=physics,
            allowed=str(PHYSICS_VERSION),
            remedy=f"To keep the old results: mv {directory} {directory}-physics{physics}. To make "
            "everything anew in place: snakemake -j2 all --forceall.",
        )
