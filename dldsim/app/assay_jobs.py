"""Jobs of the assays: points of a calibration and published pairs in, curves out."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from pydantic import TypeAdapter

from dldsim.app.jobs import attempt, empty, failed
from dldsim.config import identifiers
from dldsim.config.assay_sections import Assay, TableAssay
from dldsim.config.assays import Membrane, passages_of
from dldsim.config.provenance import provenance
from dldsim.config.sections import CellShape, Flow, Numerics, Stiffness
from dldsim.experiments.outcome_files import Measured, Progress, write_assay_runs
from dldsim.files import atomic_path
from dldsim.tables.parquet import read_many, write_csv, write_table


def assay_job(
    identifier: str,
    settings: Mapping,
    *,
    rows: Path,
    trajectory: Path,
    crashes: Path,
    progress: Progress,
) -> None:
    """One point of a calibration: `rows` of `assay_runs`, one for each passage, and `trajectory`.

    A passage that fails is a row of status failed; the others count.
    """
    found: list[Measured] = []
    name = identifiers.parse_point(identifier).assay
    for known, simulate in passages_of_point(name, identifier, settings):

        def give_up(reason: str, known=known) -> None:
            nothing = empty("assay_trajectory")
            found.append(Measured(failed("assay_runs", known, reason), nothing))

        attempt(
            identifier,
            lambda simulate=simulate: found.append(simulate(progress)),
            give_up,
            crashes,
            progress,
        )
    write_assay_runs(found, rows, trajectory, settings)


def passages_of_point(
    name: str, identifier: str, settings: Mapping
) -> list[tuple[dict, Callable[[Progress | None], Measured]]]:
    """The passages of a point: what is known of each, and the call that simulates it."""
    from dldsim.experiments.assays import known_of, simulate_passage

    assay = TypeAdapter(Assay).validate_python(settings["assay"])
    given = settings["membrane"]
    membrane = Membrane(**{**given, "stiffness": Stiffness(**given["stiffness"])})
    cell, flow = CellShape(**settings["cell"]), Flow(**settings["flow"])
    about = name, assay, membrane, cell
    parts = []
    for number, passage in enumerate(passages_of(assay, cell.shape)):
        run = f"{identifier}_{number}"
        known = known_of(*about, flow.viscosity_mPa_s, passage, run)

        def simulate(progress: Progress | None, passage=passage, run=run) -> Measured:
            numerics = Numerics(**settings["numerics"])
            return simulate_passage(*about, flow, numerics, passage, run_id=run, progress=progress)

        parts.append((known, simulate))
    return parts


def published(settings: Mapping) -> dict:
    """Published pairs of index and stiffness set, with the moduli of the sets, by assay."""
    sets = {name: Stiffness(**values) for name, values in settings["stiffness_sets"].items()}
    return {name: (TableAssay(**pairs), sets) for name, pairs in settings["published"].items()}


def write_curves(
    kind: str, rows: Iterable[Path], settings: Mapping, *, table: Path, figure: Path | None = None
) -> None:
    """Calibrations from the passages of some points, with a figure of them if one is asked for."""
    from dldsim.analysis.passages import calibrate

    runs = read_many("assay_runs", rows)
    curves = calibrate(runs, settings["default_assay"], published(settings))
    write_table(kind, curves, table, provenance(settings))
    write_csv(kind, table)
    if figure is not None:
        from dldsim.report.assay_figures import draw_curves
        from dldsim.report.style import render

        with atomic_path(Path(figure)) as part:
            part.write_bytes(render(draw_curves(curves), "png"))
