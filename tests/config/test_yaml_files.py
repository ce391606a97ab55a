"""YAML 1.2: what is written is what is read, and a fault has file, line and column."""

import pytest

from dldsim.config.yaml_files import parse_yaml, read_yaml
from dldsim.errors import DldsimError


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("010", 10),
        ("0o10", 8),
        ("0x1F", 31),
        ("-7", -7),
        ("1:30", "1:30"),
        ("1e5", 1e5),
        ("1.5e-3", 1.5e-3),
        (".5", 0.5),
        ("+3.", 3.0),
        ("yes", "yes"),
        ("off", "off"),
        ("true", True),
        ("~", None),
        ("", None),
        ("null", None),
        ("2026-01-02", "2026-01-02"),
        ("1_000", "1_000"),
        ('"1"', "1"),
        ("[1, a]", [1, "a"]),
        ("{a: {b: 1}}", {"a": {"b": 1}}),
        (".inf", float("inf")),
    ],
)
def test_scalars_are_those_of_yaml_1_2(text, value):
    found = parse_yaml(text)
    assert found == value and type(found) is type(value)


def test_anchors_and_merge_keys_still_work():
    text = "base: &b {x: 1, y: 2}\nother: {<<: *b, y: 3}\n"
    assert parse_yaml(text)["other"] == {"x": 1, "y": 3}


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("a: 1\nb: 2\na: 3\n", ["line 3, column 1", "key a stands here again", "line 1"]),
        ("a:\n  c: 1\n  c: 1\n", ["line 3, column 3", "key c"]),
        ('1: a\n"1": b\n', ["line 2", "key 1"]),
        ("a: [\n", ["line 2, column 1"]),
        ("a: 1\n\tb: 2\n", ["line 2, column 1"]),
    ],
)
def test_faults_have_file_line_and_column(text, parts, tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    with pytest.raises(DldsimError, match="is not valid YAML") as caught:
        read_yaml(path)
    assert all(part in str(caught.value) for part in [str(path), *parts]), str(caught.value)
    assert caught.value.key == str(path)


def test_what_cannot_be_read_is_told(tmp_path):
    with pytest.raises(DldsimError, match="Cannot read"):
        read_yaml(tmp_path / "none.yaml")
    path = tmp_path / "latin.yaml"
    path.write_bytes(b"a: \xe9\n")
    with pytest.raises(DldsimError, match="byte 3 is no UTF-8"):
        read_yaml(path)
