"""Identifiers are their own inverse; the campaign lists what the sweep says."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dldsim.config import campaign, identifiers
from dldsim.config.presets import read_config
from dldsim.config.provenance import STAMP, check_stamp, derive_seed, settings_hash
from dldsim.config.sections import Geometry
from dldsim.errors import DldsimError

CONFIG = Path(__file__).parents[2] / "config.yaml"

lengths = st.integers(1, 999_999).map(lambda n: n / 1000)
geometries = st.builds(
    Geometry, pillar_radius_um=lengths, gap_um=lengths, periodicity=st.integers(2, 100)
)
names = st.from_regex(r"[A-Za-z0-9-]+", fullmatch=True)


places = st.integers(0, 1000).map(lambda n: n / 1000)


@given(geometries, names, places)
def test_ids_are_their_own_inverse(geometry, name, place):
    pair = identifiers.Pair(geometry, name)
    outcome = identifiers.outcome_id(pair)
    assert identifiers.parse_outcome(outcome) == pair
    assert identifiers.parse_run(identifiers.run_id(outcome, place)) == (outcome, place)
    assert identifiers.parse_geometry(identifiers.geometry_id(geometry)) == geometry


@given(names, st.integers(0, 99), st.sampled_from(["group-velocity", "fixed-velocity"]))
def test_constriction_id_is_its_own_inverse(group, position, design):
    text = identifiers.constriction_id(group, position, design)
    assert identifiers.parse_constriction(text) == (group, position, design)


def test_ids_look_as_documented():
    pair = identifiers.Pair(Geometry(pillar_radius_um=6, gap_um=18, periodicity=8), "3")
    assert identifiers.outcome_id(pair) == "r06.0_g18.0_n08_s3"
    assert identifiers.run_id("r06.0_g18.0_n08_s3", 0.5) == "r06.0_g18.0_n08_s3_y0.50"
    assert identifiers.run_id("r06.0_g18.0_n08_s3", 0.125) == "r06.0_g18.0_n08_s3_y0.125"


@given(st.lists(st.integers(1, 999).map(lambda n: n / 10), min_size=2, max_size=9))
def test_ids_sort_like_numbers(radii):
    def text(radius):
        return identifiers.geometry_id(Geometry(pillar_radius_um=radius, gap_um=20, periodicity=4))

    assert [text(r) for r in sorted(radii)] == sorted(text(r) for r in radii)


@pytest.mark.parametrize(
    "text", ["", "r6.0_g18.0_n08_s3", "r06.00_g18.0_n08_s3", "r06.0_g18.0_n08", "r06.0_g18.0_n08_s"]
)
def test_other_texts_are_no_ids(text):
    with pytest.raises(DldsimError, match="identifier"):
        identifiers.parse_outcome(text)
    with pytest.raises(DldsimError, match="identifier"):
        identifiers.parse_run(f"{text}_y0.50")


@pytest.mark.parametrize("place", ["", "_y", "_y0.5", "_y0.500", "_y1.50", "_y0.1234", "_y-0.50"])
def test_other_places_are_no_run_ids(place):
    with pytest.raises(DldsimError, match="identifier"):
        identifiers.parse_run(f"r06.0_g18.0_n08_s3{place}")


def test_id_refuses_what_it_cannot_carry():
    with pytest.raises(DldsimError, match="three decimals"):
        identifiers.geometry_id(Geometry(pillar_radius_um=6.0001, gap_um=18, periodicity=8))
    geometry = Geometry(pillar_radius_um=6, gap_um=18, periodicity=8)
    with pytest.raises(DldsimError, match="letters, digits"):
        identifiers.outcome_id(identifiers.Pair(geometry, "a/b"))
    for place in (0.1234, -0.1, 1.01):
        with pytest.raises(DldsimError, match="three decimals"):
            identifiers.run_id("r06.0_g18.0_n08_s3", place)


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


def test_constrictions_count_groups_and_positions():
    channel = {"release_positions_um": [0, 5], "fixed_velocity_mm_s": 2.0}
    config = read_config(CONFIG, {"constriction": channel})
    assert len(campaign.constrictions(config)) == len(set(campaign.constrictions(config))) == 28
    alone = read_config(CONFIG, {"constriction": channel | {"fixed_velocity_mm_s": None}})
    assert len(campaign.constrictions(alone)) == 14


def test_seeds_differ_by_name_and_repeat():
    seeds = {derive_seed(seed, name) for seed in range(4) for name in "abc"}
    assert len(seeds) == 12
    assert derive_seed(1, "a") == derive_seed(1, "a") < 2**31


def test_settings_hash_ignores_order_only():
    assert settings_hash({"a": 1, "b": 2}) == settings_hash({"b": 2, "a": 1})
    assert settings_hash({"a": 1}) != settings_hash({"a": 2})


def test_crashes_are_counted(tmp_path):
    assert campaign.count_crashes(tmp_path, "run") == 0
    for count in (1, 2):
        campaign.record_crash(tmp_path, "run", "out of memory\nsecond line")
        assert campaign.count_crashes(tmp_path, "run") == count


def test_stamp_of_other_physics_is_refused(tmp_path):
    check_stamp(tmp_path)
    stamp = tmp_path / STAMP
    stamp.write_text('{"dldsim_version": "0.0.1", "physics_version": -1}')
    with pytest.raises(DldsimError, match="--forceall"):
        check_stamp(tmp_path)
    stamp.write_text("{")
    with pytest.raises(DldsimError, match="damaged"):
        check_stamp(tmp_path)


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
        "Time of all jobs together: 3.0 minutes (outcome 83%, report 17%).")
    assert "Time" not in campaign.closing_sentence(tmp_path / "other")
