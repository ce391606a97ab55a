"""Laws of the robustness of geometries."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis.robustness import most_frequent, robustness
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY
from tests.analysis.made_factorial import DI, factorial, noisy


def test_robustness_score_by_hand():
    """Three gaps in a line: angles 1, 3, 6; S = 4, (4 + 9)/2, 9."""
    frame = factorial(lambda r, g, n, d: {18: 1, 20: 3, 22: 6}[g] + d, radii=(6,), rows=(4,))
    table = robustness(frame.assign(mode="bump")).set_index("gap_um")
    assert table["robustness_score_deg2"].to_dict() == pytest.approx({18: 4, 20: 6.5, 22: 9})
    assert table["neighbours"].to_dict() == {18: 1, 20: 2, 22: 1}
    assert table["robust"].to_dict() == {18: True, 20: False, 22: False}
    assert table["mean_migration_angle_deg"][18] == pytest.approx(1 + np.mean(list(DI.values())))
    assert set(table["modes"]) == {"bump 3"}


def test_neighbours_of_a_full_grid():
    table = robustness(factorial(lambda r, g, n, d: r + 10.0 * g)).set_index(GEOMETRY)
    assert table.loc[(8, 20, 6), "neighbours"] == 6
    assert table.loc[(6, 18, 4), "neighbours"] == 3
    # steps of 2 in r, 20 in g, 0 in n
    assert table.loc[(8, 20, 6), "robustness_score_deg2"] == pytest.approx((4 + 400) * 2 / 6)
    assert table.loc[(6, 18, 4), "robustness_score_deg2"] == pytest.approx((4 + 400) / 3)


def test_tied_gap_and_radius_move_together():
    frame = factorial(lambda r, g, n, d: float(r), gaps=(16, 18, 20))
    table = robustness(frame[frame["gap_um"] == frame["pillar_radius_um"] + 10])
    assert len(table) == 9
    middle = table.set_index(GEOMETRY).loc[(8, 18, 6)]
    assert middle["neighbours"] == 4 and middle["robustness_score_deg2"] == pytest.approx(2.0)


def test_geometry_without_neighbour_has_no_score():
    frame = factorial(noisy(r=1), radii=(6, 8), gaps=(18, 20), rows=(4, 6))
    alone = pd.DataFrame(
        [
            {
                "pillar_radius_um": 30,
                "gap_um": 50,
                "periodicity": 9,
                "stiffness_set": "1",
                "deformation_index": 0.5,
                "migration_angle_deg": 1.0,
            }
        ]
    )
    row = robustness(pd.concat([frame, alone])).iloc[-1]
    assert row["neighbours"] == 0 and np.isnan(row["robustness_score_deg2"]) and not row["robust"]


def test_a_failed_run_is_not_sensitivity():
    frame = factorial(lambda r, g, n, d: 10 * d, radii=(6,), rows=(4,))
    frame.loc[0, "migration_angle_deg"] = np.nan
    assert robustness(frame)["robustness_score_deg2"].max() == pytest.approx(0)


def test_robust_share():
    rng = np.random.default_rng(0)
    table = robustness(factorial(lambda r, g, n, d: rng.normal()))
    assert table["robust"].sum() == 4
    worst = table.loc[table["robust"], "robustness_score_deg2"].max()
    assert (table.loc[~table["robust"], "robustness_score_deg2"] > worst).all()


def test_robustness_needs_angles():
    with pytest.raises(DldsimError, match="no row"):
        robustness(factorial(noisy()).assign(migration_angle_deg=np.nan))
    with pytest.raises(DldsimError, match="gap_um"):
        robustness(factorial(noisy()).drop(columns="gap_um"))


def test_most_frequent_values_of_the_stable_arrays():
    table = pd.DataFrame(
        {
            "pillar_radius_um": [6, 6, 8, 8],
            "gap_um": 20.0,
            "periodicity": [4, 5, 4, 5],
            "robustness_score_deg2": [1.0, 2.0, 3.0, np.nan],
            "robust": [True, True, False, False],
        }
    )
    found = most_frequent(table).set_index(["parameter", "value"])
    assert found.loc[("pillar_radius_um", 6.0), "count"] == 2
    assert found.loc[("pillar_radius_um", 6.0), "expected"] == pytest.approx(4 / 3)
    assert found.loc[("periodicity", 5.0), "expected"] == pytest.approx(2 / 3)
    assert ("pillar_radius_um", 8.0) not in found.index
