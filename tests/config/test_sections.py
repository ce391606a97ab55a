"""Settings say what they mean; units match the source."""

from pathlib import Path

import pytest
import yaml

from dldsim.config.configuration import sections_from
from dldsim.config.explain import validate
from dldsim.config.presets import resolve
from dldsim.config.sections import Flow, Numerics
from dldsim.errors import DldsimError

ROOT = Path(__file__).parents[2]
RAW = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("places", [[], [0.5, 0.5], [1.5], [0.1234]])
def test_places_of_release_are_distinct_and_in_the_gap(places):
    with pytest.raises(DldsimError, match="run_control.release_gap_fractions"):
        resolve(RAW, {"run_control": {"release_gap_fractions": places}})


def test_a_campaign_has_no_single_place_of_release():
    """It would be ignored; the message says where the places are."""
    with pytest.raises(DldsimError, match="run_control.release_gap_fractions"):
        resolve(RAW, {"cell": {"release_gap_fraction": 0.3}})


def test_a_job_has_the_sections_that_it_was_handed_out_and_no_others():
    config = resolve(RAW)
    given = sections_from(config.model_dump(mode="json", include={"cell", "stiffness_sets"}))
    assert given.cell == config.cell and given.stiffness_sets == config.stiffness_sets
    with pytest.raises(AttributeError):
        _ = given.flow


def test_stiffness_units_are_converted_from_the_source():
    """Table 1 and the group table of the source, in nN, µm and µs."""
    sets = {
        "1": (0.0051, 4.3e-5, 0.0102),
        "2": (0.0076, 9.5e-5, 0.0152),
        "3": (0.01524, 2.5e-4, 0.03),
        "4": (0.01778, 3e-4, 0.035),
        "5": (0.0203, 3.5e-4, 0.0406),
    }
    groups = {
        "G1": (0.0051, 4.33e-5, 0.0102, 1.095),
        "G2": (0.0076, 9.526e-5, 0.0152, 1.5495),
        "G3": (0.01016, 1.5e-4, 0.0203, 1.8975),
        "G4": (0.0127, 2e-4, 0.02, 2.121),
        "G5": (0.01524, 2.5e-4, 0.03, 2.739),
        "G6": (0.01778, 3e-4, 0.035, 3.0),
        "G7": (0.0203, 3.5e-3, 0.0406, 3.0975),
    }
    config = resolve(RAW)
    assert set(config.stiffness_sets) == set(sets)
    assert set(config.constriction_groups) == set(groups)
    nano, micro = 1e-9, 1e-6
    pairs = [(config.stiffness_sets[name], row) for name, row in sets.items()]
    for name, (*row, velocity) in groups.items():
        group = config.constriction_groups[name]
        assert group.velocity_mm_s == velocity
        pairs.append((group.stiffness, row))
    for stiffness, (ks, kb, kal) in pairs:
        assert stiffness.ks_uN_per_m * 1e-6 == pytest.approx(ks * nano / micro)
        assert stiffness.kb_pN_um * 1e-18 == pytest.approx(kb * nano * micro)
        assert stiffness.kal_uN_per_m * 1e-6 == pytest.approx(kal * nano / micro)
        assert stiffness.kag_uN_per_m * 1e-6 == pytest.approx(0.5 * nano / micro)
        assert stiffness.kv_Pa == pytest.approx(0.9 * nano / micro**2)
        assert stiffness.kvisc_nN_s_per_m * 1e-9 == pytest.approx(1.5 * nano * micro / micro)


def test_stiffness_sets_are_calibrated_by_the_groups_of_the_source():
    groups = resolve(RAW).constriction_groups
    found = {g.stiffness_set: name for name, g in groups.items() if g.stiffness_set}
    assert found == {"1": "G1", "2": "G2", "3": "G5", "4": "G6", "5": "G7"}


@pytest.mark.parametrize(
    ("model", "values"), [(Flow, {"height_um": "1_0"}), (Numerics, {"rows": "1_0"})]
)
def test_numbers_are_written_in_plain_digits(model, values):
    with pytest.raises(DldsimError, match="in plain digits"):
        validate(model, values)
