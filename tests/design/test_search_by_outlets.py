"""Searches for purity and recovery at the outlets."""

import numpy as np
import pytest

from dldsim.errors import DldsimError
from tests.design.known_surrogate import Known, ask, found, hill, task_of


class Outlets(Known):
    """Cells of the second type bump, those of the first do in thick pillars; how sure that is
    depends on the gap."""

    card = {
        "conformal": {"scores": {"biconcave": [[0.0]] * 99}, "range": [0.0, 1.0]},
        "numerical_uncertainty": {"share_by_mode": {}},
    }

    def __init__(self):
        super().__init__(lambda r, g, n, ca, size: np.degrees(np.arctan(self.law(r, ca) / n)))

    @staticmethod
    def law(r, ca):
        return np.where(ca > 0.6, 1.0, np.clip((r - 6) / 4, 0, 1))

    def share(self, radius, gap, periodicity, cell):
        ca = np.broadcast_to(cell.capillary_number, np.shape(radius))
        return self.law(np.asarray(radius), ca)

    def predict_interval(self, radius, gap, periodicity, cell, level=0.9):
        angle = self.predict(radius, gap, periodicity, cell)
        half = np.where(np.asarray(gap) > 18, 9.0, 0.1)
        return angle - half, angle + half


def by_outlets(**changes):
    given = {"objective": "purity-recovery", "trials": 40, "candidates": 4, "draws": 8, "cells": 32}
    return ask(**given | {"tolerance_um": 0.2} | changes)


def test_outlets_are_an_objective():
    designs, trials = found(Outlets(), by_outlets(gap_um=(14, 17)), seed=1)
    best = designs.iloc[0]
    assert best["objective"] == "purity-recovery" and best["pillar_radius_um"] < 7
    assert best["value"] == pytest.approx(1.0) and not best["mode_open"]
    assert trials["value"].max() <= 1
    thick = trials[trials["feasible"] & (trials["pillar_radius_um"] > 9.7)]
    assert (thick["value"] < 0.9).all()
    equal = designs[designs["rank"] == 1]
    assert len(equal) > 1 and "equally good outlets" in str(best["notes"])


def test_an_open_mode_is_ranked_behind_by_outlets_and_marked_always():
    designs, _ = found(Outlets(), by_outlets(candidates=40), seed=1)
    assert designs["mode_open"].tolist() == (designs["gap_um"] > 18).tolist()
    assert (np.diff(designs["mode_open"].astype(int)) >= 0).all()
    assert set(designs["mode_open"]) == {False, True}
    assert "a mode is open" in str(designs[designs["mode_open"]]["notes"].iloc[0])
    other = found(Outlets(), by_outlets(candidates=40, objective="separation"), seed=1)[0]
    assert (np.diff(other["separation_deg"]) <= 0).all() and other["mode_open"].any()


def test_a_grid_looks_at_the_outlets_of_the_largest_separations():
    request = by_outlets(sampler="grid", grid_steps=13, periodicity=(6, 10))
    designs, trials = found(Outlets(), request, seed=1)
    looked_at = trials["value"].notna()
    assert looked_at.sum() == 300 < trials["feasible"].sum()
    assert (
        trials["separation_deg"][looked_at].min()
        >= trials["separation_deg"][trials["feasible"] & ~looked_at].max()
    )
    assert designs["value"].notna().all()


def test_footprint_and_sample_flow_are_limits():
    _, trials = found(Outlets(), by_outlets(footprint_max_mm2=0.5), seed=1)
    short = trials[trials["reason"].str.contains("array must hold a period")]
    period = (2 * short["pillar_radius_um"] + short["gap_um"]) * short["periodicity"]
    assert len(short) and (period > 250).all()
    with pytest.raises(DldsimError, match="sample_min_uL_per_h = 99"):
        found(Outlets(), by_outlets(sample_min_uL_per_h=99.0), seed=1)


def test_a_gap_passes_all_but_the_largest_cell_in_a_hundred():
    request = ask(radius_cv_2=0.2)
    alike, scattered = (task_of(Known(hill), r) for r in (ask(), request))
    widths = [task.populations[1].width_um for task in (alike, scattered)]
    assert widths[1] / widths[0] == pytest.approx(1 + 0.2 * 2.326, rel=0.01)
