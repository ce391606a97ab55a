"""Second page: what comes out of a device with an array of one's own."""

from typing import Any

import streamlit as st

from dldsim.app.web.api import answers, specs
from dldsim.app.web.ui import cells_form, client, outlets_chapter, parts
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
    fields = {f.name: f for f in answers.limits_of(specs.OutcomeSpec)}
    spec = cells_form.show(PLACE, info, fields)
    spec |= _array(info, fields)
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


def _array(info: answers.ModelInfo, fields: cells_form.Fields) -> dict[str, Any]:
    """Fields of the array and, under more, of the device and the draws."""
    spec: dict[str, Any] = {}
    with st.container(border=True):
        st.markdown("**Array**")
        for (name, (label, default)), column in zip(ARRAY.items(), st.columns(3), strict=True):
            with column:
                whole = name == "periodicity"
                key = f"form:outcome_{name}"
                spec[name] = number(fields[name], label, key, default, whole=whole)
                at_field(PLACE, name)
    with st.expander("More about the device and the draws"):
        left, right = st.columns(2)
        with left:
            for name, label in DEVICE.items():
                own = info.device.get(name)
                spec[name] = number(
                    fields[name],
                    label,
                    f"form:outcome_{name}",
                    None,
                    whole=name == "outlets",
                    empty="the service's" if own is None else f"{own:g}",
                )
                at_field(PLACE, name)
        with right:
            for name, label in DRAWN.items():
                spec[name] = number(
                    fields[name],
                    label,
                    f"form:outcome_{name}",
                    fields[name].default,
                    whole=name != "tolerance_um",
                )
                at_field(PLACE, name)
    return spec


def _answer(spec: dict[str, Any], asked: dict[str, Any], found: answers.OutcomeAnswer) -> None:
    st.divider()
    if asked != spec:
        st.caption("The fields were changed since; compute again.")
    if found.provenance.campaign != parts.campaign():
        parts.provenance(found.provenance)
    parts.warn(filter(None, [found.doubt]))
    outlets_chapter.show(found, found.device_outcomes[0].device, "own")
