"""Files are written whole or not at all; what keeps them from being written is told in words."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FULL = {errno.ENOSPC, errno.EDQUOT}
CLOSED = {errno.EROFS, errno.EACCES, errno.EPERM}


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A part file beside `path` that becomes `path` on success and vanishes on failure."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def why_not_written(error: OSError) -> str | None:
    """What is wrong with the disk or a folder, and the remedy; None for any other error."""
    place = f": {error.filename}" if error.filename else ""
    if error.errno in FULL:
        return (
            f"{os.strerror(error.errno)}{place}. Make room and start the same command again; "
            "what is finished is kept."
        )
    if error.errno in CLOSED:
        return (
            f"{os.strerror(error.errno)}{place}. Make the folder writable for this user "
            "(chown, chmod), or work in another: `snakemake --directory FOLDER …` puts "
            "results/ there."
        )
    return None


def why_not_read(path: Path, error: Exception) -> str | None:
    """What keeps a file from being read that may be good; None if its content is to blame."""
    number = getattr(error, "errno", None)
    if not number or number == errno.EINVAL:  # a position that a truncated file does not have
        return None
    return (
        f"{path} cannot be read: {os.strerror(number)}. The file may be good: look at its "
        "owner and permissions, and at the disk."
    )
