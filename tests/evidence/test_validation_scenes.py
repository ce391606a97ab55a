"""What scenes do without gives the same result."""

from dldsim.evidence import validation_scenes as scenes


def test_left_out_terms_and_rows_change_nothing(monkeypatch):
    monkeypatch.setattr(scenes, "REPEATS", 1)
    monkeypatch.setattr(scenes, "STEPS", 10)
    rows = [*scenes._terms(), *scenes._later_rows(), *scenes._solid()]
    marked = [row for row in rows if row.mark is not None]
    assert len(marked) == 4 and all(abs(row.error) <= row.mark for row in marked)
    assert all(row.value > 0 for row in rows if row.quantity == scenes.TIME)


def test_a_term_that_matters_would_be_noticed(monkeypatch):
    monkeypatch.setattr(scenes, "REPEATS", 1)
    monkeypatch.setattr(scenes, "STEPS", 10)
    monkeypatch.setattr(scenes, "NOTHING", 0.1)
    assert all(row.error > row.mark for row in scenes._terms() if row.mark is not None)
