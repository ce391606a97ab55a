"""The transition of stiff spheres, with a stand-in for their runs, and two of them."""

from types import SimpleNamespace

import pytest

from dldsim.evidence import validation_transition
from dldsim.evidence.validation import run_case
from dldsim.evidence.validation_transition import LAST_STEP, Passage, critical_interval
from dldsim.laws import critical_diameter


def spheres_that_bump_from(critical, asked, monkeypatch):
    """Stand-in for the runs: one diameter divides zigzag and bump."""

    def passage(flow, diameter):
        asked.append(diameter)
        return Passage(diameter >= critical, 3, 0.05, 0.999)

    monkeypatch.setattr(validation_transition, "sphere_passage", passage)


def array(periodicity, height_um=20.0):
    return SimpleNamespace(geometry=SimpleNamespace(periodicity=periodicity), height_um=height_um)


@pytest.mark.parametrize("periodicity", [3, 10, 30])
@pytest.mark.parametrize("share", [0.75, 0.999, 1.001, 1.3])
def test_search_brackets_the_critical_diameter(monkeypatch, periodicity, share):
    asked, critical = [], share * critical_diameter(1, 1 / periodicity)
    spheres_that_bump_from(critical, asked, monkeypatch)
    low, high, passages = critical_interval(array(periodicity))
    assert low < critical <= high and high - low <= 1.01 * LAST_STEP
    assert {low, high} <= set(asked) and len(passages) == len(asked) == len(set(asked))


def test_transition_is_compared_with_law_and_bound(monkeypatch):
    spheres_that_bump_from(0.5, [], monkeypatch)
    monkeypatch.setattr(
        validation_transition,
        "sphere_flow",
        lambda n_p, *rest, height_um=20.0: array(n_p, height_um),
    )
    monkeypatch.setattr(
        validation_transition,
        "critical_follower",
        lambda flow: (
            critical_diameter(0.8, 1 / flow.geometry.periodicity) * (1 if flow.height_um else 1.25)
        ),
    )
    rows = run_case("rigid-transition")
    marked = [row for row in rows if row["mark"] is not None]
    again = [row for row in rows if row["variant"] == "extrapolated"]
    thin = [row for row in rows if "contact of 0.1 nodes" in row["quantity"]]
    others = len(again) + len(thin)
    assert len(marked) == len(validation_transition.TRANSITIONS) == (len(rows) - others) / 5
    assert [row["parameter"] for row in thin] == [10, 16]
    assert [row["parameter"] for row in again] == [5, 10]
    for row in marked:
        assert row["value"] == pytest.approx(0.5, abs=LAST_STEP / 2)
        assert row["reference"] == pytest.approx(1.4 * row["parameter"] ** -0.48)
        assert "deformation up to 0.050" in row["note"] and "0.10%" in row["note"]
    bounds = [r["reference"] for r in rows if r["quantity"].endswith("streamline bound")]
    laws = [critical_diameter(1, 1 / row["parameter"]) for row in marked]
    assert bounds == pytest.approx([0.8 * law for law in laws])
    here = [r["reference"] for r in rows if r["quantity"].endswith("law at this height")]
    assert here == pytest.approx([law / 1.25 for law in laws])


def test_a_small_sphere_zigzags_and_a_large_one_bumps():
    flow = validation_transition.sphere_flow(5, 20)
    small, large = (validation_transition.sphere_passage(flow, d) for d in (0.5, 0.8))
    assert (small.bumps, large.bumps) == (False, True)
    assert max(small.rows, large.rows) <= 6
    assert max(small.deformation, large.deformation) < 0.15
    assert small.volume_ratio == pytest.approx(1, abs=0.01)
