"""The stability sweep: its points, its rows, and what is said of them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from dldsim.config.presets import resolve
from dldsim.errors import DldsimError
from dldsim.evidence import stability_sweep as sweep
from dldsim.report import stability_figures
from dldsim.tables.parquet import read_table, write_table
from dldsim.tables.registry import COLUMNS

RAW = yaml.safe_load((Path(__file__).parents[2] / "config.yaml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def config():
    return resolve(RAW, {"numerics": {"spacing_um": 2.0, "velocity_lu": 0.004}})


def test_every_set_and_group_is_multiplied_up_to_a_thousand(config):
    for multiplier in (1, 10, 100, 1000):
        points = sweep.FAMILIES[f"stiffness-{multiplier}"].points(config)
        sets = [f"set {i}" for i in range(1, 6)]  # G5 and G6 are sets 3 and 4
        assert [p.label for p in points] == [*sets, "G1", "G2", "G3", "G4", "G7"]
        g7 = sweep.sections_of(points[-1], config)["stiffness"]
        assert g7.kb_pN_um == pytest.approx(3.5 * multiplier)  # as printed
        assert g7.ks_uN_per_m == pytest.approx(20.3 * multiplier)
        assert g7.kag_uN_per_m == 500


@pytest.mark.parametrize("name", sweep.FAMILIES)
def test_points_are_valid_and_differ(config, name):
    points = sweep.FAMILIES[name].points(config)
    sections = [sweep.sections_of(p, config) for p in points]
    assert len({str(s) for s in sections}) == len(points) > 3
    assert len({p.label for p in points}) == len(points)


@pytest.mark.slow
def test_rows_say_what_was_predicted_and_what_happened(config, tmp_path, monkeypatch):
    monkeypatch.setattr(
        sweep,
        "FAMILIES",
        {
            "gap": sweep._along("Gap", "P_g [µm]", "geometry", "gap_um", (4, 12)),
            "area": sweep._along("Area", "k_ag", "stiffness", "kag_uN_per_m", (50, 2e4)),
        },
    )
    said = []
    rows = sweep.run_family("gap", config, said.append) + sweep.run_family("area", config)
    write_table("stability", rows, tmp_path / "stability.parquet", {})
    narrow, wide, soft, stiff, insisted = read_table(
        "stability", tmp_path / "stability.parquet"
    ).to_dict("records")
    assert narrow["outcome"] == "refused" and "fewer than 4 nodes" in narrow["reason"]
    assert narrow["predicted_safe"] is None and np.isnan(narrow["margin"])
    assert wide["outcome"] == soft["outcome"] == stiff["outcome"] == "ran"
    assert stiff["refinement"] == pytest.approx(stiff["margin_elastic"]) and stiff["margin"] > 2
    assert insisted["time_step"] == "as-given" and insisted["outcome"] == "unstable"
    assert insisted["predicted_safe"] is False and stiff["predicted_safe"] is True
    assert said == ["gap 4: automatic: refused", "gap 12: automatic: ran"]


def row(**values):
    blank = {c.name: None for c in COLUMNS["stability"]}
    about = {
        "family": "gap",
        "title": "Gap",
        "label": "1",
        "parameter": 1.0,
        "parameter_of": "gap",
        "stiffness_set": "1",
        "reason": "",
    }
    return {**blank, **about, **values}


def test_verdict_finds_what_the_bound_got_wrong():
    rows = [
        row(time_step="automatic", predicted_safe=True, margin=0.4, outcome="ran"),
        row(time_step="automatic", predicted_safe=True, margin=0.9, outcome="unstable"),
        row(time_step="as-given", predicted_safe=False, margin=1.4, outcome="ran"),
        row(time_step="as-given", predicted_safe=False, margin=1.7, outcome="unstable"),
        row(time_step="as-given", predicted_safe=False, margin=9.0, outcome="unstable"),
        row(time_step="automatic", predicted_safe=None, outcome="refused"),
    ]
    found = sweep.verdict(rows)
    assert found["points"] == 6 and found["refused"] == 1
    assert [r["margin"] for r in found["broken"]] == [0.9]
    assert (found["least_failing"], found["largest_running"]) == (1.7, 1.4)


def test_an_unknown_family_is_refused():
    with pytest.raises(DldsimError, match="'gaps' is unknown. Did you mean gap.*Known: stiffness"):
        sweep.check_families(["gaps"])
    assert sweep.check_families([]) == list(sweep.FAMILIES)


def test_the_map_shows_every_point_with_a_margin():
    table = pd.DataFrame(
        [
            row(time_step="automatic", margin=0.4, outcome="ran", refinement=1.0),
            row(
                time_step="as-given",
                margin=1.7,
                outcome="unstable",
                family="bending",
                refinement=1.0,
            ),
            row(time_step="automatic", outcome="refused"),
        ]
    )
    axes = stability_figures.draw_map(table).axes[0]
    drawn = [line for line in axes.lines if line.get_marker() in "oXs"]
    assert [float(line.get_xdata()[0]) for line in drawn] == [0.4, 1.7]
