"""Published values and independent computations that the simulator is checked against.

The files lie in dldsim/data/reference; SHA256SUMS lists what each must contain.
"""

import csv
import hashlib
from pathlib import Path

from dldsim.errors import DldsimError

FOLDER = Path(__file__).parents[1] / "data" / "reference"
CHECKSUMS = "SHA256SUMS"
REMEDY = "Install dldsim again, or restore dldsim/data/reference from the repository."


def reference_path(name: str, folder: Path | None = None) -> Path:
    """Path of a reference file whose content is as it was shipped.

    Raises DldsimError if the file is missing, unlisted or altered.
    """
    folder = FOLDER if folder is None else folder
    path = folder / name
    try:
        lines = (folder / CHECKSUMS).read_text(encoding="utf-8").splitlines()
        content = path.read_bytes()
    except OSError as error:
        raise DldsimError(
            f"Reference file {error.filename} cannot be read: {error.strerror}.",
            key=str(error.filename),
            remedy=REMEDY,
        ) from error
    sums = {file: digest for digest, file in (line.split() for line in lines)}
    if name not in sums:
        raise DldsimError(
            f"Reference file {path} is not listed in {CHECKSUMS}.", key=str(path), remedy=REMEDY
        )
    if hashlib.sha256(content).hexdigest() != sums[name]:
        raise DldsimError(
            f"Reference file {path} has been altered: its SHA-256 is not the one in {CHECKSUMS}.",
            key=str(path),
            remedy=REMEDY,
        )
    return path


def read_reference(name: str) -> list[dict]:
    """Rows of a reference table, numbers as numbers; `name` without .csv."""
    with reference_path(f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return [{k: _number(v) for k, v in row.items()} for row in csv.DictReader(stream)]


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
