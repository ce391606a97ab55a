"""Designs: the answer to each request, candidates as predicted, what came of simulating them."""

from collections.abc import Iterable, Mapping

import pandas as pd
from markupsafe import Markup

from dldsim.report import design_figures
from dldsim.report.formats import (
    ANGLE,
    NOT_MEASURED,
    array_columns,
    decimals,
    fixed,
    number,
    numbers,
    plus_minus,
    ranges,
    term,
    text,
    texts,
)
from dldsim.report.inputs import TABLES, settings_of
from dldsim.report.page import Grid, Page
from dldsim.report.scope import holds_for, meaning_of_radius
from dldsim.report.style import mode_name
from dldsim.vocabulary import together

PARAMETERS = {
    "pillar_radius_um": ("P_r", " µm"),
    "gap_um": ("P_g", " µm"),
    "periodicity": ("N_p", ""),
}
NEAR = 0.01
"""Share of the range of a search within which a candidate counts as on its bound."""
LENGTH, PRESSURE = "length [mm]", "pressure drop [kPa]"


def contents(page: Page) -> dict | None:
    """Chapter of the campaign's page."""
    if not (page.some("designs") or page.some("verified_designs")):
        return None
    return answer(page) | verified(page) | candidates(page)


def requests_of(page: Page) -> dict[str, Mapping]:
    """The design requests by name: as the tables record them, else as configured."""
    recorded = (
        settings_of(page.results / TABLES["designs"][0]).get("design_requests")
        or page.setting("design_requests")
        or []
    )
    return {request["name"]: request for request in recorded}


def scope(page: Page) -> list[str]:
    """What the designs hold for, in sentences; none where no table tells."""
    if not page.some("design_populations"):
        return []
    cells = page["design_populations"]
    aspect = page.setting("cell", "aspect_ratio") or 1.0
    flow = ["cell_shape", "height_um", "mean_velocity_mm_s"]
    return [
        *(
            holds_for(shape, part["cell_radius_um"], height, velocity)
            for (shape, height, velocity), part in cells.groupby(flow, sort=False)
        ),
        *(
            meaning_of_radius(shape, float(part["cell_radius_um"].iloc[0]), aspect)
            for shape, part in cells.groupby("cell_shape", sort=False)
        ),
    ]


def cell_types(page: Page) -> Grid | None:
    """Both cell types of each request, from what was measured to what acts."""
    if not page.some("design_populations"):
        return None
    table = page["design_populations"]
    named = table["assay"] != ""
    index = zip(table["deformation_index"], table["deformation_index_std"], named, strict=True)
    return page.table(
        {
            "request": texts(table["request"]),
            "cell": texts(table["population"]),
            "shape": ["bead" if r else s for r, s in table[["rigid", "cell_shape"]].to_numpy()],
            "R [µm]": numbers(table["cell_radius_um"]),
            "velocity [mm/s]": numbers(table["mean_velocity_mm_s"]),
            "height [µm]": numbers(table["height_um"]),
            "DI ±": [
                f"{fixed(value, 3)} ± {fixed(spread, 3)}" if by else NOT_MEASURED
                for value, spread, by in index
            ],
            "assay": [a or NOT_MEASURED for a in table["assay"]],
            Markup("k<sub>s</sub> [µN/m]"): _with_interval(table, "ks", "_uN_per_m"),
            "Ca": _with_interval(table, "capillary_number", ""),
            "least gap [µm]": numbers(table["narrowest_width_um"]),
        },
        ["design_populations"],
        notes=_sentences(table["stiffness_basis"], table["narrowest_width_basis"]),
    )


def _with_interval(table: pd.DataFrame, name: str, unit: str) -> list[str]:
    """Values with their intervals, where an assay gave these."""
    return [
        number(value) + (f" ({number(low)} to {number(high)})" if low < high else "")
        for value, low, high in table[
            [f"{name}{unit}", f"{name}_low{unit}", f"{name}_high{unit}"]
        ].to_numpy()
    ]


def on_bounds(row: Mapping, request: Mapping | None) -> list[str]:
    """Parameters of a candidate that lie on a bound of its search, in words."""
    found = []
    for name, (symbol, unit) in PARAMETERS.items():
        low, high = (request or {}).get(name) or (0, 0)
        reach = 0 if name == "periodicity" else NEAR * (high - low)
        for bound, which in ((low, "lowest"), (high, "highest")):
            if high > low and abs(row[name] - bound) <= reach:
                found.append(f"{symbol} is the {which} that the search allows ({bound:g}{unit})")
    return found


def _both(table: pd.DataFrame, name: str, intervals: bool = False) -> list[Markup]:
    """Values of both cell types, with their modes, and with the intervals of predicted angles."""
    cells = []
    for i in (1, 2):
        values = map(fixed, table[f"{name}_{i}_deg"])
        spans = [""] * len(table)
        if intervals:
            low, high = table[f"{name}_{i}_low_deg"], table[f"{name}_{i}_high_deg"]
            spans = [f" ({span})" for span in ranges(low, high)]
        modes = map(mode_name, table[f"mode_{i}"])
        cells.append([f"{v}{s} {m}" for v, s, m in zip(values, spans, modes, strict=True)])
    return [Markup("{},<br>{}").format(*both) for both in zip(*cells, strict=True)]


def _notes(table: pd.DataFrame, requests: Mapping[str, Mapping]) -> list[str]:
    """The verdict of each design, notes on a predicted one, and the bounds that it lies on."""
    found = []
    for _, row in table.iterrows():
        said = map(text, (row["verdict"], *row.get("notes", ())))
        found.append("; ".join([*said, *on_bounds(row, requests.get(row["request"]))]))
    return found


def best_of(page: Page) -> pd.DataFrame:
    """The best design of each request: simulated where one has an angle, else as predicted."""
    parts = []
    if page.some("verified_designs"):
        done = page["verified_designs"].dropna(subset=["separation_deg"])
        done = done.assign(error_deg=done["sigma_num_deg"], basis="simulated")
        parts.append(done.assign(notes=[()] * len(done)))
    if page.some("designs"):
        table = page["designs"].sort_values("design")
        parts.append(table.assign(error_deg=table["uncertainty_deg"], basis="predicted"))
    return pd.concat([part for part in parts if len(part)]).drop_duplicates("request")


def answer(page: Page) -> dict:
    """One row a request: what a designer acts on."""
    best = best_of(page)
    requests = requests_of(page)
    doubts = []
    if page.some("design_populations"):
        told = page["design_populations"][["request", "doubt"]].drop_duplicates()
        doubts = told[told["doubt"] != ""].to_numpy().tolist()
    return {
        "doubts": doubts,
        "cell_types": cell_types(page),
        "bounds_known": bool(requests),
        "edge": [
            (row["request"], on_bounds(row, requests.get(row["request"])))
            for _, row in best.iterrows()
            if on_bounds(row, requests.get(row["request"]))
        ],
        "answer": page.table(
            {
                "request": texts(best["request"]),
                **array_columns(best),
                Markup("{} of cells 1, 2 [°]").format(ANGLE): _both(best, "angle"),
                "separation [°]": plus_minus(best["separation_deg"], best["error_deg"]),
                "angles are": best["basis"],
                LENGTH: numbers(best["length_mm"]),
                PRESSURE: numbers(best["pressure_drop_kPa"], 2),
                "throughput [µL/h]": numbers(best["throughput_uL_per_h"]),
            },
            [
                k
                for k in ("verified_designs", "designs", "design_requests", "verified_requests")
                if k in page
            ],
            notes=_notes(best, requests),
        ),
    }


def judged(design: Mapping) -> str:
    """What a simulation says of the prediction before it; a wide one is not confirmed by it."""
    if pd.isna(design["agrees"]) or design["agrees"]:
        if design["uncertainty_deg"] >= design["predicted_separation_deg"]:
            return "uninformative: includes zero"
        return NOT_MEASURED if pd.isna(design["agrees"]) else "confirmed"
    return "missed"


def verified(page: Page) -> dict:
    """What came of simulating the candidates, request by request."""
    if not (page.some("verifications") and "verified_designs" in page):
        return {"rounds": None, "of_requests": [], "all_outcomes": None}
    verifications, requests = page["verifications"], requests_of(page)
    rows = verifications[verifications["population"] != "difference"]
    return {
        "rounds": page.figure(
            "verification", design_figures.draw_rounds(verifications), ["verifications"]
        ),
        "of_requests": [
            _of_request(page, name, table, requests)
            for name, table in page["verified_designs"].groupby("request", sort=False)
        ],
        "all_outcomes": page.table(
            {
                "request": texts(rows["request"]),
                "round": numbers(rows["round"]),
                "role": texts(rows["role"]),
                **array_columns(rows),
                "height [µm]": numbers(rows["height_um"]),
                "cell": texts(rows["population"]),
                "shape": texts(rows["cell_shape"]),
                "radius [µm]": numbers(rows["cell_radius_um"]),
                Markup("k<sub>s</sub> [µN/m]"): numbers(rows["ks_uN_per_m"]),
                "Ca": numbers(rows["capillary_number"], 2),
                "predicted [°]": ranges(rows["predicted_low_deg"], rows["predicted_high_deg"]),
                "simulated [°]": plus_minus(rows["simulated_deg"], rows["sigma_num_deg"]),
                "mode": map(mode_name, rows["mode"]),
            },
            ["verifications"],
            rows["agrees"].isin([False]) | rows["simulated_deg"].isna(),
            _sentences(rows["verdict"], rows["note"]),
        ),
    }


def _sentences(*columns: Iterable) -> list[str]:
    return [
        "; ".join(str(v) for v in values if not pd.isna(v) and v != "")
        for values in zip(*columns, strict=True)
    ]


def _of_request(page: Page, name: str, table: pd.DataFrame, requests: Mapping) -> dict:
    """Two tables of the simulated designs of a request, their pictures and files."""
    folder = page.results / "designs" / str(name)
    marked = table["separates"].isin([False]) | table["separation_deg"].isna()
    designs = page.table(
        {
            "rank": numbers(table["rank"]),
            "design": texts(table["name"]),
            **array_columns(table),
            Markup("simulated {} of cells 1, 2 [°]").format(ANGLE): _both(table, "angle"),
            "simulated separation [°]": plus_minus(table["separation_deg"], table["sigma_num_deg"]),
            LENGTH: numbers(table["length_mm"]),
            PRESSURE: numbers(table["pressure_drop_kPa"], 2),
        },
        ["verified_designs"],
        marked,
        _notes(table, requests),
    )
    checks = page.table(
        {
            "design": texts(table["name"]),
            "round": numbers(table["round"]),
            "predicted before [°]": plus_minus(
                table["predicted_separation_deg"], table["uncertainty_deg"]
            ),
            "prediction": [judged(row) for _, row in table.iterrows()],
            "simulated [°]": plus_minus(table["separation_deg"], table["sigma_num_deg"]),
            Markup("finer lattice, half Re [°]<br><small>simulated</small>"): decimals(
                table["separation_finer_deg"]
            ),
            Markup(
                "over ± <i>P</i><sub>r</sub>, <i>P</i><sub>g</sub> [°]<br><small>predicted</small>"
            ): ranges(table["separation_tolerance_min_deg"], table["separation_tolerance_max_deg"]),
            Markup("lower, higher channel [°]<br><small>simulated</small>"): [
                f"{fixed(a)}, {fixed(b)}"
                for a, b in zip(
                    table["separation_low_height_deg"],
                    table["separation_high_height_deg"],
                    strict=True,
                )
            ],
        },
        ["verified_designs"],
        marked,
    )
    pictures = (folder / f"{n}.passage.png" for n in table["name"])
    return {
        "name": name,
        "designs": designs,
        "checks": checks,
        "stopped": table["stopped"].iloc[0],
        "throughput": table["throughput_uL_per_h"].iloc[0],
        "pressure_basis": together(table["pressure_basis"].tolist()),
        "files": [
            (n, [page.link(f) for f in sorted(folder.glob(f"{n}.*"))])
            for n in table["name"]
            if page.linked and any(folder.glob(f"{n}.*"))
        ],
        "pictures": [page.image(path) for path in pictures if path.exists()],
    }


def candidates(page: Page) -> dict:
    """Candidates as the surrogate predicts them, and what a fabrication error does to the best."""
    if not page.some("designs"):
        return {"candidates": None, "predicted": [], "tolerances": None}
    designs, requests = page["designs"], requests_of(page)
    return {
        "candidates": page.figure("designs", design_figures.draw_designs(designs), ["designs"]),
        "predicted": [
            _predicted(page, name, table, requests)
            for name, table in designs.groupby("request", sort=False)
        ],
        "tolerances": _tolerances(page),
    }


def _predicted(page: Page, name: str, table: pd.DataFrame, requests: Mapping) -> dict:
    grid = page.table(
        {
            "rank": numbers(table["rank"]),
            **array_columns(table),
            Markup("{} of cells 1, 2 [°]").format(ANGLE): _both(table, "angle", intervals=True),
            "separation [°]": plus_minus(table["separation_deg"], table["uncertainty_deg"]),
            Markup("σ<sub>num</sub> [°]"): decimals(table["sigma_num_deg"]),
            "over tolerance [°]": ranges(
                table["separation_tolerance_min_deg"], table["separation_tolerance_max_deg"]
            ),
            "robust [°]": decimals(table["robust_separation_deg"]),
            "mode changes": [f"{p:.0%}" for p in table["mode_change_probability"]],
            LENGTH: numbers(table["length_mm"]),
            "drop [kPa]": numbers(table["pressure_drop_kPa"], 2),
        },
        ["designs"],
        ~table["inside_training_domain"].astype(bool),
        _notes(table, requests),
    )
    return {
        "name": name,
        "grid": grid,
        "objective": table["objective"].iloc[0],
        "pressure_basis": together(table["pressure_basis"].tolist()),
    }


def _tolerances(page: Page) -> Grid | None:
    if not page.some("design_tolerances"):
        return None
    table = page["design_tolerances"]
    table = table[table["design"] == 1]
    return page.table(
        {
            "request": texts(table["request"]),
            "off": map(term, table["parameter"]),
            "by": numbers(table["offset"], 2),
            Markup("{} of cells 1, 2 [°]").format(ANGLE): _both(table, "angle"),
            "separation [°]": decimals(table["separation_deg"]),
            "slope [° per µm or µN/m]": numbers(table["sensitivity_deg_per_unit"], 2),
        },
        ["design_tolerances"],
    )


def largest(page: Page) -> dict | None:
    """The largest simulated separation of any design, for the summary."""
    if not page.some("verified_designs"):
        return None
    done = page["verified_designs"].dropna(subset=["separation_deg"])
    if done.empty:
        return None
    best = done.loc[done["separation_deg"].idxmax()]
    [value] = plus_minus([best["separation_deg"]], [best["sigma_num_deg"]], 1)
    array = (
        f"P_r {number(best['pillar_radius_um'])} µm, P_g {number(best['gap_um'])} µm, "
        f"N_p {best['periodicity']}"
    )
    return {"value": f"{value}°", "request": best["request"], "array": array}
