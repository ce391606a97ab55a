"""What the campaign's angles are judged by: pairs on finer lattices, and where the reference lies.

A **pair** is an array and a cell, followed at the campaign's numerics and at finer ones. Critical
gaps, the other half of the study: :mod:`dldsim.evidence.critical_gaps`.

The plan (which pairs, which searches) is read by rule files: nothing heavy is imported at the top.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dldsim.analysis.uncertainty import MODEL, STUDIES, read_model
from dldsim.config.configuration import Config
from dldsim.config.explain import validate
from dldsim.config.identifiers import parse_outcome
from dldsim.config.sections import Numerics
from dldsim.config.study_sections import Domain
from dldsim.errors import DldsimError

Row = Mapping[str, Any]

# ------------------------------------------------------------------------------------------ pairs

CAMPAIGN, DOMAIN, REFERENCE, FINEST = "campaign", "domain", "reference", "finest"
"""Numerics of a pair: the campaign's own, the same in the other domain, those of the reference, the
finest."""
COARSER = {FINEST: REFERENCE}
"""Numerics whose settled cells a pair goes on with. Those of the reference are released, as in the
campaign: the transition distance of what goes on lacks the passes on the way, and is another."""


def pairs(config: Config) -> list[tuple[str, str]]:
    """All simulations of pairs: identifier and name of the numerics, each once.

    None in another domain where that is the campaign's own: there is nothing to compare. Raises
    DldsimError for a domain longer than a pair's period.
    """
    study, names = config.reference, [CAMPAIGN, REFERENCE]
    if study.domain and study.pairs and _is_another(study.domain, config):
        names.insert(1, DOMAIN)
    wanted = [(run, name) for name in names for run in study.pairs]
    return wanted + [(run, FINEST) for run in study.finest]


def _is_another(domain: Domain, config: Config) -> bool:
    least = min(parse_outcome(run).geometry.periodicity for run in config.reference.pairs)
    if domain.rows > least:
        raise DldsimError(
            key="reference.domain.rows",
            value=domain.rows,
            allowed=f"at most {least}, the smallest periodicity N_p of the pairs",
            remedy="A domain repeats after a period: lower it.",
        )
    return validate(Numerics, study_numerics(DOMAIN, config)) != config.numerics


def study_numerics(name: str, config: Config) -> dict[str, Any]:
    """The section `numerics` of a pair, as plain values."""
    study = config.reference
    changed = {
        CAMPAIGN: {},
        DOMAIN: study.domain.model_dump() if study.domain else {},
        REFERENCE: study.numerics.model_dump(),
        FINEST: study.finest_numerics.model_dump(),
    }
    return config.numerics.model_dump(mode="json") | changed[name]


def pair_settings(run: str, name: str, config: Config) -> dict[str, Any]:
    """Everything that one simulation of a pair depends on, as plain values.

    At the campaign's numerics, in its domain and in another one, the cell is released and followed
    as in the campaign; where it goes on with the settled cells of what was simulated before, that
    is among them.
    """
    geometry, stiffness_set = parse_outcome(run)
    study, common = config.reference, common_sections(config)
    if name in (CAMPAIGN, DOMAIN):
        common["run_control"] = config.run_control.model_dump(mode="json")
    else:
        common["run_control"] |= {
            "max_rows": study.rows,
            "outcome_rows_max": study.rows * len(study.releases),
        }
        if name in COARSER:
            common["coarser"] = pair_settings(run, COARSER[name], config)
    return {
        "geometry": geometry.model_dump(mode="json"),
        "stiffness_set": stiffness_set,
        "stiffness": config.stiffness_sets[stiffness_set].model_dump(mode="json"),
        "numerics": study_numerics(name, config),
        **common,
    }


def common_sections(config: Config) -> dict[str, Any]:
    """Sections that all simulations of the study share, released where the reference says."""
    control = config.run_control.model_dump(mode="json")
    return {
        "cell": config.cell.model_dump(mode="json"),
        "flow": config.flow.model_dump(mode="json"),
        "run_control": control | {"release_gap_fractions": config.reference.releases},
    }


# ------------------------------------------------------------------------------------ package data

KEPT = {
    "reference_outcomes": "reference_outcomes",
    "campaign_outcomes": "reference_outcomes",
    "domain_outcomes": "reference_outcomes",
    "critical_gaps": "critical_gaps",
    "convergence": "convergence",
}
"""Tables that come with the package, and their kinds; the first two are needed, the others where
they were made."""
REMEDY = (
    "Make it with `snakemake -j2 reference` and "
    "`python -m dldsim.evidence.reference_study results`."
)


def install(results: Path, studies: Path = STUDIES) -> list[Path]:
    """Copy the tables and the model of a study into the package, into the folder of the shape of
    its cells; returns the files.

    The tables keep the provenance that they carry. Raises DldsimError if outcomes or the model are
    missing, or any table is damaged or of another physics version; then nothing is copied.
    """
    from dldsim.files import atomic_path
    from dldsim.tables.parquet import read_columns

    source = Path(results) / "reference"
    needed = [*KEPT][:2]
    there = [name for name in KEPT if name in needed or (source / f"{name}.parquet").exists()]
    for name in there:
        read_columns(KEPT[name], source / f"{name}.parquet")
    if not (source / MODEL).exists():
        missing = source / MODEL
        raise DldsimError(f"{missing} does not exist.", key=str(missing), remedy=REMEDY)
    data = Path(studies) / read_model(source / MODEL)["conditions"]["cell_shape"]
    written = []
    for name in [*(f"{name}.parquet" for name in there), MODEL]:
        with atomic_path(data / name) as part:
            part.write_bytes((source / name).read_bytes())
        written.append(data / name)
    return written


def reference_outcomes(shape: str, studies: Path = STUDIES) -> list[dict[str, Any]]:
    """The reference that comes with the package for cells of a ``shape``: `reference_outcomes`, one
    per pair, the finest.

    Raises DldsimError if none is there, or one of another physics version.
    """
    from dldsim.tables.parquet import read_rows

    path = Path(studies) / shape / "reference_outcomes.parquet"
    if not path.exists():
        raise DldsimError(
            f"The package holds no reference for cells of shape {shape} ({path}).",
            key=str(path),
            remedy=REMEDY,
        )
    return read_rows("reference_outcomes", path)


def best_rows(rows: Sequence[tuple[str, str, Row]]) -> list[Row]:
    """The finest row of each pair, from (pair, name of the numerics, row)."""
    best: dict[str, tuple[int, Row]] = {}
    for pair, name, row in rows:
        rank = (CAMPAIGN, DOMAIN, REFERENCE, FINEST).index(name)
        if rank > best.get(pair, (1, None))[0]:
            best[pair] = rank, row
    return [row for _, row in best.values()]


def main() -> None:
    """Install the study of the results folder named on the command line."""
    import sys

    sys.stdout.writelines(f"{path}\n" for path in install(Path(sys.argv[1])))


if __name__ == "__main__":
    main()
