"""The survey's points are numbered round by round."""

import pytest

from dldsim.config.explain import validate
from dldsim.config.survey_section import Survey
from dldsim.errors import DldsimError

DRAWN = {
    "pillar_radius_to_radius": [0.5, 1.7],
    "gap_to_radius": [1.4, 3.2],
    "periodicity": [4, 14],
    "capillary_number": [0.02, 1.0],
    "height_to_radius": [2.2, 4.0],
    "transition_band": [0.7, 2.2],
    "first_points": 2,
    "round_points": 1,
}


def test_rounds_follow_each_other_and_a_further_one_changes_no_number():
    shapes = {"biconcave": DRAWN, "sphere": DRAWN | {"round_points": 0}}
    members = Survey(rounds=1, shapes=shapes).members()
    assert members == [*[(0, "biconcave")] * 2, *[(0, "sphere")] * 2, (1, "biconcave")]
    assert Survey(rounds=2, shapes=shapes).members()[:5] == members
    assert Survey().members() == []


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"gap_to_radius": [3.2, 1.4]}, "gap_to_radius"),
        ({"capillary_number": [0, 1]}, "capillary_number.0"),
        ({"periodicity": [4.5, 6]}, "periodicity.0"),
        ({"first_points": 0}, "first_points"),
        ({"transition": [1, 2]}, "transition"),
    ],
)
def test_what_cannot_be_drawn_is_refused(change, key):
    with pytest.raises(DldsimError) as caught:
        validate(Survey, {"shapes": {"sphere": DRAWN | change}})
    assert caught.value.key == f"shapes.sphere.{key}"


def test_other_shapes_are_refused():
    with pytest.raises(DldsimError, match="ellipsoid"):
        validate(Survey, {"shapes": {"ellipsoid": DRAWN}})
