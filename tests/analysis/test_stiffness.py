"""Moduli between stiffness sets."""

import pytest

from dldsim.analysis.stiffness import stiffness_at
from dldsim.config.sections import Stiffness
from dldsim.errors import DldsimError


def membrane(ks, kb):
    return Stiffness(
        ks_uN_per_m=ks,
        kb_pN_um=kb,
        kal_uN_per_m=2 * ks,
        kag_uN_per_m=500,
        kv_Pa=900,
        kvisc_nN_s_per_m=1.5,
    )


SETS = {"stiff": membrane(15.0, 0.3), "soft": membrane(5.0, 0.1)}


def test_moduli_are_linear_between_sets_and_none_is_lost():
    assert stiffness_at(5.0, SETS, "x") == SETS["soft"]
    assert stiffness_at(7.5, SETS, "x").model_dump() == pytest.approx(
        membrane(7.5, 0.15).model_dump()
    )


def test_beyond_the_sets_elastic_moduli_go_in_proportion():
    """The ratios of all moduli are those of the nearest set; membrane viscosity stays."""
    bead = stiffness_at(150.0, SETS, "x")
    assert bead.model_dump() == pytest.approx(
        {
            "ks_uN_per_m": 150.0,
            "kb_pN_um": 3.0,
            "kal_uN_per_m": 300.0,
            "kag_uN_per_m": 5000.0,
            "kv_Pa": 9000.0,
            "kvisc_nN_s_per_m": 1.5,
        }
    )
    assert stiffness_at(2.5, SETS, "x").kag_uN_per_m == pytest.approx(250)


@pytest.mark.parametrize(("ks", "sets"), [(0.0, SETS), (5.0, {}), (5.0, {"0": membrane(0.0, 0.1)})])
def test_without_a_spring_or_a_set_there_are_no_moduli(ks, sets):
    with pytest.raises(DldsimError, match="no moduli") as caught:
        stiffness_at(ks, sets, "ks_1_uN_per_m")
    assert caught.value.key == "ks_1_uN_per_m"


def test_sets_of_one_spring_constant_do_not_tell_the_other_moduli():
    other = SETS["soft"].model_copy(update={"kb_pN_um": 9.0})
    with pytest.raises(DldsimError, match="soft and bent have the same k_s of 5 µN/m"):
        stiffness_at(5.0, SETS | {"bent": other}, "x")
    assert stiffness_at(5.0, SETS | {"twin": SETS["soft"]}, "x") == SETS["soft"]
