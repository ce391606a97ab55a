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


def test_beyond_the_sets_is_refused():
    with pytest.raises(DldsimError, match="5 to 15") as caught:
        stiffness_at(16.0, SETS, "deformation_index_1")
    assert caught.value.key == "deformation_index_1"
