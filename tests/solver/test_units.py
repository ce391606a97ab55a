"""Conversion between physical and lattice units."""

import pytest

from dldsim.config.sections import Flow, Numerics, Stiffness
from dldsim.solver.units import Units

SET_1 = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)


@pytest.fixture
def units():
    flow = Flow(mean_velocity_mm_s=0.5, viscosity_mPa_s=1.5)
    return Units.of(1.25, flow, Numerics(velocity_lu=0.0125, relaxation_time=1.25))


def test_numbers_worked_out_by_hand(units):
    # ν = 0.25; one lattice unit of surface modulus is 1.5e-3 · 0.5e-3/(0.25 · 0.0125) = 2.4e-4 N/m.
    assert units.viscosity_lu == 0.25
    assert units.time_step_us == pytest.approx(31.25)  # 1.25e-6 · 0.0125/0.5e-3 s
    assert units.velocity_from_lu(0.0125) == pytest.approx(0.5)
    assert units.surface_modulus(5.1) == pytest.approx(0.02125)  # 5.1e-6/2.4e-4
    assert units.energy(0.043) == pytest.approx(4.3e-20 / 3.75e-16)  # 2.4e-4 · 1.25e-6² J
    assert units.pressure(900) == pytest.approx(4.6875)  # 900 · 1.25e-6/2.4e-4
    assert units.force(1) == pytest.approx(10 / 3)  # 1e-9/(2.4e-4 · 1.25e-6)
    assert units.friction(1.5) == pytest.approx(0.2)  # 1.5e-9/(1.5e-3 · 1.25e-6) · 0.25
    assert units.capillary_number(5.1) == pytest.approx(0.75 / 5.1)  # 1.5e-3 · 0.5e-3/5.1e-6
    assert units.reynolds_number(7.5) == pytest.approx(0.6)  # 0.0125 · 12/0.25
    assert units.capillary_number(0) is None


def test_conversions_round_trip(units):
    assert units.energy_aJ(units.energy(0.043)) == pytest.approx(0.043)
    # What crosses one node in one step at 1 lattice unit of velocity.
    assert units.velocity_from_lu(1.0) == pytest.approx(units.spacing_um / units.time_step_us * 1e3)
    # Force over length is a surface modulus, over area a pressure, times length an energy.
    um = 1 / units.spacing_um
    assert units.force(1.0) / um == pytest.approx(units.surface_modulus(1e3))
    assert units.force(1.0) / um**2 == pytest.approx(units.pressure(1e3))
    assert units.force(1.0) * um == pytest.approx(units.energy(1e3))
    # A friction times a velocity is a force: 1 nN·s/m · 1 mm/s = 1e-3 nN.
    velocity = 1 / units.velocity_from_lu(1.0)
    assert units.friction(1.0) * velocity == pytest.approx(units.force(1e-3))


def groups(units):
    """Dimensionless numbers of a run, from its lattice units; length scale 7.5 µm."""
    k = units.stiffness(SET_1)
    radius, viscosity = 7.5 / units.spacing_um, units.viscosity_lu
    return {
        "capillary": viscosity * units.velocity_lu / k["ks"],
        "bending": k["kb"] / (k["ks"] * radius**2),
        "local area": k["kal"] / k["ks"],
        "global area": k["kag"] / k["ks"],
        "volume": k["kv"] * radius / k["ks"],
        "Boussinesq": k["kvisc"] / (viscosity * radius),
        "contact": units.force(1e-4) / (k["ks"] * radius),
        "transit": units.velocity_lu * 1e3 / units.time_step_us / radius,
    }


@pytest.mark.parametrize(
    ("spacing_um", "change"),
    [(0.5, {}), (1.25, {"velocity_lu": 0.05}), (0.8, {"relaxation_time": 0.7})],
)
def test_dimensionless_numbers_do_not_depend_on_the_numerics(units, spacing_um, change):
    numerics = Numerics(velocity_lu=0.0125, relaxation_time=1.25).model_copy(update=change)
    other = Units.of(spacing_um, Flow(mean_velocity_mm_s=0.5, viscosity_mPa_s=1.5), numerics)
    assert groups(other) == pytest.approx(groups(units))
    assert groups(units)["capillary"] == pytest.approx(units.capillary_number(5.1))


def test_a_faster_or_thicker_fluid_sees_a_softer_cell(units):
    fast = Units.of(1.25, Flow(mean_velocity_mm_s=1.0, viscosity_mPa_s=3.0), Numerics())
    assert groups(fast)["capillary"] == pytest.approx(4 * groups(units)["capillary"])
    # The dashpot is a viscosity: only the fluid's matters to it.
    assert groups(fast)["Boussinesq"] == pytest.approx(groups(units)["Boussinesq"] / 2)
