"""Problems of a configuration in words: key, value, and what is allowed there."""

import difflib
import types
import typing
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Tag, ValidationError, create_model

from dldsim.config.sections import Section, Unfit
from dldsim.errors import DldsimError


def validate(model: type[BaseModel], values: Mapping) -> Any:
    """An instance of a section, or a DldsimError in three lines per problem; its `faults` have key,
    value and what is allowed."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        faults = [fault_of(model, details) for details in error.errors()]
    raise DldsimError(
        "The configuration cannot be used:\n"
        + "\n".join(map(str, faults))
        + "\nCorrect it in config.yaml or on the command line.",
        key=[key for fault in faults for key in fault.keys],
        faults=faults,
    )


def check_value(model: type[BaseModel], key: str, value: Any) -> Any:
    """A value for one field of a section alone. Raises DldsimError as `validate` does."""
    field = model.model_fields[key]
    only: dict[str, Any] = {key: (field.annotation, field)}
    alone = create_model(model.__name__, __base__=Section, **only)
    return getattr(validate(alone, {key: value}), key)


def did_you_mean(word: object, known: typing.Iterable) -> str:
    close = difflib.get_close_matches(str(word), [str(k) for k in known], n=1)
    return f" Did you mean {close[0]}?" if close else ""


def fault_of(model: type[BaseModel], details: Mapping) -> DldsimError:
    """One of pydantic's problems as an error of key path, value, and what is allowed there."""
    loc, kind, value = tuple(details["loc"]), details["type"], details["input"]
    if loc and loc[-1] == "[key]":  # the name of an entry
        loc = loc[:-1]
    if kind.startswith("union_tag"):
        loc, value = (*loc, "kind"), details.get("ctx", {}).get("tag")
        kind = "missing" if value is None else kind
    path = ".".join(str(part) for part in untagged(model, loc))
    inner = getattr(details.get("ctx", {}).get("error"), "keys", ())
    keys = [f"{path}.{key}" if path else key for key in inner] or [path]
    shown = "" if isinstance(value, dict | BaseModel) else repr(value)
    if inner and isinstance(value, dict):  # settings that do not fit each other
        shown = ", ".join(repr(value[key]) for key in inner if key in value)
    allowed = allowed_at(model, loc, details)
    if kind in ("extra_forbidden", "invalid_key"):
        shown = "unknown key" + (f" (= {value!r})" if not isinstance(value, dict | list) else "")
    elif kind == "missing":
        shown = "missing"
    elif kind in ("literal_error", "union_tag_invalid"):
        allowed += did_you_mean(value, _choices(_annotation_at(model, loc)))
    lines = [
        f"  key      {', '.join(filter(None, keys)) or '(whole configuration)'}",
        f"  value    {shown}" if shown else "",
        f"  allowed  {allowed}",
    ]
    return DldsimError(
        "\n".join(line for line in lines if line), key=keys, value=value, allowed=allowed
    )


def _tagged(annotation: Any) -> dict[str, Any]:
    """The sections of a union that are told apart by a tag, by tag; empty for anything else."""
    if typing.get_origin(annotation) is Annotated:
        annotation = typing.get_args(annotation)[0]
    return {
        mark.tag: typing.get_args(choice)[0]
        for choice in typing.get_args(annotation)
        if typing.get_origin(choice) is Annotated
        for mark in choice.__metadata__
        if isinstance(mark, Tag)
    }


def untagged(model: type[BaseModel], loc: tuple) -> tuple:
    """A key path without the tags of unions, which are no keys."""
    return tuple(
        part for i, part in enumerate(loc) if part not in _tagged(_field_at(model, loc[:i])[0])
    )


def _field_at(model: type[BaseModel], loc: tuple) -> tuple[Any, Any]:
    """Annotation and innermost named field at a key path."""
    annotation: Any = model
    field = None
    for part in loc:
        if tagged := _tagged(annotation):
            if part == "kind":
                return Literal[tuple(tagged)], None
            annotation = tagged.get(part, Any)
        elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
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


NAMES = {int: "whole number", float: "number", str: "text", bool: "true or false"}
SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


def allowed_at(model: type[BaseModel], loc: tuple, details: Mapping) -> str:
    """Kind, range or choices, and meaning of the value at a key path."""
    kind, context = details["type"], details.get("ctx", {})
    if kind in ("extra_forbidden", "invalid_key"):
        siblings = _model_at(model, loc[:-1]).model_fields
        return f"{', '.join(siblings)}.{did_you_mean(loc[-1], siblings)}"
    annotation, field = _field_at(model, loc)
    own = isinstance(context.get("error"), ValueError)
    if own and isinstance(context["error"], Unfit):
        return str(context["error"])
    text = _described(
        annotation, list(field.metadata) if field and isinstance(loc[-1], str) else []
    )
    if own:
        text = (
            f"{text}, {context['error']}"
            if isinstance(loc[-1], str) and text
            else str(context["error"])
        )
    elif kind == "too_short":
        text = f"at least {context['min_length']} of"
    elif kind == "too_long":
        text = f"at most {context['max_length']} of"
    elif kind == "string_pattern_mismatch":
        text = f"text like {context['pattern']}"
    text = text or details["msg"]
    return f"{text} ({field.description})" if field and field.description else text


def _described(annotation: Any, limits: list) -> str:
    """What a value of this type is, in plain words."""
    while typing.get_origin(annotation) is Annotated:
        annotation, *extra = typing.get_args(annotation)
        limits += [m for e in extra for m in (getattr(e, "metadata", None) or [e])]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"a section with some of the keys {', '.join(annotation.model_fields)}"
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if choices := _choices(annotation):
        text = "one of " + ", ".join(map(str, choices))
    elif origin is list:
        text = f"a list, each entry {_described(inner[0], []) or 'a value'}"
    elif origin is tuple:
        text = f"a list of {len(inner)}, each entry {_described(inner[0], [])}"
    elif origin is dict:
        text = f"names, each with {_described(inner[1], []) or 'a value'}"
    elif origin in (typing.Union, types.UnionType):
        parts = [_described(part, []) for part in inner if part is not type(None)]
        text = " or ".join(dict.fromkeys(filter(None, parts)))
    else:
        text = NAMES.get(annotation, "")
    ranges = [
        f"{sign} {getattr(m, key)}"
        for m in limits
        for key, sign in SIGNS.items()
        if isinstance(getattr(m, key, None), int | float)
    ]
    return " ".join(filter(None, [text, " and ".join(ranges)]))
