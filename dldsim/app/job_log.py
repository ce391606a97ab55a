"""Where a job's sentences and its errors go."""

import contextlib
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import Progress
from dldsim.files import why_not_written


@contextlib.contextmanager
def job_log(path: Path) -> Iterator[Progress]:
    """Send everything printed to a log file.

    What the user can mend (a DldsimError, a full disk, a folder that is closed) and an interruption
    end the job without a traceback.
    """
    console = sys.stderr
    try:
        with _logged(Path(path)) as progress:
            yield progress
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None
    except DldsimError as error:
        console.write(f"{error}\n")
        raise SystemExit(1) from None
    except OSError as error:
        if (reason := why_not_written(error)) is None:
            raise
        console.write(f"{reason}\n")
        raise SystemExit(1) from None


INTERRUPTED = 130
"""Exit code of a process that Ctrl-C has ended."""


@contextlib.contextmanager
def _logged(path: Path) -> Iterator[Progress]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with (
        path.open("w", encoding="utf-8", buffering=1) as log,
        contextlib.redirect_stdout(log),
        contextlib.redirect_stderr(log),
    ):
        try:
            yield _writer(log)
        except KeyboardInterrupt:
            log.write("interrupted\n")
            raise
        except DldsimError as error:
            log.write(f"{error}\n")
            raise
        except Exception as error:
            reason = why_not_written(error) if isinstance(error, OSError) else None
            log.write(f"{reason}\n" if reason else traceback.format_exc())
            raise


def _writer(log: TextIO) -> Progress:
    start = time.perf_counter()

    def progress(sentence: str) -> None:
        log.write(f"{time.perf_counter() - start:8.1f} s  {sentence}\n")

    return progress
