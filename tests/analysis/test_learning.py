"""The survey beside a campaign: joined, or refused with what differs."""

import pytest

from dldsim.analysis import learning
from dldsim.config.sections import CellShape, Flow, Numerics
from dldsim.errors import DldsimError
from dldsim.tables.parquet import describe, write_table
from tests.analysis.made_outcomes import make_outcomes, make_survey
from tests.app.conftest import filled


def hashed(**flow):
    return learning.survey_hash(Numerics(), CellShape(), Flow(**flow))


def test_both_stand_in_one_table():
    survey = make_survey(8, 8)
    both = learning.with_survey(make_outcomes(), survey)
    assert both["source"].value_counts().to_dict() == {"campaign": 81, "survey": 16}
    alone = learning.with_survey(make_outcomes(), None)
    assert len(alone) == 81 and set(alone["source"]) == {"campaign"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"wanted_spacing_um": 2.0}, r"wanted_spacing_um 2\.0 \(survey: 1\.25\)"),
        ({"kernel": "linear"}, r"kernel linear \(survey: compact\)"),
        ({"lanes_in_domain": 4}, r"lanes_in_domain 4 \(survey: 2\)"),
        ({"images": "aligned"}, r"images aligned \(survey: dilute\)"),
        ({"release_axis": "z"}, r"release_axis z \(survey: y\)"),
        ({"drive": "axial"}, r"drive axial \(survey: no-lateral-flux\)"),
    ],
)
def test_other_numerics_are_named_with_the_remedy(change, words):
    with pytest.raises(DldsimError, match=words) as caught:
        learning.with_survey(make_outcomes().assign(**change), make_survey(8, 8))
    assert caught.value.key == "surrogate.survey"
    assert "surrogate.survey: false" in caught.value.remedy


def test_measured_rows_have_no_numerics_to_differ():
    outcomes = make_outcomes().astype(dict.fromkeys(learning.MADE_WITH, object))
    outcomes.loc[3, learning.MADE_WITH] = None
    assert len(learning.with_survey(outcomes, make_survey(8, 8))) == 97


def test_the_survey_is_read_where_it_is_asked_for(tmp_path, monkeypatch):
    path = tmp_path / "outcomes.parquet"
    monkeypatch.setattr(learning, "SURVEY", path)
    asked = {"surrogate": {"survey": True}}
    for act in (lambda: learning.survey_of(asked), hashed):
        with pytest.raises(DldsimError, match="No survey comes .* surrogate.survey: false"):
            act()
    assert learning.survey_of({"surrogate": {"survey": False}}) is None
    write_table("outcomes", filled("outcomes", make_survey(8, 8)), path, {})
    assert len(learning.survey_of(asked)) == 16
    before = hashed()
    write_table("outcomes", filled("outcomes", make_survey(8, 9)), path, {})
    assert len(before) == 16 and hashed() != before
    with pytest.raises(DldsimError, match=r"drive axial \(survey: no-lateral-flux\)"):
        hashed(drive="axial")
    monkeypatch.setattr("dldsim.tables.parquet.PHYSICS_VERSION", -1)
    with pytest.raises(DldsimError, match="cannot be learnt from: .*surrogate.survey: false"):
        learning.survey_of(asked)


def test_a_survey_is_kept_with_its_origin(tmp_path, monkeypatch):
    monkeypatch.setattr(learning, "SURVEY", tmp_path / "kept" / "outcomes.parquet")
    (tmp_path / "survey").mkdir()
    table = filled("outcomes", make_survey(8, 8))
    made_with = {"config_hash": "x", "seed": 1, "settings": {"seed": 1}}
    write_table("outcomes", table, tmp_path / "survey" / "outcomes.parquet", made_with)
    learning.keep_survey(tmp_path / "survey")
    assert len(learning.read_survey()) == 16
    assert describe(learning.SURVEY)["provenance"]["settings"] == {"seed": 1}
