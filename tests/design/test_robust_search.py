"""The robust objective: draws of array and cells."""

import numpy as np
import pytest

from tests.design.known_surrogate import CHIP, Known, ask, found, hill, people, run, task_of


def test_robust_separation_of_a_line_by_hand():
    """Separation 0.3 g with ± 0.5 µm on the gap: nine of ten draws exceed 0.3 (g − 0.4)."""
    line = Known(lambda r, g, n, d, cell: d * g, half=0.0)
    task = task_of(line, ask(objective="robust", draws=4096), CHIP, seed=1)
    at = np.array([7.0]), np.array([16.0]), np.array([8])
    assert task.robust(*at)[0] == pytest.approx(0.3 * 15.6, abs=2e-3)
    # normal errors of both predictions, ± 0.5 at 90 %: the difference has σ = 0.43
    noisy = task_of(Known(lambda r, g, n, d, cell: 10 * d, half=0.5), task.request, CHIP, seed=1)
    assert noisy.robust(*at)[0] == pytest.approx(3 - 1.2816 * 2**0.5 * 0.5 / 1.6449, abs=0.02)


def test_spread_of_the_cells_counts():
    """θ = 10 ln Ca: the second cell's ± 0.05 of ln k_s is ± 0.5° on a separation of 4.05°."""
    line = Known(lambda r, g, n, d, cell: 10 * np.log(d), half=0.0)
    request = ask(0.4, 0.6, objective="robust", draws=4096, tolerance_um=0)
    first, second = people(request)
    ks = second.stiffness.ks_uN_per_m
    wide = [first, second._replace(ks_low=ks * np.exp(-0.05), ks_high=ks * np.exp(0.05))]
    at = np.array([7.0]), np.array([16.0]), np.array([8])
    wanted = 10 * np.log(1.5)
    task = task_of(line, request, populations=wide)
    assert task.robust(*at)[0] == pytest.approx(wanted - 1.2816 * 0.5, abs=0.02)
    # one-sided: only softer cells, of larger Ca
    softer = [first, second._replace(ks_low=ks * np.exp(-0.05))]
    assert task_of(line, request, populations=softer).robust(*at)[0] == pytest.approx(wanted)


def test_draws_beyond_what_was_learnt_are_taken_at_its_edge():
    request = ask(0.31, 0.6, draws=512)
    first, second = people(request)
    wide = [first._replace(ks_high=first.stiffness.ks_uN_per_m * 2), second]
    drawn = task_of(Known(hill), request, populations=wide).drawn_cell(0).capillary_number
    assert drawn.min() == pytest.approx(0.3) and drawn.max() == pytest.approx(0.31)


def test_intervals_of_angles_span_the_interval_of_ca():
    """θ = 10 Ca ± 0.1°, Ca 0.5 to 0.6 and, cut where nothing is known, 0.8 to 0.9."""
    line = Known(lambda r, g, n, d, cell: 10 * d)
    first, second = people(ask())
    wide = [first._replace(ks_low=0.75 / 0.6), second._replace(ks_low=0.75 / 1.5)]
    designs = run(line, ask(trials=20), populations=wide).designs
    row = designs.iloc[0]
    for i, (low, angle, high) in enumerate(((4.9, 5.0, 6.1), (7.9, 8.0, 9.1)), start=1):
        found = [row[f"angle_{i}_{side}deg"] for side in ("low_", "", "high_")]
        assert found == pytest.approx([low, angle, high])


def test_robust_search_avoids_the_sharp_optimum():
    """A summit of 3° narrower than the tolerance, and a plain of 1.5°."""

    def landscape(r, g, n, d, cell):
        return d * np.where(np.abs(r - 7) < 0.2, 10.0, np.where(r > 8, 5.0, 0.0))

    wants = {
        name: ask(objective=name, trials=150, tolerance_um=0.6) for name in ("separation", "robust")
    }
    best = {
        name: found(Known(landscape, half=0.01), want, seed=1)[0].iloc[0]
        for name, want in wants.items()
    }
    assert best["separation"]["separation_deg"] == pytest.approx(3.0)
    assert best["robust"]["separation_deg"] == pytest.approx(1.5)
    assert best["robust"]["robust_separation_deg"] == pytest.approx(1.5, abs=0.1)


def test_an_open_order_is_no_reason_to_choose_no_separation():
    """The error exceeds every separation, most of all where there is none at all."""

    def landscape(r, g, n, d, cell):
        return d * (r - 5)

    class Unsure(Known):
        def predict_interval(self, radius, gap, periodicity, cell, level=0.9):
            angle = self.predict(radius, gap, periodicity, cell)
            return angle - 1 - (radius - 5), angle + 1 + (radius - 5)

    designs, _ = found(Unsure(landscape), ask(objective="robust"), seed=1)
    assert designs.iloc[0]["robust_separation_deg"] < 0
    assert designs.iloc[0]["pillar_radius_um"] > 9


def test_probability_of_another_mode():
    """The first cell bumps above P_r = 7; at 7 with ± 0.5, half of the draws are below."""

    def step(r, g, n, d, cell):
        return np.where((r > 7) & (d < 0.7), np.degrees(np.arctan(1 / n)), 0.0)

    request = ask(pillar_radius_um=(6.99, 7.01), draws=1024, trials=10)
    row = found(Known(step, half=0.0), request, seed=1)[0].iloc[0]
    assert row["mode_change_probability"] == pytest.approx(0.5, abs=0.03)
