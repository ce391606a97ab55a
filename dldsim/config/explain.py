"""Problems of a configuration in words: key, value, and what is allowed there."""

import difflib
import typing
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ValidationError

from dldsim.errors import DldsimError


def validate(model: type[BaseModel], values: Mapping) -> Any:
    """An instance of a section, or a DldsimError in three lines per problem."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        problems = [_problem(model, details) for details in error.errors()]
    raise DldsimError(
        "The configuration cannot be used:\n"
        + "\n".join(problems)
        + "\nCorrect it in config.yaml or on the command line."
    )


def did_you_mean(word: object, known: typing.Iterable) -> str:
    close = difflib.get_close_matches(str(word), [str(k) for k in known], n=1)
    return f" Did you mean {close[0]}?" if close else ""


def _problem(model: type[BaseModel], details: Mapping) -> str:
    """Key path, value, and what is allowed there, one line each."""
    loc, kind, value = details["loc"], details["type"], details["input"]
    path = ".".join(str(part) for part in loc) or "(whole configuration)"
    if kind == "extra_forbidden":
        siblings = _model_at(model, loc[:-1]).model_fields
        value = "unknown key" + (f" (= {value!r})" if not isinstance(value, dict | list) else "")
        allowed = f"{', '.join(siblings)}.{did_you_mean(loc[-1], siblings)}"
    elif kind == "missing":
        value, allowed = "missing", allowed_at(model, loc, details)
    else:
        value = "" if isinstance(value, dict | BaseModel) else repr(value)
        allowed = allowed_at(model, loc, details)
        if kind == "literal_error":
            allowed += did_you_mean(details["input"], _choices(_annotation_at(model, loc)))
    lines = [f"  key      {path}", f"  value    {value}" if value else "", f"  allowed  {allowed}"]
    return "\n".join(line for line in lines if line)


def _field_at(model: type[BaseModel], loc: tuple) -> tuple[Any, Any]:
    """Annotation and innermost named field at a key path."""
    annotation: Any = model
    field = None
    for part in loc:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            field = annotation.model_fields.get(part)
            annotation = field.annotation if field else Any
        else:
            arguments = [a for a in typing.get_args(annotation) if a is not type(None)]
            if not arguments:
                return Any, field
            same = isinstance(part, int) and typing.get_origin(annotation) is tuple
            annotation = arguments[part] if same and part < len(arguments) else arguments[-1]
        annotation = _without_none(annotation)
    return annotation, field


def _without_none(annotation: Any) -> Any:
    arguments = typing.get_args(annotation)
    rest = [a for a in arguments if a is not type(None)]
    return rest[0] if type(None) in arguments and len(rest) == 1 else annotation


def _annotation_at(model: type[BaseModel], loc: tuple) -> Any:
    return _field_at(model, loc)[0]


def _model_at(model: type[BaseModel], loc: tuple) -> type[BaseModel]:
    annotation = _annotation_at(model, loc)
    while typing.get_origin(annotation) is Annotated:
        annotation = typing.get_args(annotation)[0]
    return annotation


def _choices(annotation: Any) -> tuple:
    return typing.get_args(annotation) if typing.get_origin(annotation) is Literal else ()


def allowed_at(model: type[BaseModel], loc: tuple, details: Mapping) -> str:
    """Kind, range or choices, and meaning of the value at a key path."""
    annotation, field = _field_at(model, loc)
    if details["type"] == "value_error":
        return str(details["ctx"]["error"])
    limits = list(field.metadata) if field and isinstance(loc[-1], str) else []
    while typing.get_origin(annotation) is Annotated:
        annotation, *extra = typing.get_args(annotation)
        limits += [m for e in extra for m in (getattr(e, "metadata", None) or [e])]
    if choices := _choices(annotation):
        text = "one of " + ", ".join(map(str, choices))
    else:
        names = {int: "whole number", float: "number", str: "text", bool: "true or false"}
        text = names.get(annotation, "")
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    ranges = [
        f"{sign} {getattr(m, key)}"
        for m in limits
        for key, sign in signs.items()
        if getattr(m, key, None) is not None
    ]
    text = " ".join(filter(None, [text, " and ".join(ranges)])) or details["msg"]
    if details["type"] == "too_short":
        text = f"at least {details['ctx']['min_length']} of"
    elif details["type"] == "string_pattern_mismatch":
        text = f"text like {details['ctx']['pattern']}"
    return f"{text} ({field.description})" if field and field.description else text
