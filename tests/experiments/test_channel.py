"""A cell carried along a straight channel until its shape is steady."""

import numpy as np
import pytest

from dldsim.config.assay_sections import ChannelAssay
from dldsim.config.sections import Cell, Flow, Numerics
from dldsim.errors import DldsimError
from dldsim.experiments.channel import make_channel, simulate_channel
from tests.experiments.test_constriction import SOFT, times

ASSAY = ChannelAssay(
    kind="channel",
    velocity_mm_s=0.5,
    spacing_um=1.25,
    width_um=12,
    height_um=14,
    period_um=20,
    steady_change=0.01,
)
CELL = Cell(radius_um=4.5, axis="x")


def carry(assay=ASSAY, stiffness=SOFT, **options):
    return simulate_channel(stiffness, assay, CELL, Flow(), Numerics(), run_id="a", **options)


@pytest.fixture(scope="module")
def result():
    return carry()


def test_channel_on_the_lattice():
    channel = make_channel(ASSAY, Numerics())
    assert channel.width == 10 and channel.spacing_um == pytest.approx(1.2)
    fluid = (channel.lattice.column >= 0).sum(axis=1)
    assert (fluid == 10).all()
    assert channel.height * 1.2 == pytest.approx(14, abs=0.6)


def test_the_shape_becomes_steady_on_the_axis(result):
    row, path = result.row, result.trajectory
    assert row["status"] == "converged" and row["index_change"] <= 0.01
    assert np.abs(path["y_um"]).max() < 1e-3 and np.abs(path["z_um"]).max() < 1e-3
    # Faster than the mean, as the fluid in the middle is: at most 2.1 times in a square duct.
    speed = np.polyfit(path["t_ms"], path["x_um"], 1)[0]
    assert 0.5 < speed < 1.05
    # A disc that faces the flow, 9 × 3 µm at rest, is folded into a cup by it.
    assert path["diameter_d_um"][0] == pytest.approx(0.656 * 4.5, rel=0.03)
    assert row["diameter_d_um"] > path["diameter_d_um"][0]
    assert row["diameter_h_um"] < 9
    d, h = row["diameter_d_um"], row["diameter_h_um"]
    assert row["deformation_index"] == pytest.approx(abs(d - h) / (d + h))
    assert 0 < row["circularity_index"] < 0.3
    # Ca = μU/k_s: 1.5e-3 · 0.5e-3/5.1e-6.
    assert row["capillary_number"] == pytest.approx(0.75 / 5.1)


def test_a_stiffer_cell_is_folded_less(result):
    stiff = carry(stiffness=times(4, "ks_uN_per_m", "kb_pN_um", "kal_uN_per_m")).row
    assert stiff["diameter_h_um"] > result.row["diameter_h_um"]


def test_a_cell_off_the_axis_begins_there():
    path = carry(offset_um=0.6).trajectory
    assert path["y_um"][0] == 0  # counted from the place of release
    with pytest.raises(DldsimError, match="width_um = 12: .* released 2 µm off the axis"):
        carry(offset_um=2.0)


def test_a_shape_that_is_not_steady_in_time_has_no_index():
    row = carry(ASSAY.model_copy(update={"travel_max_um": 5.0})).row
    assert row["status"] == "undecided" and "not become steady" in row["stop_reason"]
    assert row["deformation_index"] is None
