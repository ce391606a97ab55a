"""The campaign lists what the sweep says; its closing sentence names what is broken."""

import os
from pathlib import Path

import pytest

from dldsim.config import campaign, identifiers
from dldsim.config.presets import read_config

CONFIG = Path(__file__).parents[2] / "config.yaml"


@pytest.mark.parametrize(("preset", "count"), [("quick", 81), ("paper", 180), ("full", 1050)])
def test_presets_have_the_promised_outcomes(preset, count):
    config = read_config(CONFIG, {"preset": preset})
    pairs = campaign.outcomes(config)
    assert len(pairs) == count == len({identifiers.outcome_id(pair) for pair in pairs})
    assert all(
        pair.geometry.gap_um > pair.geometry.pillar_radius_um + config.sweep.safety_distance_um
        for pair in pairs
    )


def test_paper_ties_gap_to_radius():
    config = read_config(CONFIG, {"preset": "paper"})
    assert all(g.gap_um == g.pillar_radius_um + 10 for g in campaign.geometries(config))
    assert len(campaign.geometries(config)) == 36


def test_children_import_from_the_folder_of_the_workflow(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", "/a:/b")
    for _ in range(2):
        campaign.import_from(Path("/c d"))
        assert os.environ["PYTHONPATH"] == "/c d:/a:/b"


def test_crashes_are_counted(tmp_path):
    assert campaign.count_crashes(tmp_path, "run") == 0
    for count in (1, 2):
        campaign.record_crash(tmp_path, "run", "out of memory\nsecond line")
        assert campaign.count_crashes(tmp_path, "run") == count


@pytest.mark.parametrize("content", ["", "\n", "two\n", "\x00\x00"])
def test_a_damaged_record_blocks_nothing_and_is_tried_again(content, tmp_path):
    campaign.record_crash(tmp_path, "run", "out of memory")
    (tmp_path / "run.txt").write_text(content)
    assert campaign.count_crashes(tmp_path, "run") == campaign.DAMAGED
    campaign.record_crash(tmp_path, "run", "out of memory")
    assert campaign.count_crashes(tmp_path, "run") == 1


def test_closing_sentence_names_what_is_broken_or_open(tmp_path):
    (tmp_path / "outcomes.csv").write_text(
        "outcome_id,status,stop_reason\na,decided,\nb,failed,no memory\nc,undecided,\n"
        "d,coexisting,\n"
    )
    sentence = campaign.closing_sentence(tmp_path)
    assert "1 of 4 outcomes have no angle" in sentence and "b (failed: no memory)" in sentence
    assert "1 of 4 are undecided" in sentence and "1 of 4 are coexisting" in sentence


def test_closing_sentence_says_where_the_time_went(tmp_path):
    for name, seconds in (("outcome/a", 90.0), ("outcome/b", 60.0), ("report", 30.0)):
        path = tmp_path / "benchmarks" / f"{name}.tsv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"s\th:m:s\n{seconds}\t0:00:00\n", encoding="utf-8")
    assert campaign.time_split(tmp_path) == {"outcome": 150.0, "report": 30.0}
    assert campaign.closing_sentence(tmp_path).endswith(
        "Time of all jobs together: 3.0 minutes (outcome 83%, report 17%)."
    )
    assert "Time" not in campaign.closing_sentence(tmp_path / "other")
