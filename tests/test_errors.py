"""An error carries facts, and its text is made of them."""

import pickle

from dldsim.errors import DldsimError, NoRoom


def test_the_text_is_made_of_the_facts():
    error = DldsimError(key="gap_um", value=9, allowed="> 12", remedy="Widen it.")
    assert str(error) == "gap_um = 9: allowed > 12. Widen it."
    assert (error.key, error.keys, error.faults) == ("gap_um", ("gap_um",), (error,))
    said = DldsimError("The gap is too small.", key=("gap_um", "radius_um"), remedy="Widen it.")
    assert str(said) == "The gap is too small. Widen it." and said.key == "gap_um"
    assert DldsimError("Cannot read it.").key == ""


def test_facts_survive_the_way_between_processes():
    one, other = DldsimError(key="a", value=1, allowed="2"), DldsimError(key="b", allowed="3")
    whole = pickle.loads(pickle.dumps(DldsimError("Two faults.", faults=(one, other))))
    assert str(whole) == "Two faults." and [f.key for f in whole.faults] == ["a", "b"]
    alone = pickle.loads(pickle.dumps(NoRoom("Too narrow.", key="gap_um", value=4)))
    assert isinstance(alone, NoRoom) and (alone.key, alone.value) == ("gap_um", 4)
    assert alone.faults == (alone,)
