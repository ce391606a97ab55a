"""The constriction channel and the passage of a cell through it."""

import numpy as np
import pytest

from dldsim.config.sections import Cell, Constriction, Flow, Numerics, Stiffness
from dldsim.errors import DldsimError
from dldsim.experiments import constriction
from dldsim.experiments.constriction import make_channel, simulate_constriction
from dldsim.solver.flow import Fluid

SOFT = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)
CHANNEL = Constriction(
    spacing_um=1.0,
    width_um=16,
    throat_width_um=8,
    throat_length_um=14,
    taper_length_um=4,
    approach_length_um=16,
    height_um=10,
)
CELL = Cell(radius_um=5.0)
NUMERICS = Numerics(velocity_lu=0.03)


def pass_throat(channel=CHANNEL, cell=CELL, numerics=NUMERICS, stiffness=SOFT, **options):
    options = {"release_position_um": 1.0, "run_id": "a", **options}
    return simulate_constriction(stiffness, 1.0, channel, cell, Flow(), numerics, **options)


def times(factor, *names):
    return SOFT.model_copy(update={n: getattr(SOFT, n) * factor for n in names})


@pytest.fixture(scope="module")
def result():
    """A cell of 10 µm through a throat of 8 µm."""
    return pass_throat()


def test_a_passage_that_takes_too_long_is_refused_before_it_starts(monkeypatch):
    monkeypatch.setattr(constriction, "steady_start", None)
    thin = Flow(viscosity_mPa_s=0.01)
    stiff = SOFT.model_copy(update={"ks_uN_per_m": 1e6})
    with pytest.raises(DldsimError, match="time step shortened by .* too stiff") as caught:
        simulate_constriction(
            stiff, 1.0, CHANNEL, CELL, thin, NUMERICS, release_position_um=1.0, run_id="a"
        )
    assert caught.value.key == "limits.run_hours"


def test_channel_on_the_lattice():
    channel = make_channel(CHANNEL.model_copy(update={"spacing_um": 0.9}), NUMERICS)
    # An even number of nodes in the throat; a length on the lattice is off by less than a node.
    assert channel.throat_width == 10
    assert channel.spacing_um == pytest.approx(0.8)
    assert channel.width * 0.8 == pytest.approx(16)
    assert channel.height * 0.8 == pytest.approx(10, abs=0.8)
    assert channel.length * 0.8 == pytest.approx(2 * (16 + 4) + 14, abs=0.8)
    begin, end = channel.throat
    assert (end - begin) * 0.8 == pytest.approx(14)
    fluid = (channel.lattice.column >= 0).sum(axis=1)
    assert (fluid[int(begin) + 1 : int(end) - 1] == 10).all()
    assert fluid[0] == fluid[-1] == 20
    assert (np.diff(fluid[: len(fluid) // 2]) <= 0).all()
    np.testing.assert_array_equal(fluid, fluid[::-1])
    # Mirrored about the axis.
    solid = channel.lattice.column < 0
    np.testing.assert_array_equal(solid[:, 1:], solid[:, :0:-1])
    assert solid[:, 0].all()


def test_flux_is_that_of_the_throat_velocity():
    numerics = NUMERICS.model_copy(update={"precision": "float64"})
    channel = make_channel(CHANNEL, numerics)
    fluid = Fluid.of(channel.lattice, numerics)
    constriction.steady_start(fluid, channel, 0.03, None)
    fluid.advance(2)
    u = np.zeros((channel.length, channel.lattice.ny))
    u[channel.lattice.column >= 0] = fluid.velocity_field()[0].mean(axis=-1)
    # Steady flow: the same through every section, but for the steady tolerance of 1e-9 per chunk.
    flux = u.sum(axis=1) / channel.throat_width
    np.testing.assert_allclose(flux, 0.03, rtol=1e-6)


def test_the_cell_passes_and_lengthens_in_the_throat(result):
    row = result.row
    assert row["status"] == "converged" and "left the throat" in row["stop_reason"]
    # From a disc of 10 µm seen face on, DI 0, through a throat of 8 µm with room at the sides.
    assert 0.05 < row["deformation_index"] <= row["deformation_index_max"] < 1
    assert 5 < row["diameter_h_um"] < 8
    assert 10 < row["diameter_d_um"] < 20
    d, h = row["diameter_d_um"], row["diameter_h_um"]
    assert row["deformation_index"] == pytest.approx((d - h) / (d + h))
    assert row["volume_drift_max"] < 0.05
    assert row["area_drift_max"] < 0.1
    # Ca = μv/k_s with the velocity of the wide channel: 1.5e-3 · 1e-3/5.1e-6.
    assert row["capillary_number"] == pytest.approx(1.5 / 5.1)
    # A wedge is less round than a rod of its extents: P = 2 (d − h) + π h, A = (d − h) h + π h²/4.
    length = d - h
    rod = 2 * (np.pi * (length * h + np.pi * h * h / 4)) ** 0.5 / (2 * length + np.pi * h)
    assert 1 - rod < row["circularity_index"] < 2 * (1 - rod)


def test_path_of_the_cell(result):
    t = result.trajectory
    # Released with its rim 1 µm before the taper; 0 is the middle of the throat.
    assert t["x_um"][0] == pytest.approx(-(7 + 4 + 5 + 1))
    assert t["x_um"][-1] >= 7 + 5
    assert (np.diff(t["x_um"]) > 0).all()
    assert t["diameter_d_um"][0] == pytest.approx(10, rel=0.05)
    assert t["diameter_h_um"][0] == pytest.approx(10, rel=0.05)
    assert t["deformation_index"][0] == pytest.approx(0, abs=0.03)
    big, small = (f(t["diameter_d_um"], t["diameter_h_um"]) for f in (np.maximum, np.minimum))
    np.testing.assert_allclose(t["deformation_index"], (big - small) / (big + small))
    assert result.row["deformation_index_max"] == pytest.approx(t["deformation_index"].max())
    # On the axis of a mirrored channel, with a mirrored mesh, in single precision.
    assert np.abs(t["y_um"]).max() < 1e-3
    assert np.abs(t["z_um"]).max() < 1e-3
    # A cell that fills the throat moves faster than the mean there and slower than its centre:
    # 2 mm/s on average, at most 2.1 times that in a duct.
    inside = np.abs(t["x_um"]) < 4
    speed = np.polyfit(t["t_ms"][inside], t["x_um"][inside], 1)[0]
    assert 2.0 < speed < 4.2


def test_a_softer_cell_deforms_more(result):
    other = pass_throat(stiffness=times(3, "ks_uN_per_m", "kb_pN_um", "kal_uN_per_m")).row
    assert other["status"] == "converged"
    assert other["deformation_index"] < result.row["deformation_index"]


def test_a_cell_off_the_axis_begins_there_and_is_led_in(result):
    aside = pass_throat(offset_um=1.5)
    y = aside.trajectory["y_um"]
    assert y[0] == pytest.approx(1.5, abs=0.05) and abs(y[-1]) < 1.0
    assert aside.row["deformation_index"] == pytest.approx(
        result.row["deformation_index"], abs=0.05
    )


def test_a_cell_that_does_not_pass_is_stuck(monkeypatch):
    monkeypatch.setattr(constriction, "PATIENCE", 0.2)
    result = pass_throat()
    row = result.row
    assert row["status"] == "stuck" and "not passed the throat" in row["stop_reason"]
    assert row["deformation_index"] is row["diameter_d_um"] is row["diameter_h_um"] is None
    assert all(np.isfinite(v).all() for k, v in result.trajectory.items() if k != "run_id")


def test_an_unstable_passage_has_no_deformation_index():
    numerics = NUMERICS.model_copy(update={"time_step": "as-given"})
    stiff = times(1e4, "ks_uN_per_m", "kal_uN_per_m")
    row = pass_throat(stiffness=stiff, numerics=numerics).row
    assert row["status"] == "unstable" and "cures" in row["stop_reason"]
    assert row["deformation_index"] is row["circularity_index"] is None


@pytest.mark.parametrize(
    ("change", "cell", "release", "message"),
    [
        ({"throat_width_um": 16.0}, CELL, 0.0, "throat_width_um = 16 must be below"),
        ({}, CELL, 7.0, "7 µm does not fit the approach .* allowed 0 to 6"),
        ({}, Cell(radius_um=9.0), 0.0, "approach_length_um = 16 is shorter than the cell"),
        ({"height_um": 4.0}, CELL, 0.0, "does not fit the channel of 16 × 4 µm"),
        ({"height_um": 0.3}, CELL, 0.0, "height_um"),
    ],
)
def test_a_channel_or_cell_that_does_not_fit_is_refused(change, cell, release, message):
    with pytest.raises(DldsimError, match=message):
        pass_throat(CHANNEL.model_copy(update=change), cell, release_position_um=release)
