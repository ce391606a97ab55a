"""A request in what was learnt: arrays of each of its shapes, and deformation indices."""

from collections.abc import Mapping, Sequence
from typing import Any

import streamlit as st

from dldsim.app.web.api import answers
from dldsim.app.web.ui import domain_charts
from dldsim.app.web.ui.parts import chart

SHAPES = {"biconcave": "biconcave disc", "sphere": "sphere", "ellipsoid": "ellipsoid"}


def learnt(info: answers.ModelInfo, shape: str) -> list | None:
    """Arrays learnt from of a shape, as (P_r/R, P_g/R, N_p); None: the shape was not learnt."""
    shapes = info.domain["shapes"]
    return shapes[shape]["geometries"] if shape in shapes else None


def index_range(info: answers.ModelInfo, assay: str | None) -> tuple[float, float]:
    """Calibrated range of an assay, by default the campaign's own."""
    return info.calibrated_range.get(assay or "", info.deformation_index_range)


def show(
    info: answers.ModelInfo,
    request: Mapping[str, Any],
    key: str,
    designs: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Pictures of a request whose deformation indices are there where they are known."""
    for shape in dict.fromkeys((request["shape_1"], request["shape_2"])):
        arrays = learnt(info, shape)
        if arrays is None:
            continue
        st.markdown(f"**{SHAPES[shape]}**")
        chart(
            domain_charts.domain(arrays, request, designs),
            f"domain-{key}-{shape}",
            "arrays learnt from, bounds of the request and candidates",
        )
    cells = {
        i: (request[f"deformation_index_{i}"], request[f"deformation_index_std_{i}"])
        for i in (1, 2)
        if request.get(f"deformation_index_{i}") is not None
    }
    if cells:
        chart(
            domain_charts.index_strip(index_range(info, request.get("assay")), cells),
            f"strip-{key}",
            "deformation indices of the cell types in the calibrated range",
        )
