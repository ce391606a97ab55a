"""Jobs of the reference study and of the spot check: settings and tables in, tables out.

An outcome that takes hours loses at most the release under way when it is interrupted: finished
releases wait in a folder until it is written. A program failure ends the job; unlike in a campaign
nothing stands in for its result.

At the finest numerics and in the spot check a cell of one motion, far from the transition, goes on
from where the coarser run has left it, and that run stands for all places of release
(`array_outcome.simulate_outcome`): the column `start`. Points of a search for a critical gap are
released: no coarser run was made at their gaps, and near the transition no place stands for
another.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dldsim.analysis import uncertainty
from dldsim.config.configuration import sections_from
from dldsim.config.identifiers import Pair, outcome_id, parse_outcome
from dldsim.config.provenance import provenance
from dldsim.config.sections import CellShape, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.errors import DldsimError
from dldsim.evidence import critical_gaps, reference_study, spot_check
from dldsim.evidence.convergence import convergence_table
from dldsim.evidence.reference_study import CAMPAIGN, DOMAIN, Row
from dldsim.experiments.outcome_files import NOT_JOINED, Partial, Progress
from dldsim.files import atomic_path
from dldsim.tables.parquet import read_rows, write_csv, write_table

Simulator = Callable[[str, Geometry, str, Mapping[str, Any]], Row]
"""Row of `reference_outcomes` of an identifier, array, stiffness set, and settings by section."""


def simulator(
    partial: Path, progress: Progress, *, coarser: Path | None = None, cells: Path | None = None
) -> Simulator:
    """A Simulator that keeps finished releases under ``partial`` while it is at work.

    ``coarser``: file of settled cells that it goes on with; ``cells``: file for those that it comes
    to.
    """

    def simulate(identifier, geometry, stiffness_set, settings):
        from dldsim.experiments.array_outcome import simulate_outcome
        from dldsim.experiments.settled import load, save

        control = RunControl(**settings["run_control"])
        kept = Partial(Path(partial) / identifier, identifier, settings)
        result = simulate_outcome(
            geometry,
            Stiffness(**settings["stiffness"]),
            CellShape(**settings["cell"]),
            Flow(**settings["flow"]),
            Numerics(**settings["numerics"]),
            control,
            outcome_id=identifier,
            stiffness_set=stiffness_set,
            keep=kept.keep,
            finished=kept.finished(control.release_gap_fractions),
            starts=load(coarser) if coarser else {},
            progress=progress,
        )
        if cells:
            save(result.settled, cells)
        kept.remove()
        return {**NOT_JOINED, **result.row, "start": result.start}

    return simulate


def outcome_job(identifier: str, settings: Mapping, *, row: Path, simulate: Simulator) -> None:
    """One outcome of a pair or of the spot check, its row of `reference_outcomes`."""
    geometry, stiffness_set = parse_outcome(identifier)
    found = simulate(identifier, geometry, stiffness_set, settings)
    write_table("reference_outcomes", [found], row, provenance(settings))


def point_job(
    identifier: str,
    settings: Mapping,
    *,
    before: Path | None,
    start: Path | None,
    table: Path,
    simulate: Simulator,
) -> None:
    """The next point of a search: `critical_gap_points` so far in, one more out.

    ``before``: points so far, None for the first. ``start``: points of the search at the campaign's
    numerics, None for that search itself.
    """
    search = critical_gaps.parse_search(identifier)

    def simulate_array(geometry: Geometry, numerics: Mapping[str, Any]) -> Row:
        name = outcome_id(Pair(geometry, search.stiffness_set))
        return simulate(name, geometry, search.stiffness_set, {**settings, "numerics": numerics})

    points = critical_gaps.advance(
        search,
        read_rows("critical_gap_points", before) if before else [],
        settings,
        simulate_array,
        critical_gaps.start_from(read_rows("critical_gap_points", start)) if start else None,
    )
    write_table("critical_gap_points", points, table, provenance(settings))


def gather_gaps(
    searches: Iterable[tuple[str, Path]], settings: Mapping, *, gaps: Path, convergence: Path
) -> None:
    """`critical_gaps` and `convergence` from searches (identifier, file of their last point)."""
    config, rows = sections_from(settings), []
    for identifier, path in searches:
        search = critical_gaps.parse_search(identifier)
        points = read_rows("critical_gap_points", path)
        rows.append(
            critical_gaps.result(search, points, critical_gaps.search_settings(search, config))
        )
    _write("critical_gaps", rows, gaps, settings)
    _write("convergence", convergence_table(rows, config), convergence, settings)


def gather_pairs(
    rows: Sequence[tuple[str, str, Path]],
    settings: Mapping,
    *,
    outcomes: Path,
    campaign: Path,
    domain: Path,
    model: Path,
    check: Path,
) -> str:
    """`reference_outcomes`, those at the campaign's numerics and in the other domain, the model of
    σ_num and its cross-validation; a sentence about it.

    ``rows``: pair, name of its numerics, file of its outcome.
    """
    found = [(pair, name, read_rows("reference_outcomes", path)[0]) for pair, name, path in rows]
    best = reference_study.best_rows(found)
    at_campaign = {pair: row for pair, name, row in found if name == CAMPAIGN}
    in_domain = {pair: row for pair, name, row in found if name == DOMAIN}
    pairs = [(at_campaign[row["outcome_id"]], row) for row in best]
    fitted = uncertainty.fit_model(pairs, in_domain)
    checked = uncertainty.cross_validated(pairs, in_domain)
    fitted["check"] = uncertainty.coverage(checked)
    _write("reference_outcomes", best, outcomes, settings)
    _write("reference_outcomes", list(at_campaign.values()), campaign, settings)
    _write("reference_outcomes", list(in_domain.values()), domain, settings)
    _write("reference_check", checked, check, settings)
    with atomic_path(model) as part:
        part.write_text(json.dumps(fitted, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return "Each pair judged without its array: " + uncertainty.closing_sentence(checked)


def compare(rows: Sequence[Path], settings: Mapping, *, table: Path) -> str:
    """`reference_check` of outcomes at the campaign's numerics, against the installed reference;
    who disagrees, in a sentence."""
    if not rows:
        raise DldsimError(
            key="reference.pairs", value="[]", allowed="one or more pairs of array and cell"
        )
    found = [read_rows("reference_outcomes", path)[0] for path in rows]
    shape = found[0]["cell_shape"]
    reference = {row["outcome_id"]: row for row in reference_study.reference_outcomes(shape)}
    model = uncertainty.read_models().get(shape)
    checked = [
        uncertainty.check_row(row, reference[row["outcome_id"]], model)
        for row in found
        if row["outcome_id"] in reference
    ]
    _write("reference_check", checked, table, settings)
    sentence = uncertainty.closing_sentence(checked)
    absent = [row["outcome_id"] for row in found if row["outcome_id"] not in reference]
    return sentence + (f" Not in the reference: {', '.join(absent)}." if absent else "")


def spot_check_cost(outcomes: Path, drawn: Sequence[str], releases: int) -> str:
    """What the spot check of these outcomes takes at most."""
    rows = [row for row in read_rows("outcomes", outcomes) if row["outcome_id"] in set(drawn)]
    return spot_check.cost_sentence(rows, releases)


def gather_spot_check(
    outcomes: Path, checks: Sequence[Path], settings: Mapping, *, table: Path
) -> str:
    """`spot_check` from the campaign's outcomes and the rows of the checks; the verdict."""
    campaign = {row["outcome_id"]: row for row in read_rows("outcomes", outcomes)}
    found = [read_rows("reference_outcomes", path)[0] for path in checks]
    rows = [spot_check.check_row(campaign[row["outcome_id"]], row) for row in found]
    _write("spot_check", rows, table, settings)
    return spot_check.closing_sentence(rows)


def _write(kind: str, rows: Sequence[Row], path: Path, settings: Mapping) -> None:
    write_table(kind, list(rows), path, provenance(settings))
    write_csv(kind, path)
