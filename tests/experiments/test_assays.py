"""Any assay by its settings: rows and trajectories fill their tables."""

import pytest

from dldsim.config.assay_sections import ChannelAssay, ConstrictionAssay, ShearAssay
from dldsim.config.assays import Membrane, passages_of
from dldsim.config.sections import CellShape, Flow, Numerics
from dldsim.experiments.assays import known_of, simulate_passage
from dldsim.tables.parquet import write_table
from dldsim.tables.registry import COLUMNS
from tests.experiments.test_channel import ASSAY as STRAIGHT
from tests.experiments.test_constriction import CHANNEL, SOFT
from tests.experiments.test_sheared import ASSAY as SHEAR

SLIT = ConstrictionAssay(kind="constriction", channel=CHANNEL, velocity_mm_s=1.0)


@pytest.mark.parametrize("assay", [SLIT, STRAIGHT, SHEAR], ids=lambda assay: assay.kind)
def test_a_passage_fills_its_tables(assay, tmp_path):
    first = passages_of(assay, "biconcave")[0]
    membrane, cell = Membrane("1", SOFT, "1"), CellShape(radius_um=4.5)
    result = simulate_passage(
        "mine", assay, membrane, cell, Flow(), Numerics(), first, run_id="mine_0"
    )
    row = result.row
    assert set(row) == {c.name for c in COLUMNS["assay_runs"]}
    assert set(result.trajectory) == {c.name for c in COLUMNS["assay_trajectory"]}
    write_table("assay_runs", [row], tmp_path / "run.parquet", {})
    write_table("assay_trajectory", result.trajectory, tmp_path / "path.parquet", {})
    assert row["kind"] == assay.kind and row["axis"] == assay.axis
    assert (row["velocity_mm_s"] is None) == (assay.kind == "shear")
    assert (row["shear_stress_Pa"] is None) == (assay.kind != "shear")


def test_size_and_orientation_are_the_passages():
    """What is known of a passage without simulating it."""
    assay = ShearAssay(kind="shear", stress_Pa=1, radius_factors=[1.05], other_axes=["x"])
    _, large, turned = passages_of(assay, "biconcave")
    membrane, cell = Membrane("1", SOFT), CellShape(radius_um=6.0)
    row = known_of("a", assay, membrane, cell, 1.5, large, "a_1")
    assert row["cell_radius_um"] == 6.0 and row["radius_factor"] == 1.05
    assert known_of("a", assay, membrane, cell, 1.5, turned, "a_2")["axis"] == "x"


def test_velocities_of_each_kind():
    groups = ConstrictionAssay(kind="constriction", channel=CHANNEL, groups=True)
    channel = ChannelAssay(kind="channel", flow_rate_nl_per_s=1, width_um=20, height_um=25)
    for assay, own, expected in ((SLIT, None, 1.0), (groups, 2.5, 2.5), (channel, None, 2.0)):
        membrane = Membrane("1", SOFT, "", own)
        first = passages_of(assay, "sphere")[0]
        row = known_of("a", assay, membrane, CellShape(), 1.5, first, "a_0")
        assert row["velocity_mm_s"] == pytest.approx(expected)
