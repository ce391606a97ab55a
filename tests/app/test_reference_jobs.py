"""Jobs of the reference study and the spot check, on a made-up simulation."""

import math

import pytest

from dldsim.analysis import uncertainty
from dldsim.app import reference_jobs
from dldsim.config.identifiers import parse_outcome
from dldsim.config.presets import read_config
from dldsim.config.sections import Numerics
from dldsim.errors import DldsimError
from dldsim.evidence import critical_gaps, reference_study
from dldsim.tables.numerics import COLUMN_OF, columns_of
from dldsim.tables.parquet import read_rows, write_table
from dldsim.tables.registry import COLUMNS

pytestmark = pytest.mark.slow

SETTINGS = {"seed": 1}


@pytest.fixture(scope="module")
def config():
    return read_config("config.yaml")


def outcome(identifier, geometry, numerics, distance):
    """A row of `outcomes`: bump at a positive distance, else a third of it."""
    bump = math.degrees(math.atan(1 / geometry.periodicity))
    angle = bump if distance > 0 else bump / 3
    blank = {
        c.name: None if c.nullable else {"string": "", "int64": 2, "double": 1.0}[str(c.type)]
        for c in COLUMNS["reference_outcomes"]
        if c.name not in COLUMN_OF.values()
    }
    return blank | {
        "outcome_id": identifier,
        **geometry.model_dump(),
        "stiffness_set": identifier[-1],
        "cell_shape": "biconcave",
        "cell_radius_um": 7.5,
        "height_um": 20.0,
        "mean_velocity_mm_s": 0.5,
        "status": "decided",
        "start": "release",
        "mode": "bump" if distance > 0 else "mixed",
        "migration_angle_deg": angle,
        "angle_low_deg": angle - 0.01,
        "angle_high_deg": angle + 0.01,
        "bump_angle_deg": bump,
        "transition_distance": distance,
        "spacing_um": numerics["spacing_um"],
        "lag_number": numerics["reynolds_max"],
        "wall_time_s": 36.0,
        "rows_total": 24,
        **columns_of(Numerics(**numerics)),
    }


def distance_at(geometry, numerics):
    """A critical gap of 17.2 µm at the finest, 0.3 µm less per µm of spacing."""
    return 0.2 * (17.2 - 0.3 * numerics["spacing_um"] - geometry.gap_um)


def simulate(identifier, geometry, stiffness_set, settings):
    numerics = settings["numerics"]
    return outcome(identifier, geometry, numerics, distance_at(geometry, numerics))


@pytest.fixture(scope="module")
def pairs(tmp_path_factory, config):
    """Files of all pairs of the default plan."""
    rows, folder = [], tmp_path_factory.mktemp("pairs")
    for run, name in reference_study.pairs(config):
        path = folder / f"{run}--{name}.parquet"
        settings = reference_study.pair_settings(run, name, config)
        reference_jobs.outcome_job(run, settings, row=path, simulate=simulate)
        rows.append((run, name, path))
    return rows


@pytest.fixture(scope="module")
def results(tmp_path_factory, config, pairs):
    """A finished study: tables and model in the folder ``reference`` of results."""
    folder = tmp_path_factory.mktemp("results") / "reference"
    reference_jobs.gather_pairs(
        pairs,
        SETTINGS,
        outcomes=folder / "reference_outcomes.parquet",
        campaign=folder / "campaign_outcomes.parquet",
        domain=folder / "domain_outcomes.parquet",
        model=folder / "sigma_num.json",
        check=folder / "sigma_num_check.parquet",
    )
    searches = []
    for search in critical_gaps.searches(config):
        name, start = critical_gaps.search_id(search), None
        if search != search.at_campaign:
            start = _point(folder, search.at_campaign, critical_gaps.POINTS - 1)
        settings = critical_gaps.search_settings(search, config)
        before = None
        for number in range(critical_gaps.POINTS):
            table = _point(folder, search, number)
            reference_jobs.point_job(
                name, settings, before=before, start=start, table=table, simulate=simulate
            )
            before = table
        searches.append((name, before))
    sections = {"reference", "cell", "flow", "numerics", "run_control", "stiffness_sets"}
    reference_jobs.gather_gaps(
        searches,
        config.model_dump(mode="json", include=sections),
        gaps=folder / "critical_gaps.parquet",
        convergence=folder / "convergence.parquet",
    )
    return folder.parent


def _point(folder, search, number):
    return folder / "searches" / f"{critical_gaps.search_id(search)}--{number}.parquet"


def test_the_study_finds_the_made_up_critical_gap(results, config):
    """Where 17.2 µm − 0.3 times the spacing there is, in each search whose bracket holds it."""
    rows = read_rows("critical_gaps", results / "reference" / "critical_gaps.parquet")
    assert len(rows) == len(critical_gaps.searches(config))
    inside = [r for r in rows if r["critical_gap_um"] is not None]
    assert len(inside) > 20
    for row in inside:
        expected = 17.2 - 0.3 * row["spacing_um"]
        assert row["critical_gap_um"] == pytest.approx(expected, abs=0.01)
        assert row["low_um"] <= row["critical_gap_um"] <= row["high_um"]
    others = [r for r in rows if r["critical_gap_um"] is None]
    assert all("no transition" in r["note"] for r in others)
    started = [r for r in inside if r["knob"] != "campaign"]
    assert max(r["points"] for r in started) <= 4


def test_the_model_and_its_check_come_of_the_pairs(results, config):
    model = uncertainty.read_model(results / "reference" / "sigma_num.json")
    assert set(model["pairs"]) == set(config.reference.pairs)
    assert sum(side["pairs"] for side in model["distance"].values()) == len(config.reference.pairs)
    assert model["check"]["pairs"] == len(config.reference.pairs)
    domain = read_rows("reference_outcomes", results / "reference" / "domain_outcomes.parquet")
    assert {row["outcome_id"] for row in domain} == set(model["pairs"])
    assert {row["images"] for row in domain} == {"dilute"}
    for side in model["distance"].values():
        assert side["images"] == 0 < side["lattice"]  # as made up
    best = read_rows("reference_outcomes", results / "reference" / "reference_outcomes.parquet")
    finest = {r["outcome_id"] for r in best if r["wanted_spacing_um"] == 0.42}
    assert finest == set(config.reference.finest)


def test_what_is_installed_comes_back(results, tmp_path):
    data = tmp_path / "data"
    files = reference_study.install(results, data)
    assert (
        len(files) == 6
        and {f.parent for f in files} == {data / "biconcave"}
        and all(f.read_bytes() == (results / "reference" / f.name).read_bytes() for f in files)
    )
    rows = reference_study.reference_outcomes("biconcave", data)
    assert rows == read_rows(
        "reference_outcomes", results / "reference" / "reference_outcomes.parquet"
    )


def test_a_reference_of_other_physics_is_refused(results, tmp_path, monkeypatch):
    data = tmp_path / "data"
    reference_study.install(results, data)
    monkeypatch.setattr("dldsim.tables.parquet.PHYSICS_VERSION", -1)
    with pytest.raises(DldsimError, match="physics version"):
        reference_study.reference_outcomes("biconcave", data)
    with pytest.raises(DldsimError, match="physics version"):
        reference_study.install(results, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_the_comparison_says_who_disagrees(results, tmp_path, monkeypatch, config):
    data = tmp_path / "data"
    reference_study.install(results, data)
    monkeypatch.setattr(reference_study.reference_outcomes, "__defaults__", (data,))
    monkeypatch.setattr(uncertainty.read_models, "__defaults__", (data,))

    def wrong(identifier, geometry, stiffness_set, settings):
        numerics = settings["numerics"]
        distance = distance_at(geometry, numerics)
        return outcome(
            identifier,
            geometry,
            numerics,
            -distance if "r09.0_g12.0_n12" in identifier else distance,
        )

    rows = []
    for run in config.reference.pairs:
        rows.append(tmp_path / f"again-{run}.parquet")
        settings = reference_study.pair_settings(run, "campaign", config)
        reference_jobs.outcome_job(run, settings, row=rows[-1], simulate=wrong)
    sentence = reference_jobs.compare(rows, SETTINGS, table=tmp_path / "reference_check.parquet")
    found = read_rows("reference_check", tmp_path / "reference_check.parquet")
    apart = [r["outcome_id"] for r in found if r["verdict"].startswith("disagrees")]
    assert apart == ["r09.0_g12.0_n12_s5"] and "Apart: r09.0_g12.0_n12_s5 (" in sentence


def test_the_spot_check_compares_with_the_campaign(tmp_path):
    names = [f"r08.0_g{gap}.0_n10_s1" for gap in (14, 16, 20)]
    numerics = {"spacing_um": 1.2, "reynolds_max": 0.15}
    rows = [
        outcome(n, parse_outcome(n).geometry, numerics, 0.3)
        | {"sigma_num_deg": 0.1, "sigma_num_basis": "modelled"}
        for n in names
    ]
    names_of = {c.name for c in COLUMNS["outcomes"]}
    campaign = [{k: v for k, v in row.items() if k in names_of} for row in rows]
    write_table("outcomes", campaign, tmp_path / "outcomes.parquet", {})
    checks = [tmp_path / f"{n}.parquet" for n in names[:2]]
    for row, path, distance in zip(rows, checks, (0.3, -0.3), strict=False):
        name = row["outcome_id"]
        finer = numerics | {"spacing_um": 0.6}
        again = outcome(name, parse_outcome(name).geometry, finer, distance)
        write_table("reference_outcomes", [again], path, {})
    sentence = reference_jobs.gather_spot_check(
        tmp_path / "outcomes.parquet", checks, SETTINGS, table=tmp_path / "spot_check.parquet"
    )
    assert sentence.startswith("Spot check: 1 of 2 outcomes change") and "not hold" in sentence
    found = read_rows("spot_check", tmp_path / "spot_check.parquet")
    assert [r["verdict"].split(":")[0] for r in found] == ["holds", "changes"]
    cost = reference_jobs.spot_check_cost(tmp_path / "outcomes.parquet", names[:2], 2)
    assert f"{1.5 * 800 * 64 / 3600:.3g} hours" in cost
