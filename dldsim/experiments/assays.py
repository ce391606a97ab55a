"""A passage of one cell through any of the assays."""

from dldsim.config.assay_sections import ChannelAssay, ConstrictionAssay, ShearAssay, Simulated
from dldsim.config.assays import Membrane, Passage
from dldsim.config.sections import Cell, CellShape, Flow, Numerics
from dldsim.experiments.outcome_files import Measured
from dldsim.experiments.runner import Progress


def known_of(
    name: str,
    assay: Simulated,
    membrane: Membrane,
    cell: CellShape,
    viscosity_mPa_s: float,
    passage: Passage,
    run_id: str,
) -> dict:
    """Columns of `assay_runs` that need no simulation."""
    return {
        "run_id": run_id,
        "assay": name,
        "kind": assay.kind,
        "cell_shape": cell.shape,
        "cell_radius_um": cell.radius_um,
        "group": membrane.name,
        "stiffness_set": membrane.stiffness_set,
        **membrane.stiffness.model_dump(include={"ks_uN_per_m", "kb_pN_um", "kal_uN_per_m"}),
        "velocity_mm_s": velocity_of(assay, membrane),
        "shear_stress_Pa": assay.stress_Pa if isinstance(assay, ShearAssay) else None,
        "viscosity_mPa_s": viscosity_mPa_s,
        **passage._asdict(),
    }


def velocity_of(assay: Simulated, membrane: Membrane) -> float | None:
    """Mean velocity [mm/s] of an assay, in a constriction that of the wide channel; None in
    shear."""
    if isinstance(assay, ChannelAssay):
        return assay.mean_velocity_mm_s
    if isinstance(assay, ConstrictionAssay):
        return membrane.velocity_mm_s or assay.velocity_mm_s
    return None


def simulate_passage(
    name: str,
    assay: Simulated,
    membrane: Membrane,
    cell: CellShape,
    flow: Flow,
    numerics: Numerics,
    passage: Passage,
    *,
    run_id: str,
    progress: Progress = None,
) -> Measured:
    """Carry one cell through an assay: its row of `assay_runs`, whole, and its trajectory.

    ``cell``: as it is named; ``flow``: of which the viscosity counts. Raises DldsimError for a cell
    that does not fit and a run that takes too long.
    """
    known = known_of(name, assay, membrane, cell, flow.viscosity_mPa_s, passage, run_id)
    own = Cell(
        shape=cell.shape,
        aspect_ratio=cell.aspect_ratio,
        radius_um=cell.radius_um * passage.radius_factor,
        axis=passage.axis,
    )
    told = {"run_id": run_id, "progress": progress}
    if isinstance(assay, ConstrictionAssay):
        from dldsim.experiments.constriction import simulate_constriction

        channel = assay.channel.model_copy(update={"axis": passage.axis})
        found = simulate_constriction(
            membrane.stiffness,
            known["velocity_mm_s"],
            channel,
            own,
            flow,
            numerics,
            release_position_um=passage.release_position_um,
            offset_um=passage.offset_um,
            **told,
        )
    elif isinstance(assay, ChannelAssay):
        from dldsim.experiments.channel import simulate_channel

        found = simulate_channel(
            membrane.stiffness, assay, own, flow, numerics, offset_um=passage.offset_um, **told
        )
    else:
        from dldsim.experiments.sheared import simulate_shear

        found = simulate_shear(membrane.stiffness, assay, own, flow, numerics, **told)
    return Measured({**known, **found.row}, found.trajectory)
