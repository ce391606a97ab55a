"""YAML as of version 1.2, as everybody reads it: 010 is ten, 1:30 and yes are texts, and a key that
stands twice is an error."""

import re
from pathlib import Path
from typing import Any

from dldsim.errors import DldsimError

_SCALARS = (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        "-+.0123456789",
    ),
    ("merge", "<<", "<"),
)


def _loader():
    """The class of loaders; PyYAML is imported only where a file is read."""
    import yaml

    class Loader(yaml.SafeLoader):
        yaml_implicit_resolvers: dict = {}

        def construct_mapping(self, node, deep=False):
            seen: dict[str, Any] = {}
            for key, _ in node.value:
                if key.tag == "tag:yaml.org,2002:merge":
                    continue
                text = str(self.construct_object(key, deep=True))
                if text in seen:
                    raise yaml.constructor.ConstructorError(
                        None,
                        None,
                        f"the key {text} stands here again; it stands in line "
                        f"{seen[text].line + 1} already",
                        key.start_mark,
                    )
                seen[text] = key.start_mark
            return super().construct_mapping(node, deep)

    def whole_number(loader, node):
        text = node.value
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))

    for name, pattern, first in _SCALARS:
        tag = f"tag:yaml.org,2002:{name}"
        Loader.add_implicit_resolver(tag, re.compile(rf"^(?:{pattern})$"), list(first))
    Loader.add_constructor("tag:yaml.org,2002:int", whole_number)
    return Loader


def parse_yaml(text: str) -> Any:
    """The value of a YAML text. Raises yaml.YAMLError, with a place where one is known."""
    import yaml

    return yaml.load(text, _loader())  # a SafeLoader


def read_yaml(path: Path) -> Any:
    """The value of a YAML file. Raises DldsimError that names file, line and column."""
    import yaml

    try:
        return parse_yaml(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise DldsimError(
            f"Cannot read the configuration {path}: {error.strerror}.", key=str(path)
        ) from error
    except UnicodeDecodeError as error:
        raise DldsimError(
            f"The configuration {path} is not valid YAML: byte {error.start} is no UTF-8.",
            key=str(path),
        ) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = " ".join((getattr(error, "problem", None) or str(error)).split())
        raise DldsimError(
            f"The configuration {path} is not valid YAML{place}: {problem}.", key=str(path)
        ) from error
