"""The tables of a results folder: what is there, and what is not and why."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from dldsim.errors import DldsimError
from dldsim.tables import registry
from dldsim.tables.parquet import describe, read_table

CARD = ("surrogate_card.json", "surrogate")
"""The surrogate's card: file in the results folder, rule that makes it."""
STUDIES = (
    "validation",
    "accuracy",
    "stability",
    "reference_check",
    "spot_check",
    "convergence",
    "calibration_library",
    "assay_study",
)
"""Kinds that are made on request only: they say how far to trust a campaign."""
TABLES = {
    kind: (registry.TABLES[kind].file, registry.TABLES[kind].rule)
    for kind in [
        *(
            kind
            for kind, table in registry.TABLES.items()
            if table.file
            and kind not in (*STUDIES, "critical_gaps", "reference_outcomes", "survey_plan")
        ),
        *STUDIES,
    ]
}
"""Table kind: file in the results folder, rule that makes it."""
BEFORE_OUTCOMES = (
    "outcomes",
    "runs",
    "trajectory",
    "flows",
    "assay_runs",
    "calibration",
    "calibration_correlations",
    *STUDIES,
)
"""Kinds that do not follow from the table of outcomes."""


class Missing(NamedTuple):
    """What a page cannot show, why, and the command that makes it."""

    what: str
    why: str
    command: str


class Inputs(NamedTuple):
    """Tables by kind; what is missing, studies apart; studies not made; files older than the
    outcomes from which they follow."""

    tables: dict[str, pd.DataFrame]
    missing: list[Missing]
    studies: list[str]
    outdated: list[str]


def read_inputs(results: Path) -> Inputs:
    """Every table that can be read, and the reason for every other.

    Raises DldsimError where there is nothing to show.
    """
    results = Path(results)
    tables, missing, studies, outdated = {}, [], [], []
    for kind, (name, rule) in TABLES.items():
        path = results / name
        if not path.exists() and kind in STUDIES:
            studies.append(rule)
            continue
        try:
            if not path.exists():
                raise DldsimError("It does not exist." + _last_words(results / f"logs/{rule}.log"))
            table = read_table(kind, path)
            if kind == "outcomes" and table.empty:
                raise DldsimError("It has no row: check the sweep in config.yaml.")
        except DldsimError as error:
            missing.append(Missing(name, str(error), f"snakemake -j2 {rule}"))
            continue
        tables[kind] = table
        source = results / TABLES["outcomes"][0]
        if (
            kind not in BEFORE_OUTCOMES
            and source.exists()
            and path.stat().st_mtime < source.stat().st_mtime
        ):
            outdated.append(name)
    if not (results / CARD[0]).exists():
        missing.append(
            Missing(
                CARD[0],
                "It does not exist, so errors and domain of the surrogate are not shown.",
                f"snakemake -j2 {CARD[1]}",
            )
        )
    if not any(len(table) for table in tables.values()):
        reasons = "\n".join(f"  {what}: {why}" for what, why, _ in missing)
        raise DldsimError(
            f"{results} has no table with a row, so there is nothing to report. Run "
            f"`snakemake -j2 all`, or name another folder.\n{reasons}"
        )
    return Inputs(tables, missing + _failed_requests(tables), studies, outdated)


def _failed_requests(tables: Mapping[str, pd.DataFrame]) -> list[Missing]:
    """Requests that failed while others were answered."""
    found = []
    parts = {"design_requests": "candidates", "verified_requests": "simulated designs"}
    for kind, what in parts.items():
        if kind in tables:
            failed = tables[kind].query("status == 'failed'")
            found += [
                Missing(
                    f"{what} of the request {row['request']}",
                    row["reason"],
                    f"snakemake -j2 {TABLES[kind][1]}",
                )
                for _, row in failed.iterrows()
            ]
    return found


def _last_words(log: Path) -> str:
    """The end of the log of a job, which is its error if it failed."""
    if not log.exists():
        return ""
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f" The log {log.name} ends: {lines[-1].strip()}" if lines else ""


def settings_of(path: Path) -> dict[str, Any]:
    """The settings that a table was made with, as far as it names them."""
    return (describe(path)["provenance"].get("settings") or {}) if Path(path).exists() else {}
