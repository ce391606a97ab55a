"""Length and pressure of arrays."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from dldsim.design.chip import Resistance
from dldsim.errors import DldsimError
from dldsim.vocabulary import together
from tests.design.known_surrogate import CHIP, Known, ask, found, hill, run, task_of


def make_flows(height=20.0):
    """Arrays whose drag is a power of gap and pitch."""
    places = list(product((5.0, 7.0, 9.0), (12.0, 16.0, 20.0), (4, 8, 12)))
    frame = pd.DataFrame(places, columns=["pillar_radius_um", "gap_um", "periodicity"])
    pitch = 2 * frame["pillar_radius_um"] + frame["gap_um"]
    drag = 3e-3 * pitch**2 * (frame["gap_um"] / pitch) ** -2
    return frame.assign(drag_over_mu_U=drag, height_um=height, drive="no-lateral-flux")


def test_resistance_of_arrays_on_one_line_stays_sane_off_it():
    # The source's arrays, P_g = P_r + 10 µm: the quadratic is not decided across that line.
    radius = np.repeat([4.0, 6.0, 8.0, 10.0, 11.0, 12.0], 3)
    flows = pd.DataFrame(
        {"pillar_radius_um": radius, "gap_um": radius + 10, "periodicity": np.tile([4, 8, 12], 6)}
    )

    def drag(radius, gap):
        pitch = 2 * radius + gap
        return 3e-3 * pitch**2 * (gap / pitch) ** -2

    noise = 1 + 0.01 * np.cos(np.arange(len(flows)) ** 2)
    flows = flows.assign(
        drag_over_mu_U=noise * drag(radius, radius + 10), height_um=20.0, drive="no-lateral-flux"
    )
    resistance = Resistance(flows)
    assert "larger elsewhere" in resistance.basis
    # Nothing is known there but the order of magnitude; the undamped fit said 1e-90 to infinity.
    radius, gap = np.array([5.0, 10.0]), np.array([20.0, 13.0])
    ratio = resistance.drag_over_mu_U(radius, gap, [8, 8]) / drag(radius, gap)
    assert np.all((ratio > 0.1) & (ratio < 10))
    assert "larger elsewhere" not in Resistance(make_flows()).basis


def test_a_resistance_beyond_its_flows_is_called_extrapolated():
    chip = CHIP._replace(resistance=Resistance(make_flows()))
    places = [(7, 16, 8), (5, 12, 4), (11, 100, 6), (12, 22, 4), (7, 16, 13)]
    basis = chip.pressure_basis(*np.array(places, float).T)
    assert [text.split()[0] for text in basis] == 2 * ["interpolated"] + 3 * ["extrapolated"]
    assert together(basis[:2]) == basis[0]
    assert together(basis) == f"{basis[0]}: candidates 1, 2; {basis[2]}: candidates 3, 4, 5"
    assert "N_p 4 to 12" in basis[2] and "error not known" in basis[2]


def test_pressure_drop_by_hand():
    """Δp = drag μ U L/λ²: 75 · 1.5e-3 Pa s · 0.5e-3 m/s · 4e-3 m / (25e-6 m)² = 360 Pa."""
    resistance = Resistance(make_flows())
    assert resistance.error < 1e-9
    assert resistance.drag_over_mu_U(6.0, 13.0, 6)[0] == pytest.approx(3e-3 * 25**4 / 13**2)
    assert CHIP.pressure_kPa(75.0, 25.0, 4.0) == pytest.approx(0.36)
    # 0.5 mm/s through 2 mm × 20 µm
    assert CHIP.throughput_uL_per_h == pytest.approx(0.5 * 2 * 0.02 * 3600)


def test_length_parts_the_cells():
    task = task_of(Known(lambda r, g, n, d, cell: 10 * d), ask(lateral_separation_um=100), CHIP, 1)
    length = task.length_mm(np.array([5.0]), np.array([8.0]))
    assert length[0] * 1e3 * (np.tan(np.radians(8)) - np.tan(np.radians(5))) == pytest.approx(100)
    assert np.isinf(task.length_mm(np.array([5.0]), np.array([5.0])))[0]


def test_pressure_limit_is_kept():
    """Narrow gaps separate best and cost most."""
    tempting = Known(lambda r, g, n, d, cell: d * (20 - g / 10))
    chip = CHIP._replace(resistance=Resistance(make_flows()))
    thin = {"pillar_radius_um": (5, 5.2)}
    free = run(tempting, ask(**thin), chip, 1).designs.iloc[0]
    most = 0.85 * free["pressure_drop_kPa"]
    limited = run(tempting, ask(**thin, pressure_max_kPa=most), chip, 1)
    assert (limited.designs["pressure_drop_kPa"] <= most).all()
    assert limited.designs.iloc[0]["gap_um"] > free["gap_um"]
    assert limited.trials["reason"].str.contains("pressure").any()


def test_pressure_limit_needs_flows():
    with pytest.raises(DldsimError, match="flows.parquet"):
        run(Known(hill), ask(pressure_max_kPa=1.0), CHIP, 1)
    designs, _ = found(Known(hill), ask(trials=20), seed=1)
    assert designs["pressure_drop_kPa"].isna().all()
    assert (designs["pressure_basis"] == "not known: there is no table of flows").all()


def test_flows_of_several_heights_are_refused():
    flows = make_flows()
    flows.loc[3, "height_um"] = 30.0
    with pytest.raises(DldsimError, match="height_um"):
        Resistance(flows)
