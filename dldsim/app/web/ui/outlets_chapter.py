"""What leaves a device, as a chapter: picture, purity and recovery, outlets, downloads."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import streamlit as st

from dldsim.app.web.api import answers
from dldsim.app.web.ui import outlet_charts
from dldsim.app.web.ui.parts import chart, frame, plain


def device(request: str, design: Mapping[str, Any]) -> str:
    """Name of the device of a candidate."""
    return f"{request}-candidate-{design['design']}"


def smallest(found: answers.AtOutlets | None) -> dict[str, float]:
    """Per cent of the smallest purity or recovery that nine of ten draws exceed, by device."""
    rows = [] if found is None else found.device_outcomes
    return {
        row.device: 100 * row.purity_recovery for row in rows if row.purity_recovery is not None
    }


def show(found: answers.AtOutlets, name: str, key: str, title: str = "At the outlets") -> None:
    """The chapter of one device of those that were looked at."""
    st.subheader(title)
    results, outlets, positions, exits = (
        [row.model_dump() for row in rows if row.device == name]
        for rows in (
            found.device_outcomes,
            found.device_outlets,
            found.device_positions,
            found.device_exits,
        )
    )
    if results and positions:
        chart(
            outlet_charts.fan(positions, exits, outlets, results[0]["cut_um"]),
            f"fan-{key}",
            "both cell types along the device, their exits, and the wall between the outlets",
        )
        st.caption(
            "Dark: half of the cells, light: 90 %. Black: the wall between the outlets, where "
            "what nine of ten draws of the array exceed is largest. At the right: where the cells "
            "leave. Predicted, not simulated."
        )
    if results:
        _shares(results, outlets, key)
        _downloads(found, results, outlets, name, key)


def notes(found: answers.AtOutlets) -> None:
    """What to know of the cells of all devices."""
    for note in found.notes:
        st.caption(f":material/info: {plain(note)}")


def _shares(results: Sequence[Mapping], outlets: Sequence[Mapping], key: str) -> None:
    frame(
        [
            {
                "cell": f"type {r['population']}",
                "outlet": r["outlet"],
                "purity": interval(r, "purity"),
                "recovery": interval(r, "recovery"),
                "of_sample": 100 * r["recovery_of_sample"],
                "enrichment": r["enrichment"],
                "lost": None if r["lost"] is None else 100 * r["lost"],
                "extrapolated": 100 * r["extrapolated"],
            }
            for r in results
        ],
        {
            "cell": ("cells", ""),
            "outlet": ("outlet", ""),
            "purity": ("purity (90 % interval)", ""),
            "recovery": ("recovery (90 % interval)", ""),
            **({"of_sample": ("of the sample", "%.1f %%")} if results[0]["stage"] > 1 else {}),
            "enrichment": ("enrichment", "%.3g"),
            "lost": ("clog", "%.1f %%"),
            "extrapolated": ("not learnt", "%.0f %%"),
        },
        f"outcomes-{key}",
    )
    one = results[0]
    grows = one["length_90_mm"]
    length = "" if grows is None else f" 90 % of it is reached after {grows:.3g} mm."
    robust = one["purity_recovery"]
    what = "Nine of ten draws exceed {} in the smallest of purities and recoveries."
    st.markdown(
        ("No draw has cells of both types." if robust is None else what.format(f"**{robust:.0%}**"))
        + f"{length} Array {one['array_length_mm']:.3g} mm × "
        f"{one['array_width_mm']:.3g} mm, wall at {one['cut_um']:.0f} µm, sample "
        f"{one['sample_uL_per_h']:.3g} µL/h."
    )
    with st.expander("Each outlet"):
        frame(
            [
                {
                    **r,
                    "of_1": interval(r, "cells_1"),
                    "of_2": interval(r, "cells_2"),
                    "pure": interval(r, "purity_1"),
                }
                for r in outlets
            ],
            {
                "outlet": ("outlet", ""),
                "low_um": ("from [µm]", "%.0f"),
                "high_um": ("to [µm]", "%.0f"),
                "collects": ("collects type", ""),
                "of_1": ("of type 1", ""),
                "of_2": ("of type 2", ""),
                "pure": ("type 1 among its cells", ""),
            },
            f"outlets-{key}",
        )


def _downloads(
    found: answers.AtOutlets, results: Sequence, outlets: Sequence, name: str, key: str
) -> None:
    whole = {"device": name, "device_outcomes": results, "device_outlets": outlets}
    whole |= {"notes": found.notes}
    downloads("Outcome", f"{name}-outcome".replace(" ", "-"), whole, results, key)


def downloads(
    label: str, name: str, whole: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], key: str
) -> None:
    """Buttons for everything as JSON, and some rows as CSV."""
    with st.container(horizontal=True):
        for kind, text in (
            ("json", json.dumps(whole, ensure_ascii=False, indent=1)),
            ("csv", as_csv(rows)),
        ):
            st.download_button(
                f"{label} ({kind.upper()})",
                text,
                f"{name}.{kind}",
                f"{'text' if kind == 'csv' else 'application'}/{kind}",
                key=f"{name}-{kind}-{key}",
                on_click="ignore",
                icon=":material/download:",
            )


def interval(row: Mapping[str, Any], name: str) -> str:
    """A share with its interval; “–” where no cell leaves."""
    if row[name] is None:
        return "–"
    return f"{row[name]:.1%} ({row[f'{name}_low']:.1%} to {row[f'{name}_high']:.1%})"


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows of a table as CSV, null as nothing."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
