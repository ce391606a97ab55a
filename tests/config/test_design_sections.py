"""A design request names each cell type once, and says where it is at fault."""

import pytest

from dldsim.config.configuration import Config, Partial
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.explain import validate
from dldsim.errors import DldsimError

BOTH = {"name": "a", "ks_1_uN_per_m": 5.0, "ks_2_uN_per_m": 15.0}


def ask(**changes):
    named = {k: v for k, v in (BOTH | changes).items() if v is not None}
    return validate(DesignRequest, named)


def test_shapes_are_discs_unless_named():
    request = ask(shape_2="sphere")
    assert (request.shape_1, request.shape_2) == ("biconcave", "sphere")
    assert request.velocity_mm_s is None and request.height_um is None and request.assay is None


@pytest.mark.parametrize(
    "named",
    [
        {"deformation_index_1": 0.5, "deformation_index_std_1": 0.02, "assay": "mine"},
        {"stiffness_set_1": "1", "deformation_index_std_1": 0.02},
        {"rigid_1": True, "shape_1": "sphere"},
    ],
)
def test_a_cell_type_may_be_named_in_four_ways(named):
    assert ask(**({"ks_1_uN_per_m": None} | named)).ks_2_uN_per_m == 15.0


@pytest.mark.parametrize(
    ("changes", "words", "keys"),
    [
        ({"ks_1_uN_per_m": None}, "exactly one of deformation_index_1, stiffness_set_1", 4),
        ({"rigid_1": True}, "exactly one of", 4),
        ({"deformation_index_2": 0.5}, "stiffness_set_2, ks_2_uN_per_m and rigid_2", 4),
        ({"ks_1_uN_per_m": None, "rigid_1": True}, "rigid_1 with shape_1: sphere", 2),
        ({"deformation_index_std_1": 0.1}, "deformation_index_std_1 with deformation_index_1", 2),
        ({"deformation_index_std_1": -0.1}, r"deformation_index_std_1\n +value +-0.1", 1),
        ({"ks_1_uN_per_m": 0.0}, r"ks_1_uN_per_m\n +value +0.0", 1),
        ({"velocity_mm_s": 0}, r"velocity_mm_s\n +value +0", 1),
        (
            {"deformation_index_1": 55, "ks_1_uN_per_m": None},
            r"deformation_index_1\n +value +55",
            1,
        ),
    ],
)
def test_what_is_named_twice_or_not_at_all_is_refused(changes, words, keys):
    with pytest.raises(DldsimError, match=words) as caught:
        ask(**changes)
    assert len(caught.value.keys) == keys


def test_the_survey_is_learnt_from_unless_told_otherwise():
    assert Partial().surrogate.survey is True
    assert "surrogate" in Config.model_fields


def test_an_index_of_zero_is_given():
    """0 equals false, which says nothing."""
    asked = validate(
        DesignRequest, {"name": "a", "deformation_index_1": 0.0, "stiffness_set_2": "1"}
    )
    assert asked.deformation_index_1 == 0
    with pytest.raises(DldsimError, match="exactly one of"):
        validate(
            DesignRequest,
            {"name": "a", "deformation_index_1": 0, "ks_1_uN_per_m": 5, "stiffness_set_2": "1"},
        )


@pytest.mark.parametrize("values", [{"sample_width_um": 3000}, {"array_width_mm": 0.05}])
def test_a_sample_stream_that_fits_nowhere_has_no_allowed_positions(values):
    with pytest.raises(DldsimError, match="array_width_mm more than") as error:
        validate(Device, values)
    assert "between" not in str(error.value)
