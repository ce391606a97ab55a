"""The reference: its pairs, and what comes with the package."""

import pytest

from dldsim.config.identifiers import parse_outcome
from dldsim.config.study_sections import Domain, Reference
from dldsim.errors import DldsimError
from dldsim.evidence import reference_study as study
from dldsim.evidence.reference_study import CAMPAIGN
from dldsim.laws import whole_shift_spacing


def test_the_default_plan_is_large_enough(config):
    pairs = study.pairs(config)
    assert len(config.reference.pairs) >= 24 and len(config.reference.finest) == 6
    assert len(config.reference.critical_gaps) >= 6
    assert len(set(pairs)) == len(pairs)
    assert {name for _, name in pairs} == {CAMPAIGN, study.DOMAIN, study.REFERENCE, study.FINEST}


def with_domain(config, **domain):
    other = Domain(**domain) if domain else None
    return config.model_copy(
        update={"reference": config.reference.model_copy(update={"domain": other})}
    )


def test_another_domain_changes_nothing_else(config):
    run = config.reference.pairs[0]
    own, other = (study.pair_settings(run, name, config) for name in (CAMPAIGN, study.DOMAIN))
    domain = {"rows": 2, "lanes": 2, "images": "dilute"}
    assert other == own | {"numerics": own["numerics"] | domain}
    for none in ({}, {"rows": 1, "lanes": 2, "images": "dilute"}):
        assert study.DOMAIN not in {name for _, name in study.pairs(with_domain(config, **none))}


def test_a_domain_longer_than_a_period_is_refused(config):
    with pytest.raises(DldsimError, match=r"reference\.domain\.rows.*5.*at most 4"):
        study.pairs(with_domain(config, rows=5, lanes=1, images="aligned"))


def test_a_pair_differs_in_what_the_reference_names(config):
    run = config.reference.pairs[0]
    own, finer = (study.pair_settings(run, name, config) for name in (CAMPAIGN, study.REFERENCE))
    assert own["run_control"] == config.run_control.model_dump(mode="json")
    changed = {"spacing_um": 0.6, "reynolds_max": 0.1}
    places, rows = config.reference.releases, config.reference.rows
    control = own["run_control"] | {
        "release_gap_fractions": places,
        "max_rows": rows,
        "outcome_rows_max": rows * len(places),
    }
    assert finer == own | {"numerics": own["numerics"] | changed, "run_control": control}
    assert study.pair_settings(run, study.FINEST, config)["coarser"] == finer


def test_finest_must_be_pairs():
    with pytest.raises(ValueError, match="finest must be among pairs"):
        Reference(pairs=["r08.0_g17.0_n10_s1"], finest=["r08.0_g18.0_n10_s1"])


def test_every_pair_gets_a_finer_lattice(config):
    for run, name in study.pairs(config):
        array = parse_outcome(run).geometry
        own, there = (
            whole_shift_spacing(array, study.study_numerics(n, config)["spacing_um"])[0]
            for n in (CAMPAIGN, name)
        )
        assert there == own if name in (CAMPAIGN, study.DOMAIN) else there <= own / 1.5


# ------------------------------------------------------------------------------------ package data


def test_the_finest_row_of_a_pair_is_kept():
    rows = [("a", CAMPAIGN, 1), ("a", "reference", 2), ("a", "finest", 3), ("b", "reference", 4)]
    rows += [("b", study.DOMAIN, 5)]
    assert study.best_rows(rows) == [3, 4]
    assert study.best_rows(reversed(rows)) == [4, 3]


def test_without_a_reference_the_remedy_is_told(tmp_path):
    with pytest.raises(DldsimError, match="snakemake -j2 reference"):
        study.reference_outcomes("biconcave", tmp_path)


def test_nothing_is_installed_from_an_unfinished_study(tmp_path):
    with pytest.raises(DldsimError):
        study.install(tmp_path / "results", tmp_path / "data")
    assert not (tmp_path / "data").exists()
