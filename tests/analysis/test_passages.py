"""Calibrations from passages: statistics by hand."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis.passages import calibrate, correlations
from dldsim.config.assay_sections import TableAssay
from dldsim.config.sections import Stiffness
from dldsim.errors import DldsimError
from dldsim.tables.parquet import write_table

SETS = {
    name: Stiffness(
        ks_uN_per_m=5.0 * int(name),
        kb_pN_um=0.04,
        kal_uN_per_m=10,
        kag_uN_per_m=500,
        kv_Pa=900,
        kvisc_nN_s_per_m=1.5,
    )
    for name in "12"
}


def table_assay():
    return TableAssay(kind="table", indices={"1": 0.4, "2": 0.5}, label="read elsewhere")


def assay_runs(centres=(0.5, 0.6, 0.7), offsets=(-0.02, 0.0, 0.02), varied="release"):
    """Membranes G1, G2, … with k_s 5, 10, …, index = centre + offset; the first passage varies
    nothing."""
    return pd.DataFrame(
        [
            {
                "assay": "gauge",
                "kind": "constriction",
                "cell_shape": "biconcave",
                "cell_radius_um": 7.5,
                "group": f"G{i}",
                "stiffness_set": str(i) if i < 3 else "",
                "ks_uN_per_m": 5.0 * i,
                "kb_pN_um": 0.04 * i**2,
                "kal_uN_per_m": 10.0 * i,
                "velocity_mm_s": 1.0 + 0.5 * i,
                "shear_stress_Pa": np.nan,
                "viscosity_mPa_s": 1.5,
                "varied": varied if k else "nothing",
                "deformation_index": centre + offset,
                "circularity_index": (centre + offset) / 10,
            }
            for i, centre in enumerate(centres, 1)
            for k, offset in enumerate(offsets)
        ]
    )


def test_statistics_by_hand():
    row = calibrate(assay_runs(), "gauge").set_index("group").loc["G1"]
    assert row["runs"] == 3 and row["default"]
    assert row["deformation_index"] == pytest.approx(0.5)
    assert row["deformation_index_std"] == row["std_release"] == pytest.approx(0.02)
    assert np.isnan(row["std_size"]) and np.isnan(row["std_offset"])
    assert row["deformation_index_min"] == pytest.approx(0.48)
    assert row["deformation_index_max"] == pytest.approx(0.52)
    assert row["coefficient_of_variation"] == pytest.approx(0.04)
    assert row["resolving_power"] == pytest.approx(0.1 / 0.02)
    assert row["resolving_power_all"] == pytest.approx(0.2 / 0.02)


def test_causes_add_in_squares():
    """Size: 0.49, 0.5, 0.51; off the axis: 0.5, 0.52."""
    runs = pd.concat(
        [
            assay_runs(offsets=(0.0, -0.01, 0.01), varied="size"),
            assay_runs(offsets=(0.0, 0.02), varied="offset").query("varied == 'offset'"),
        ]
    )
    row = calibrate(runs, "").set_index("group").loc["G1"]
    assert row["runs"] == 4 and not row["default"]
    assert row["std_size"] == pytest.approx(0.01)
    assert row["std_offset"] == pytest.approx(0.02 / 2**0.5)
    assert row["deformation_index_std"] == pytest.approx((0.01**2 + 0.02**2 / 2) ** 0.5)


def test_resolving_power_pools_both_ends_and_follows_stiffness():
    runs = assay_runs((0.7, 0.5, 0.6))
    wide = runs["group"] == "G1"
    runs.loc[wide, "deformation_index"] = 0.7 + 3 * (runs["deformation_index"][wide] - 0.7)
    table = calibrate(runs, "").set_index("group")
    pooled = ((0.06**2 + 0.02**2) / 2) ** 0.5
    assert table.loc["G1", "resolving_power"] == pytest.approx(0.2 / pooled)
    assert table.loc["G2", "resolving_power"] == pytest.approx(0.1 / 0.02)
    assert np.isnan(table.loc["G3", "resolving_power"])
    assert table["resolving_power_all"].to_numpy() == pytest.approx(0.1 / pooled)


def test_a_channel_has_a_second_curve():
    table = calibrate(assay_runs().assign(kind="channel"), "gauge")
    assert table["assay"].tolist() == ["gauge"] * 3 + ["gauge-circularity"] * 3
    assert table["default"].tolist() == [True] * 3 + [False] * 3
    assert table["deformation_index"][3] == pytest.approx(0.05)
    assert set(table["index"]) == {
        "(a − b)/(a + b) of the bounding box",
        "1 − circularity of the outline",
    }


def test_published_pairs_are_as_printed(tmp_path):
    table = calibrate(assay_runs(), "gauge", {"printed": (table_assay(), SETS)})
    printed = table[table["assay"] == "printed"]
    assert printed["deformation_index"].tolist() == [0.4, 0.5]
    assert printed["ks_uN_per_m"].tolist() == [5.0, 10.0]
    assert printed["runs"].tolist() == [0, 0] and set(printed["label"]) == {"read elsewhere"}
    assert printed["deformation_index_std"].isna().all()
    write_table("calibration", table, tmp_path / "calibration.parquet", {})


def test_failed_passages_are_left_out_and_counted():
    runs = assay_runs()
    runs.loc[[0, 3, 4, 6, 7, 8], "deformation_index"] = np.nan
    table = calibrate(runs, "gauge").set_index("group")
    assert table["runs"].to_dict() == {"G1": 2, "G2": 1, "G3": 0}
    assert table.loc["G1", "deformation_index"] == pytest.approx(0.51)
    assert np.isnan(table.loc["G2", "deformation_index_std"])
    assert np.isnan(table.loc["G3", "deformation_index"])


def test_correlations_know_a_straight_line_and_a_constant():
    table = correlations(assay_runs(offsets=(0.0,)))
    table = table.set_index(["variable_a", "variable_b"])
    assert len(table) == 10 and (table["n"] == 3).all()
    assert table.loc[("deformation_index", "ks_uN_per_m"), "pearson_r"] == pytest.approx(1)
    fixed = correlations(assay_runs().assign(velocity_mm_s=1.0))
    constant = fixed[fixed["variable_b"] == "velocity_mm_s"]
    assert constant["pearson_r"].isna().all()
    sheared = correlations(assay_runs().assign(velocity_mm_s=np.nan))
    assert len(sheared) == 6 and sheared["pearson_r"].notna().all()


def test_unusable_tables_are_refused():
    runs = assay_runs()
    with pytest.raises(DldsimError, match="group"):
        calibrate(runs.drop(columns="group"), "gauge")
    with pytest.raises(DldsimError, match="empty"):
        calibrate(runs.iloc[:0], "gauge")
    mixed = runs.assign(velocity_mm_s=np.arange(len(runs)))
    with pytest.raises(DldsimError, match="different velocity_mm_s"):
        calibrate(mixed, "gauge")
