"""Fields of both cell types and their flow, the same for designs and outcomes."""

from collections.abc import Mapping
from math import ceil, floor
from typing import Any

import streamlit as st

from dldsim.app.web.api import answers, field_limits
from dldsim.app.web.ui.in_domain import SHAPES, index_range
from dldsim.app.web.ui.parts import allowed, at_field, number, plain

BY_INDEX, BY_SET, BY_SPRING, BY_RIGID = (
    "deformation index",
    "stiffness set",
    "spring constant k_s",
    "bead",
)
FIELD = {
    BY_INDEX: "deformation_index_{}",
    BY_SET: "stiffness_set_{}",
    BY_SPRING: "ks_{}_uN_per_m",
    BY_RIGID: "rigid_{}",
}
"""How a cell type is given, and the field of the request that gives it."""
KEPT = (
    "shape_{}",
    "deformation_index_std_{}",
    "radius_{}_um",
    "radius_std_{}_um",
    "radius_cv_{}",
    "ks_cv_{}",
    "population_{}_csv",
)
TOLD = ("deformation_index", "ks_un_per_m")
"""Columns of measured cells that tell how deformable they are."""
SHARED = ("assay", "velocity_mm_s", "height_um", "concentration_ratio", "radius_distribution")

Fields = Mapping[str, field_limits.FieldLimit]


def fill(given: Mapping[str, Any]) -> None:
    """Put both cell types of a request into the form."""
    state = st.session_state
    for i in "12":
        for kind, key in FIELD.items():
            name = key.format(i)
            if given[name] is not None and given[name] is not False:
                state[f"form:by_{i}"] = kind
                state[f"form:{name}"] = given[name]
        for key in KEPT:
            state[f"form:{key.format(i)}"] = given[key.format(i)]
    for key in SHARED:
        state[f"form:{key}"] = given[key]


def show(place: str, info: answers.ModelInfo, fields: Fields) -> dict[str, Any]:
    """Fields of both cell types and their flow; what the API says of them is shown at ``place``."""
    spec: dict[str, Any] = {}
    assay = st.session_state.get("form:assay")
    for i, column in zip("12", st.columns(2), strict=True):
        with column.container(border=True):
            spec |= _cell(place, i, info, fields, assay)
    with st.expander("More about cells and flow: assay, velocity, height, mixture"):
        spec |= _shared(place, info, fields)
    return spec


def _cell(
    place: str, i: str, info: answers.ModelInfo, fields: Fields, assay: str | None
) -> dict[str, Any]:
    """Fields of one cell type."""
    colour = ("blue", "orange")[int(i) - 1]
    st.markdown(f"**:{colour}[Cell type {i}]**")
    state, found = st.session_state, {}
    shapes = [s for s in SHAPES if s in info.domain["shapes"]]
    if state.get(f"form:shape_{i}") not in shapes:
        state[f"form:shape_{i}"] = shapes[0]
    shape = found[f"shape_{i}"] = st.radio(
        "Shape at rest", shapes, key=f"form:shape_{i}", format_func=SHAPES.get, horizontal=True
    )
    at_field(place, f"shape_{i}")
    table = state.get(f"form:population_{i}_csv")
    told = table is not None and any(name in table.lower() for name in TOLD)
    if told:
        st.caption("Deformability: of the measured cells below.")
        at_field(place, *(key.format(i) for key in FIELD.values()))
    else:
        found |= _deformability(place, i, info, fields, assay, shape)
    if table is None:
        left, right = st.columns(2)
        with left:
            name = f"radius_{i}_um"
            found[name] = number(
                fields[name],
                "Cell radius R",
                f"form:{name}",
                fields[name].default,
                about="Largest radius of the cell at rest, mean of the cell type",
            )
            st.caption(f"allowed {allowed(fields[name])}")
            at_field(place, name)
        with right:
            name = f"radius_std_{i}_um"
            relative = state.get(f"form:radius_cv_{i}") is not None
            value = number(
                fields[name],
                "± SD of the radius",
                f"form:{name}",
                None,
                empty=f"CV {state[f'form:radius_cv_{i}']:g}" if relative else "0",
                about="Standard deviation of the radius among cells of this type",
            )
            found[name] = value
            found[f"radius_cv_{i}"] = state.get(f"form:radius_cv_{i}") if value is None else None
            at_field(place, name, f"radius_cv_{i}")
    with st.expander("More: measured cells", expanded=table is not None):
        found |= _table(place, i, table)
        if not told and (by := state[f"form:by_{i}"]) in (BY_SET, BY_SPRING):
            name = f"ks_cv_{i}"
            if found.get(f"deformation_index_std_{i}") is None:
                found[name] = number(
                    fields[name], "Coefficient of variation of k_s", f"form:{name}", None, empty="0"
                )
                at_field(place, name)
            else:
                st.caption(f"The spread of k_s follows from ± of the {by}.")
    return found


def _deformability(
    place: str, i: str, info: answers.ModelInfo, fields: Fields, assay: str | None, shape: str
) -> dict[str, Any]:
    low, high = index_range(info, assay)
    sets = {s.stiffness_set: s for s in info.stiffness_sets}
    usable = sorted(sets.values(), key=lambda s: s.deformation_index)
    kinds = [BY_INDEX, *([BY_SET] if usable else []), BY_SPRING]
    kinds += [BY_RIGID] if shape == "sphere" else []
    key = f"form:by_{i}"
    if st.session_state.get(key) not in kinds:
        st.session_state[key] = BY_INDEX if shape == "biconcave" else BY_SPRING
    kind = st.radio("given by", kinds, key=key, horizontal=True, label_visibility="collapsed")
    name = FIELD[kind].format(i)
    if kind == BY_RIGID:
        st.caption("A bead: nothing deforms it.")
        at_field(place, name)
        return {name: True}
    left, right = st.columns(2)
    found: dict[str, Any] = {}
    with left:
        if kind == BY_SET:
            names = [s.stiffness_set for s in usable]
            if st.session_state.get(f"form:{name}") not in names:
                st.session_state[f"form:{name}"] = names[0 if i == "1" else -1]
            found[name] = st.selectbox(
                "Stiffness set",
                names,
                key=f"form:{name}",
                help="A membrane of the campaign.",
                format_func=lambda n: f"{n} (DI {sets[n].deformation_index:.4f})",
            )
        elif kind == BY_SPRING:
            found[name] = number(
                fields[name], "Spring constant k_s", f"form:{name}", (5.0, 20.0)[int(i) - 1]
            )
        else:
            ends = (ceil(low * 1e4) / 1e4, floor(high * 1e4) / 1e4)
            found[name] = number(
                fields[name],
                "Deformation index",
                f"form:{name}",
                ends[int(i) - 1],
                about=f"As measured by the assay {plain(assay or 'of the campaign')}, mean of the "
                "cell type",
            )
            st.caption(f"calibrated {low:.4f} to {high:.4f}")
        at_field(place, name)
    if kind != BY_SPRING:
        with right:
            name = f"deformation_index_std_{i}"
            spread = 0.0
            if kind == BY_SET:
                spread = sets[found[f"stiffness_set_{i}"]].deformation_index_std or 0.0
            found[name] = number(
                fields[name],
                "± among cells",
                f"form:{name}",
                None,
                empty=f"{spread:.4f}, as calibrated" if kind == BY_SET else "0",
                about="Standard deviation of the deformation index among cells of this type",
            )
            at_field(place, name)
    return found


def _table(place: str, i: str, table: str | None) -> dict[str, Any]:
    """Upload of measured cells, whose text stays in the session."""
    name = f"population_{i}_csv"

    def take() -> None:
        if file := st.session_state.get(f"file_{i}"):
            st.session_state[f"form:{name}"] = text_of(file.getvalue())

    def drop() -> None:
        st.session_state.pop(f"form:{name}", None)

    if table is None:
        st.file_uploader(
            "Measured cells (CSV)",
            ["csv", "tsv", "txt"],
            key=f"file_{i}",
            on_change=take,
            help="A column radius_um in µm and, where it was measured, deformation_index or "
            "ks_uN_per_m. They take the place of mean and spread.",
        )
        at_field(place, name)
        return {}
    rows = max(len(table.strip().splitlines()) - 1, 0)
    st.markdown(
        f"**{rows} measured cells** take the place of radius and spread, and of the deformability "
        "where the table has a column of it."
    )
    st.code("\n".join(table.splitlines()[:4]), language=None)
    st.button("Remove the table", key=f"drop_{i}", on_click=drop)
    at_field(place, name, f"radius_{i}_um", f"radius_std_{i}_um")
    return {name: table}


def text_of(content: bytes) -> str:
    """Text of a file from a spreadsheet."""
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _shared(place: str, info: answers.ModelInfo, fields: Fields) -> dict[str, Any]:
    """Assay, flow and mixture."""
    state, found = st.session_state, {}
    first, second, third = st.columns(3)

    def forget() -> None:
        for i in "12":
            state.pop(f"form:deformation_index_{i}", None)

    with first:
        known = [None, *info.calibrated_range]
        if state.get("form:assay") not in known:
            state["form:assay"] = None
        found["assay"] = st.selectbox(
            "Assay of the deformation indices",
            known,
            key="form:assay",
            format_func=lambda a: "the campaign's own" if a is None else a,
            on_change=forget,
            help="How indices were measured; docs/assays.md.",
        )
        at_field(place, "assay")
    with second:
        for name, label, usual in (
            ("velocity_mm_s", "Mean velocity", info.flow["mean_velocity_mm_s"]),
            ("height_um", "Channel height", info.flow["height_um"]),
        ):
            found[name] = number(
                fields[name], label, f"form:{name}", None, empty=f"{usual:g}, the campaign's"
            )
            at_field(place, name)
    with third:
        name = "concentration_ratio"
        found[name] = number(
            fields[name], "Cells of type 1 for each of type 2", f"form:{name}", fields[name].default
        )
        at_field(place, name)
        name = "radius_distribution"
        state.setdefault(f"form:{name}", fields[name].default)
        found[name] = st.radio(
            "Distribution of radii", fields[name].choices, key=f"form:{name}", horizontal=True
        )
        at_field(place, name)
    return found
