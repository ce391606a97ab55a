"""Second page: what comes out of a device with an array of one's own, or of two in a row."""

from typing import Any

import streamlit as st

from dldsim.app.web.api import answers, field_limits, outcome_specs, specs
from dldsim.app.web.ui import cells_form, check_chapter, client, outlets_chapter, parts
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.parts import at_field, number

PLACE = "outcome"
ARRAY = {
    "pillar_radius_um": ("Pillar radius P_r", 9.0),
    "gap_um": ("Gap P_g", 12.0),
    "periodicity": ("Periodicity N_p [rows]", 10),
}
DEVICE = {
    "array_length_mm": "Length of the array",
    "array_width_mm": "Width of the array",
    "sample_position_mm": "Middle of the sample stream",
    "sample_width_um": "Width of the sample stream",
    "outlets": "Outlets",
}
WALL = "outlet_walls_um"
DRAWN = {
    "tolerance_um": "Fabrication tolerance ±",
    "draws": "Draws",
    "cells": "Cells",
    "seed": "Seed",
}


def page() -> None:
    st.title("What comes out of a device")
    info = parts.read_model()
    parts.provenance(info.provenance)
    check = check_chapter.current()
    if check is not None and "form:outcome_gap_um" not in st.session_state:
        _fill(check.spec)
    fields = {f.name: f for f in field_limits.limits_of(outcome_specs.OutcomeSpec)}
    spec = cells_form.show(PLACE, info, fields)
    spec |= _first(info, fields)
    spec |= _second(info, fields)
    if parts.campaign() is not None:
        spec["campaign"] = parts.campaign()
    parts.show_problem(PLACE)
    at_field(PLACE, "campaign", "")
    if st.button("Compute the outcome", type="primary", icon=":material/call_split:"):
        parts.clear(PLACE)
        try:
            st.session_state["outcome"] = spec, client.outcome(spec)
        except ApiError as error:
            st.session_state.pop("outcome", None)
            parts.keep(PLACE, error)
        st.rerun()
    if "outcome" in st.session_state:
        _answer(spec, *st.session_state["outcome"])
    if check is not None:
        if "outcome" not in st.session_state:
            st.divider()
            st.subheader("Simulated check")
        check_chapter.show(check)


def take(
    spec: specs.DesignSpec,
    design: dict[str, Any],
    array_length_mm: float | None,
    wall_um: float | None = None,
) -> None:
    """Put the cells of a design request, and array and wall of a candidate's mask, into the form.

    ``wall_um``: of two outlets; more are where the device has them.
    """
    cells_form.fill(spec.model_dump())
    for name in ARRAY:
        st.session_state[f"form:outcome_{name}"] = design[name]
    st.session_state["form:outcome_array_length_mm"] = array_length_mm
    st.session_state[f"form:outcome_{WALL}"] = wall_um
    for name in DRAWN:
        st.session_state[f"form:outcome_{name}"] = getattr(spec, name)


def _fill(spec: outcome_specs.CheckSpec) -> None:
    """Put the request of a check into the form, for one who comes back to it."""
    given = spec.model_dump()
    cells_form.fill(given)
    for name in (*ARRAY, *DEVICE, *DRAWN):
        st.session_state[f"form:outcome_{name}"] = given[name]
    walls = given[WALL] or [None]
    st.session_state[f"form:outcome_{WALL}"] = walls[0] if len(walls) == 1 else None
    st.session_state["form:simulate"] = given["simulate"]


def _array(fields: cells_form.Fields, form: str) -> dict[str, Any]:
    """Fields of an array."""
    spec: dict[str, Any] = {}
    for (name, (label, default)), column in zip(ARRAY.items(), st.columns(3), strict=True):
        with column:
            whole = name == "periodicity"
            spec[name] = number(fields[name], label, f"form:{form}_{name}", default, whole=whole)
            if form == PLACE:
                at_field(PLACE, name)
    return spec


def _device(
    info: answers.ModelInfo, fields: cells_form.Fields, form: str, *names: str
) -> dict[str, Any]:
    """Fields of the device around an array."""
    spec: dict[str, Any] = {}
    for name in names:
        own = info.device.get(name)
        spec[name] = number(
            fields[name],
            DEVICE[name],
            f"form:{form}_{name}",
            None,
            whole=name == "outlets",
            empty="the service's" if own is None else f"{own:g}",
        )
        if form == PLACE:
            at_field(PLACE, name)
    return spec


def _wall(fields: cells_form.Fields, form: str) -> dict[str, Any]:
    """The wall between two outlets."""
    wall = number(
        fields[WALL],
        "Wall between two outlets",
        f"form:{form}_{WALL}",
        None,
        empty="where it parts the cells best",
        about="middle of the wall between two outlets above the lower side wall",
    )
    at_field(PLACE, WALL)
    return {WALL: None if wall is None else [wall]}


def _first(info: answers.ModelInfo, fields: cells_form.Fields) -> dict[str, Any]:
    """Fields of the first array and, under more, of its device and the draws."""
    with st.container(border=True):
        st.markdown("**Array**")
        spec = _array(fields, PLACE)
    with st.expander("More about the device and the draws"):
        left, right = st.columns(2)
        with left:
            spec |= _device(info, fields, PLACE, *DEVICE)
            spec |= _wall(fields, PLACE)
        with right:
            for name, label in DRAWN.items():
                spec[name] = number(
                    fields[name],
                    label,
                    f"form:outcome_{name}",
                    fields[name].default,
                    whole=name != "tolerance_um",
                    empty="as many as are usual" if name == "draws" else None,
                )
                at_field(PLACE, name)
    return spec


def _second(info: answers.ModelInfo, fields: cells_form.Fields) -> dict[str, Any]:
    """Fields of a second device, if one is wanted."""
    wanted = st.toggle(
        "A second device behind an outlet (cascade)",
        key="form:cascade",
        help="What leaves an outlet of the first device is the sample of the second.",
    )
    if not wanted:
        return {}
    inner = {f.name: f for f in field_limits.limits_of(outcome_specs.DeviceSpec)}
    with st.container(border=True):
        st.markdown("**Second array**")
        outlet = number(fields["from_outlet"], "Fed by outlet", "form:from_outlet", 2, whole=True)
        at_field(PLACE, "from_outlet")
        then = _array(inner, "then")
        with st.expander("More about the second device"):
            left, right = st.columns(2)
            names = list(DEVICE)
            with left:
                then |= _device(info, inner, "then", *names[:3])
            with right:
                then |= _device(info, inner, "then", *names[3:])
        at_field(PLACE, "then")
    return {"then": then, "from_outlet": outlet}


def _answer(spec: dict[str, Any], asked: dict[str, Any], found: answers.OutcomeAnswer) -> None:
    st.divider()
    if asked != spec:
        st.caption("The fields were changed since; compute again.")
    if found.provenance.campaign != parts.campaign():
        parts.provenance(found.provenance)
    parts.warn(filter(None, [found.doubt]))
    names = list(dict.fromkeys(row.device for row in found.device_outcomes))
    for stage, name in enumerate(names, start=1):
        title = "At the outlets"
        if len(names) > 1:
            title += f" of the {('first', 'second')[stage - 1]} device"
        outlets_chapter.show(found, name, f"own-{stage}", title)
    outlets_chapter.notes(found)
    check_chapter.ask(asked)
