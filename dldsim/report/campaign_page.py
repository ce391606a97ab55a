"""One self-contained HTML page from the tables of a campaign: results/report.html.

Figures come from :mod:`dldsim.report.figures`, are saved as PNG and SVG under results/figures/ and
embedded; beside each stands a relative link to the tables that it was drawn from.
"""

import base64
import html
import importlib.metadata
import json
import math
import os
import platform
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import pandas as pd

import dldsim
from dldsim.analysis import uncertainty
from dldsim.analysis.statistics import most_frequent
from dldsim.config.provenance import settings_hash
from dldsim.errors import DldsimError
from dldsim.evidence import spot_check, stability_sweep
from dldsim.evidence.accuracy import ANGLE, INDEX, SETTING
from dldsim.evidence.validation import CASES, verdicts
from dldsim.report import (
    accuracy_figures,
    analysis_figures,
    design_figures,
    figures,
    stability_figures,
    validation_figures,
)
from dldsim.tables.parquet import atomic_path, read_table
from dldsim.tables.registry import TABLES
from dldsim.vocabulary import BROKEN, GEOMETRY

REQUIRED = ("outcomes", "runs")
SHOWN = [*REQUIRED, *(kind for kind, table in TABLES.items()
                      if table.file and kind not in (*REQUIRED, "critical_gaps"))]
"""Kinds of table that the report reads."""
EMBED_SVG_BELOW = 260_000
"""Bytes up to which a figure is embedded as SVG; a larger one is embedded as PNG."""
STATUS_MEANING = {
    "decided": "known wherever the cell enters",
    "coexisting": "known; the motion depends on where the cell enters",
    "undecided": "not settled when the rows were spent: the angle lies within its interval",
    "stuck": "the cell stopped moving",
    "unstable": "a run left the safe range of the numerics",
    "failed": "a run broke off with an error",
}
RUN_MEANING = {
    "converged": "the motion repeats every row",
    "periodic": "the orbit repeats after several rows",
    "stationary": "no orbit, but the mean is known",
    "undecided": "not settled when the rows were spent",
    "stuck": "the cell stopped moving",
    "unstable": "the run left the safe range of the numerics",
    "failed": "the run broke off with an error",
}
PACKAGES = ("numba", "numpy", "pandas", "statsmodels", "scikit-learn", "xgboost-cpu", "optuna",
            "snakemake")
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOT_MEASURED = "–"


# --------------------------------------------------------------------------------------- formatting


def number(value, digits: int = 3) -> str:
    """A number with so many significant digits; a dash for null; scientific when far from 1."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return NOT_MEASURED
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return f"{value:,}".replace(",", "\u202f").replace("-", "−")
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 < exponent < 6:
        text = f"{value:,.{max(digits - 1 - exponent, 0)}f}".replace(",", "\u202f")
    else:
        mantissa = f"{value / 10**exponent:.{max(digits - 1, 0)}f}"
        text = f"{mantissa} × 10{str(exponent).translate(SUPERSCRIPT)}"
    return text.replace("-", "−")


def fixed(value, decimals: int) -> str:
    """A number with so many decimals; a dash for null."""
    if value is None or not math.isfinite(value):
        return NOT_MEASURED
    return f"{value:.{decimals}f}".replace("-", "−")


def probability(value) -> str:
    """A p-value: two digits, scientific below 0.001."""
    if value is None or math.isnan(value):
        return NOT_MEASURED
    if value < 1e-300:
        return "< 10" + "-300".translate(SUPERSCRIPT)
    return number(float(value), 2) if value < 1e-3 else fixed(value, 3)


def duration(seconds: float) -> str:
    """Seconds, minutes or hours, whichever reads best."""
    if seconds < 120:
        return f"{number(float(seconds), 2)} s"
    if seconds < 7200:
        return f"{number(seconds / 60, 2)} min"
    return f"{number(seconds / 3600, 3)} h"


def text(value) -> str:
    """Any table value as escaped HTML; a dash for null or empty."""
    if value is None or (isinstance(value, float) and math.isnan(value)) or value == "":
        return NOT_MEASURED
    return html.escape(str(value))


def listing(items: Iterable[str]) -> str:
    """a, b and c."""
    items = list(items)
    return " and ".join(filter(None, [", ".join(items[:-1]), *items[-1:]]))


def counted(count: int, noun: str) -> str:
    """"1 run", "3 runs"."""
    return f"{number(int(count))} {noun}{'' if count == 1 else 's'}"


# ------------------------------------------------------------------------------------- the campaign


@dataclass
class Campaign:
    """Tables of one results folder and the page that grows from them."""

    results: Path
    output: Path
    config: dict
    tables: dict[str, pd.DataFrame]
    figure_count: int = 0
    table_count: int = 0

    @property
    def outcomes(self) -> pd.DataFrame:
        return self.tables["outcomes"]

    @property
    def runs(self) -> pd.DataFrame:
        return self.tables["runs"]

    def __contains__(self, kind: str) -> bool:
        return kind in self.tables

    def __getitem__(self, kind: str) -> pd.DataFrame:
        return self.tables[kind]

    def setting(self, *keys: str):
        """Value of the configuration, None where it has none."""
        value = self.config
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def link(self, path: Path) -> str:
        """Relative link from the page to a file or folder."""
        target = Path(os.path.relpath(path, self.output.parent)).as_posix()
        name = path.name + ("/" if path.is_dir() else "")
        return f'<a href="{html.escape(target)}">{html.escape(name)}</a>'

    def sources(self, kinds: Iterable[str]) -> str:
        """Links to the tables, and to their CSV twins where these exist."""
        links = []
        for kind in kinds:
            path = self.results / TABLES[kind].file
            links += [self.link(p) for p in (path, path.with_suffix(".csv")) if p.exists()]
        return "Data: " + ", ".join(links)

    def absent(self, kind: str) -> str:
        """Sentence that names the missing table and the rule that makes it."""
        _, name, rule = TABLES[kind]
        return (
            f'<p class="absent">Not in this report: the table <code>{name}</code> does not exist '
            f"yet. Make it with <code>snakemake -j2 {rule}</code>, then run "
            "<code>snakemake -j2 report</code>.</p>"
        )

    def figure(self, name: str, figure, caption: str, kinds: Iterable[str], extra: str = "") -> str:
        """Save a figure, and return it embedded with caption and data links."""
        self.figure_count += 1
        folder = self.results / "figures"
        images = {kind: figures.render(figure, kind) for kind in ("svg", "png")}
        for kind, image in images.items():
            with atomic_path(folder / f"{name}.{kind}") as part:
                part.write_bytes(image)
        kind = "svg" if len(images["svg"]) <= EMBED_SVG_BELOW else "png"
        mime = {"svg": "image/svg+xml", "png": "image/png"}[kind]
        payload = base64.b64encode(images[kind]).decode()
        width = round(figure.get_figwidth() * 100)
        alt = html.escape(name.replace("_", " "))
        files = ", ".join(self.link(folder / f"{name}.{kind}") for kind in ("svg", "png"))
        return (
            f'<figure id="figure-{name}"><img alt="{alt}" width="{width}" '
            f'src="data:{mime};base64,{payload}">\n'
            f"<figcaption><b>Figure {self.figure_count}.</b> {caption}"
            f'<span class="source">{self.sources(kinds)}{extra}. Figure: {files}.</span>'
            "</figcaption></figure>"
        )

    def table(
        self, columns: dict[str, Iterable[str]], caption: str, kinds: Iterable[str] = (),
        marked: Iterable[bool] | None = None,
    ) -> str:
        """HTML table; columns: heading (trusted HTML) to ready cells; marked rows are shaded."""
        self.table_count += 1
        rows = list(zip(*columns.values(), strict=True))
        marked = [False] * len(rows) if marked is None else list(marked)
        head = "".join(f"<th>{heading}</th>" for heading in columns)
        body = "\n".join(
            f"<tr{' class=marked' if mark else ''}>"
            + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>"
            for row, mark in zip(rows, marked, strict=True)
        )
        source = f'<span class="source">{self.sources(kinds)}.</span>' if kinds else ""
        return (
            f'<div class="table"><table><caption><b>Table {self.table_count}.</b> {caption}'
            f"{source}</caption><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table>"
            "</div>"
        )


def _numbers(values, digits: int = 3) -> list[str]:
    return [number(v, digits) for v in values]


def _texts(values) -> list[str]:
    return [text(v) for v in values]


def _angles(values, decimals: int = 2) -> list[str]:
    return [fixed(v, decimals) for v in values]


# ----------------------------------------------------------------------------------------- sections


def _summary(campaign: Campaign) -> str:
    outcomes = campaign.outcomes
    count = outcomes["status"].value_counts()
    undecided = int(count.get("undecided", 0))
    broken = outcomes[outcomes["status"].isin(BROKEN)]
    modes = [m for m in figures.MODES[:-1] if (outcomes["mode"] == m).any()]
    simulation = outcomes["wall_time_s"].sum()
    for kind in ("flows", "constriction_runs"):
        if kind in campaign:
            simulation += campaign[kind]["wall_time_s"].sum()
    cards = [
        (counted(len(outcomes), "outcome"), f"{len(_arrays(outcomes))} arrays × "
         f"{outcomes['stiffness_set'].nunique()} stiffness sets, "
         f"{counted(len(campaign.runs), 'release')}"),
        (f"{count.get('decided', 0)} decided", f"{count.get('coexisting', 0)} coexisting, "
         f"{undecided} undecided, {len(broken)} without an angle"),
        (listing(modes) or "no mode", ", ".join(
            f"{(outcomes['mode'] == mode).sum()} {mode}" for mode in modes)),
        (duration(simulation), "simulation, summed over jobs"),
    ]
    if "predictions" in campaign and len(campaign["predictions"]):
        scores = analysis_figures.pooled_scores(campaign["predictions"])
        by_array = scores[scores["split"] == "geometry"]
        if len(by_array):
            best = by_array.iloc[0]
            cards.append((f"± {number(best['rmse_deg'], 2)}°",
                          f"error of {text(best['model'])} on arrays it has not seen (RMSE)"))
    if "verified_designs" in campaign:
        done = campaign["verified_designs"].dropna(subset=["separation_deg"])
        if len(done):
            best = done.loc[done["separation_deg"].idxmax()]
            spread = best["sigma_num_deg"]
            cards.append((fixed(best["separation_deg"], 1)
                          + (f" ± {fixed(spread, 1)}" if pd.notna(spread) else "") + "°",
                          f"largest simulated separation of a design ({text(best['request'])})"))
    parts = ['<div class="cards">' + "".join(
        f"<div><b>{head}</b><span>{tail}</span></div>" for head, tail in cards) + "</div>"]
    if len(modes) == 1:
        parts.append(
            f'<p class="warning">Every measured outcome has the same mode ({modes[0]}). Angles '
            "then follow from the geometry alone, and neither the analysis nor the designs below "
            "say anything about the cell. Widen the sweep across the critical diameter "
            '(see <a href="#modes">Migration modes</a>).</p>'
        )
    parts.append(_status_table(campaign))
    if len(broken):
        parts.append(campaign.table(
            {
                "outcome": _texts(broken["outcome_id"]), "status": _texts(broken["status"]),
                "rows passed": _numbers(broken["rows_total"]),
                "reason": _texts(broken["stop_reason"]),
            },
            "Outcomes without an angle; they are in none of the analyses.", ["outcomes"],
        ))
    else:
        parts.append("<p>Every outcome has an angle.</p>")
    if undecided:
        parts.append(
            f"<p>{counted(undecided, 'outcome')} had not settled when the rows were spent "
            f"(run_control: max_rows = {text(campaign.setting('run_control', 'max_rows'))} for a "
            "release, outcome_rows_max = "
            f"{text(campaign.setting('run_control', 'outcome_rows_max'))} for all). The angle is "
            "then known within its interval only; in every figure it has an <b>open marker</b> or "
            "a dashed line, and in every table it is called <b>undecided</b>. The analyses do use "
            "these outcomes.</p>"
        )
    parts.append(_basis(campaign))
    parts.append(_settings(campaign, simulation))
    return "\n".join(parts)


def _arrays(outcomes: pd.DataFrame) -> pd.DataFrame:
    return outcomes[GEOMETRY].drop_duplicates()


def _status_table(campaign: Campaign) -> str:
    outcomes, runs = campaign.outcomes, campaign.runs
    statuses = [s for s in STATUS_MEANING if (outcomes["status"] == s).any()]
    modes = [m for m in figures.MODES if (outcomes["mode"] == m).any()]
    columns = {"status": _texts(statuses)}
    for mode in modes:
        columns[figures.mode_name(mode)] = [
            number(int(((outcomes["status"] == s) & (outcomes["mode"] == mode)).sum()))
            for s in statuses
        ]
    columns["all"] = [number(int((outcomes["status"] == s).sum())) for s in statuses]
    columns["meaning"] = [STATUS_MEANING[s] for s in statuses]
    of_runs = [s for s in RUN_MEANING if (runs["status"] == s).any()]
    return "\n".join([
        campaign.table(columns, "Outcomes by status and migration mode. An outcome is an array and "
                       "a cell, over as many places of release as it takes.", ["outcomes"]),
        campaign.table({
            "status of the release": _texts(of_runs),
            "all": [number(int((runs["status"] == s).sum())) for s in of_runs],
            "meaning": [RUN_MEANING[s] for s in of_runs],
        }, "Runs, one from each place of release, by status.", ["runs"]),
    ])


def _basis(campaign: Campaign) -> str:
    outcomes, runs = campaign.outcomes, campaign.runs
    cell = outcomes.iloc[0]
    sizes = runs[["rows_in_domain", "lanes_in_domain"]].dropna().drop_duplicates()
    domains = listing(f"{int(rows)} × {int(lanes)}" for rows, lanes in sizes.to_numpy())
    domains = domains or "an unknown number of"
    capillary = f"{number(outcomes['capillary_number'].min(), 2)} to " + number(
        outcomes["capillary_number"].max(), 2
    )
    lag = number(outcomes["lag_number"].max(), 2)
    entries = {
        "Measured": "in the simulations of this campaign: trajectories, migration angles, modes, "
        "deformation along the path, deformation index in the constriction, permeability and tilt "
        "of the empty arrays, drift of volume and area, run times.",
        "Derived": "from those by statistics: calibration, analysis of variance, robustness, "
        "regressors, designs. A design is a prediction of the regressor until it is simulated.",
        "Assumed": f"a {text(cell['cell_shape'])} cell of radius {cell['cell_radius_um']:g} µm at "
        "rest; the same liquid inside and outside; a channel "
        + (f"{cell['height_um']:g} µm high; " if cell["height_um"] else "without top and bottom; ")
        + f"one cell per periodic domain of {domains} pillars (rows × lanes), so that it meets its "
        f"own images; a lag number (numerical Reynolds number) of {lag} or less where the device "
        "has some thousandths, at the capillary number of the device, μU/<i>k</i><sub>s</sub> = "
        f"{capillary}; the dimensions of the constriction.",
        "From literature": "membrane coefficients of the stiffness sets and groups, and the group "
        "velocities (source paper, read in the simulation units of its code); the line "
        "<i>D</i><sub>c</sub> = 1.4 <i>G</i> ε<sup>0.48</sup> for rigid spheres (Davis 2008), "
        "whose scatter is about ±10 %; the open diamonds in the calibration (source paper). None "
        "of these is a result of this campaign.",
    }
    listed = "\n".join(f"<dt>{name}</dt><dd>{what}</dd>" for name, what in entries.items())
    return (
        "<h3>Measured, assumed, taken from literature</h3>\n"
        f'<dl class="basis">\n{listed}\n</dl>'
    )


def _settings(campaign: Campaign, simulation: float) -> str:
    outcomes = campaign.outcomes
    versions = [f"dldsim {dldsim.__version__}", f"physics version {dldsim.PHYSICS_VERSION}",
                f"Python {platform.python_version()}"]
    for package in PACKAGES:
        try:
            versions.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            continue


    def values(name: str) -> str:
        return ", ".join(f"{v:g}" for v in sorted(outcomes[name].unique()))

    ranges = {
        "Preset": text(campaign.setting("preset")),
        "Seed": text(campaign.setting("seed")),
        "Configuration hash": settings_hash(campaign.config),
        "Pillar radius <i>P</i><sub>r</sub>": values("pillar_radius_um") + " µm",
        "Gap <i>P</i><sub>g</sub>": values("gap_um") + " µm",
        "Periodicity <i>N</i><sub>p</sub>": values("periodicity"),
        "Stiffness sets": text(", ".join(sorted(outcomes["stiffness_set"].unique()))),
        "Mean velocity": values("mean_velocity_mm_s") + " mm/s",
        "Lattice spacing": f"{number(outcomes['spacing_um'].min())} to "
        f"{number(outcomes['spacing_um'].max())} µm",
        "Simulation time": f"{duration(simulation)} summed over jobs",
        "Versions": text(", ".join(versions)),
        "Written": datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
    }
    for section in ("cell", "flow", "numerics", "run_control", "constriction"):
        values_of = campaign.setting(section)
        if isinstance(values_of, dict):
            ranges[section.replace("_", " ").capitalize()] = text(
                ", ".join(f"{key} = {value}" for key, value in values_of.items())
            )
    return campaign.table(
        {"setting": ranges.keys(), "value": ranges.values()}, "Settings and provenance.",
        ["outcomes"],
    )


def _trajectories(campaign: Campaign) -> str:
    runs = campaign.runs
    parts = []
    tracks = campaign["trajectory"] if "trajectory" in campaign else None
    if tracks is None:
        parts.append(campaign.absent("trajectory"))
    else:
        picked = [
            (heading, ids) for heading, ids in figures.pick_trajectories(runs)
            if set(ids) <= set(tracks["run_id"])
        ]
        missing = [m for m in ("bump", "zigzag") if not (runs["mode"] == m).any()]
        if missing:
            parts.append(f'<p class="absent">No run of this campaign is in {listing(missing)} '
                         "mode, so none is drawn.</p>")
        if picked:
            panels = [figures.trajectory_panel(h, ids, runs, tracks) for h, ids in picked]
            parts.append(campaign.figure(
                "trajectories", figures.draw_trajectories(panels),
                "Path of the cell's centre of mass over the pillars (grey), laboratory frame, true "
                "aspect ratio, flow from left to right; the last rows of each run, one period or "
                "more. Runs are chosen automatically: the settled run nearest to the median "
                "angle of its mode, and the array that parts two stiffness sets most. Dotted "
                "circle: diameter of the cell at rest. Below each: deformation index of the "
                "bounding box, (a − b)/(a + b). Measured.",
                ["trajectory", "runs"],
            ))
    if (runs["rows_completed"] > 0).any():
        bottom = (
            "Bottom: where the cell's centre crosses each row, as height in the gap between pillar "
            "surfaces (grey); a line that ends level has settled. "
        ) if tracks is not None else ""
        parts.append(campaign.figure(
            "all_runs", figures.draw_all_runs(runs, tracks),
            "All runs. Top: lateral steps summed up, in units of the row shift ελ; a bumping cell "
            "rises as the dotted line does, a zigzagging one falls back once a period. "
            + bottom
            + "The first rows are the transient after release. Measured.",
            ["runs"] if tracks is None else ["runs", "trajectory"],
        ))
    return "\n".join(parts)


def _no_angle(outcomes: pd.DataFrame) -> str | None:
    if figures.measured(outcomes).empty:
        return '<p class="absent">No outcome of this campaign has a migration angle.</p>'
    return None


def _angle_section(campaign: Campaign) -> str:
    outcomes = campaign.outcomes
    if sentence := _no_angle(outcomes):
        return sentence
    parts = [campaign.figure(
        "angles", figures.draw_angles(outcomes),
        "Migration angle θ<sub>m</sub> of every outcome against geometry (position, colour) and "
        "stiffness set (marker). Dotted: angle of full bump mode, arctan(1/<i>N</i><sub>p</sub>). "
        "Bars: numerical uncertainty σ<sub>num</sub>, where it is known. Open: undecided. "
        "Markers at one position are set apart sideways.",
        ["outcomes"],
    )]
    points = figures.measured(outcomes)
    if points["deformation_index"].notna().any():
        parts.append(campaign.figure(
            "deformability", figures.draw_deformability(outcomes),
            "What the cell's deformability does: θ<sub>m</sub> as a fraction of the bump angle "
            "against the deformation index from the constriction calibration; one line per array. "
            "A level line: deformability does not matter in that array.",
            ["outcomes", *(["calibration"] if "calibration" in campaign else [])],
        ))
    if points["deformation_index"].notna().any():
        parts.append(campaign.figure(
            "density", analysis_figures.draw_density(outcomes),
            "Density of DI against θ<sub>m</sub> (grey: Gaussian kernel), every outcome as a "
            "point, set apart sideways. DI takes one value per stiffness set, so that what is "
            "continuous along DI is the kernel's doing, in the source paper's figure as well. "
            "Measured.",
            ["outcomes"],
        ))
    parts.append(campaign.figure(
        "boxes", analysis_figures.draw_boxes(outcomes),
        "θ<sub>m</sub> over one factor at a time, all others pooled; box: quartiles, whiskers: 1.5 "
        "quartile ranges, points: outcomes. The source paper reads falling medians and spreads as "
        "smooth trends; here the spread is a mixture of modes, and its upper edge the bump angle "
        "arctan(1/<i>N</i><sub>p</sub>). Measured.", ["outcomes"],
    ))
    parts.append(campaign.figure(
        "factors", analysis_figures.draw_factors(outcomes),
        "All geometric factors at once; a box holds all <i>N</i><sub>p</sub> and stiffness sets of "
        "a gap and a pillar radius. In the source paper each gap has one radius "
        "(<i>P</i><sub>g</sub> = <i>P</i><sub>r</sub> + 10 µm), so that its figure cannot part the "
        "two; here it can wherever a gap has several boxes. Measured.", ["outcomes"],
    ))
    if points["source_angle_deg"].notna().any():
        parts.append(campaign.figure(
            "first_period", figures.draw_first_period(outcomes),
            "Angle over the first period after release at mid-gap (the source paper's protocol) "
            "against the settled angle. Off the dotted line, the first period still shows the "
            "transient. Right: their ratio for bumping outcomes. Measured.",
            ["outcomes"],
        ))
    return "\n".join(parts)


def _mode_section(campaign: Campaign) -> str:
    if sentence := _no_angle(campaign.outcomes):
        return sentence
    aspect_ratio = campaign.setting("cell", "aspect_ratio") or 1.0
    points = figures.mode_points(campaign.outcomes, aspect_ratio)
    right_side = (
        (points["mode"] == "bump") & (points["size_over_critical"] > 1)
        | (points["mode"] == "zigzag") & (points["size_over_critical"] < 1)
    )
    told = points["mode"].isin(["bump", "zigzag"])
    sentence = ""
    if told.any():
        sentence = (f" With this size, the line puts {int(right_side.sum())} of "
                    f"{int(told.sum())} bumping or zigzagging outcomes on the right side.")
    return _row_maps(campaign) + campaign.figure(
        "mode_map", figures.draw_mode_map(points),
        "Migration mode (measured) against the empirical law for rigid spheres, "
        "D<sub>c</sub> = 1.4 G ε<sup>0.48</sup> (literature, band ±10 %). Cell size: diameter of "
        f"the sphere of equal volume, {number(float(points['size_um'].median()))} µm here, an "
        "assumption: which dimension counts depends on how the cell turns and deforms." + sentence
        + " Left: map of modes, above the line a rigid sphere bumps; side by side at each "
        "<i>N</i><sub>p</sub> stand the pillar radii, and within each the stiffness sets. Right: "
        "angle as a fraction of the bump angle across the line.",
        ["outcomes"],
    )


ROW_MAPS = 6
"""Arrays whose row maps are drawn."""


def _row_maps(campaign: Campaign) -> str:
    """Row maps of the arrays in which an outcome comes nearest to the transition."""
    near = campaign.outcomes.dropna(subset="transition_distance")
    near = near.assign(away=near["transition_distance"].abs()).sort_values("away", kind="stable")
    places = near[GEOMETRY].drop_duplicates().head(ROW_MAPS)
    runs = campaign.tables["runs"].merge(places, on=GEOMETRY)
    runs = runs[runs["lateral_steps_um"].map(len) > 0].drop_duplicates("outcome_id")
    if runs.empty:
        return ""
    return campaign.figure(
        "row_maps", figures.draw_row_maps(runs),
        f"Row maps of the {len(places)} arrays that come nearest to the transition, first release "
        "of each outcome: lateral step of a row in row shifts against the height in the gap before "
        "it, a point per row. Where the points reach the dotted line, one row shift, the bump lane "
        "can hold a cell; how far their peak stays below is the distance from the transition "
        "(<code>transition_distance</code>). Measured.",
        ["runs", "outcomes"],
    )


def _calibration(campaign: Campaign) -> str:
    for kind in ("constriction_runs", "calibration"):
        if kind not in campaign:
            return campaign.absent(kind)
    runs, calibration = campaign["constriction_runs"], campaign["calibration"]
    correlations = campaign.tables.get("calibration_correlations")
    parts = []
    broken = runs[runs["deformation_index"].isna()]
    if len(broken):
        parts.append(campaign.table(
            {"run": _texts(broken["run_id"]), "group": _texts(broken["group"]),
             "status": _texts(broken["status"]), "reason": _texts(broken["stop_reason"])},
            "Constriction runs without a deformation index; they are left out.",
            ["constriction_runs"],
        ))
    if len(calibration):
        parts.append(campaign.figure(
            "calibration", analysis_figures.draw_calibration(runs, calibration),
            "Deformation index with the cell's centre in the throat, for the source paper's design "
            "(velocity rises with stiffness) and at one velocity. Small: one run per release "
            "position along the flow, the only thing varied within a group; black: mean and 95 % "
            "confidence interval. With so few positions the points are shown instead of the "
            "source's violins. Diamonds: the source's DI of its sets 1 to 5; bands: its "
            "coefficients of variation (it names no channel dimensions). Where the two designs "
            "run in opposite directions, the rise of DI with stiffness is an effect of the "
            "velocity. Measured.", ["constriction_runs", "calibration"],
        ))
        if correlations is not None and len(correlations):
            parts.append(campaign.figure(
                "correlations", analysis_figures.draw_correlations(correlations),
                "Pearson correlations over the runs of each design; in brackets the source "
                "paper's. Moduli and velocity rise together from group to group, so a correlation "
                "in the first design is not the effect of one of them alone. A dash: constant. "
                "Measured.", ["calibration_correlations"],
            ))
        parts.append(campaign.table(
            {
                "design": _texts(calibration["design"]), "group": _texts(calibration["group"]),
                "set": _texts(calibration["stiffness_set"]),
                "<i>k</i><sub>s</sub> [µN/m]": _numbers(calibration["ks_uN_per_m"]),
                "<i>k</i><sub>b</sub> [pN·µm]": _numbers(calibration["kb_pN_um"]),
                "<i>k</i><sub>α</sub> [µN/m]": _numbers(calibration["kal_uN_per_m"]),
                "velocity [mm/s]": _numbers(calibration["velocity_mm_s"], 4),
                "runs": _numbers(calibration["runs"]),
                "DI": [f"{fixed(m, 3)} ± {fixed(s, 3)}" for m, s in zip(
                    calibration["deformation_index"], calibration["deformation_index_std"],
                    strict=True)],
                "95 % interval of the mean": [f"{fixed(a, 3)} to {fixed(b, 3)}" for a, b in zip(
                    calibration["deformation_index_low"], calibration["deformation_index_high"],
                    strict=True)],
                "range": [f"{fixed(a, 3)} to {fixed(b, 3)}" for a, b in zip(
                    calibration["deformation_index_min"], calibration["deformation_index_max"],
                    strict=True)],
                "variation": [f"{fixed(100 * v, 1)} %" if pd.notna(v) else NOT_MEASURED
                              for v in calibration["coefficient_of_variation"]],
            },
            "Calibration of the deformation index. Coefficients and velocities are from the source "
            "paper; DI, range and coefficient of variation are measured.", ["calibration"],
        ))
    if runs["deformation_index"].notna().any():
        parts.append(campaign.figure(
            "moduli", analysis_figures.draw_moduli(runs),
            "Deformation index of every constriction run against the moduli and the velocity of "
            "its group. The source paper reads the rise as the membrane's doing; the design at one "
            "velocity shows what is left of it. Measured.", ["constriction_runs"],
        ))
    folder = campaign.results / "constriction"
    files = sorted(folder.glob("*.trajectory.parquet"))
    known = set(runs["run_id"])
    tracks = [read_table("constriction_trajectory", path) for path in files]
    tracks = [track[track["run_id"].isin(known)] for track in tracks]
    tracks = [track for track in tracks if len(track)]
    if tracks:
        parts.append(campaign.figure(
            "diameters", analysis_figures.draw_diameters(pd.concat(tracks), runs),
            "Diameters of the cell's bounding box along the channel, and the deformation index "
            "from them; one line per run. Measured.",
            ["constriction_runs"], f", {campaign.link(folder)} ({len(tracks)} trajectories)",
        ))
    return "\n".join(parts)


MODEL_CAPTION = {
    "hierarchical": "Hierarchical model, main effects and interactions: the result.",
    "main_effects": "Main effects alone.",
    "seed_interactions": "Interactions without main effects, as in the source paper.",
}


def _term(name: str) -> str:
    """Term of an analysis of variance in the symbols of the text."""
    name = html.escape(name)
    for column, symbol in (("pillar_radius_um", "<i>P</i><sub>r</sub>"), ("periodicity",
                           "<i>N</i><sub>p</sub>"), ("gap_um", "<i>P</i><sub>g</sub>"),
                           ("deformation_index", "DI"), (":", " × ")):
        name = name.replace(column, symbol)
    return name


def _anova(campaign: Campaign) -> str:
    if "anova" not in campaign:
        return campaign.absent("anova")
    table = campaign["anova"]
    parts = [
        "<p>The simulation has no noise: what a model leaves over is its lack of fit, and p-values "
        "rank the effects rather than tell whether a repetition would give the same.</p>"
    ]
    if table["partial_eta_sq"].notna().any():
        parts.append(campaign.figure(
            "effects", analysis_figures.draw_effects(table),
            "How strongly each term moves θ<sub>m</sub>: partial η² = SS/(SS + "
            "SS<sub>residual</sub>), and partial ω², which allows for degrees of freedom. Filled: "
            "p &lt; 0.05 by permutation of whole geometries. The source paper's interactions are "
            "those of the right panel, a model that has no main effects and hands them to the "
            "interactions.", ["anova"],
        ))
    order = [*MODEL_CAPTION, *(m for m in table["model"].unique() if m not in MODEL_CAPTION)]
    for model in order:
        part = table[table["model"] == model]
        if part.empty:
            continue
        shown = part[part["sum_sq"].notna()]
        caption = MODEL_CAPTION.get(model, html.escape(model))
        if len(shown):
            whole = [int(df) if df == int(df) else df for df in shown["df"]]
            parts.append(campaign.table(
                {
                    "term": [_term(t) for t in shown["term"]],
                    "sum of squares [deg²]": _numbers(shown["sum_sq"], 4),
                    "df": _numbers(whole), "F": _numbers(shown["f_value"], 4),
                    "p": [probability(p) for p in shown["p_value"]],
                    "p, HC3": [probability(p) for p in shown["p_robust"]],
                    "p, permutation": [probability(p) for p in shown["p_permutation"]],
                    "partial η²": _angles(shown["partial_eta_sq"], 3),
                    "partial ω²": _angles(shown["partial_omega_sq"], 3),
                },
                f"Type II analysis of variance of θ<sub>m</sub>. {caption}", ["anova"],
            ))
        else:
            parts.append(f"<p>{caption} This model has nothing to show here.</p>")
        noted = part[(part["note"].fillna("") != "") & (part["term"] != "residual")]
        notes = [
            f"<li>{listing(_term(t) for t in group['term'])}: {text(note)}</li>"
            for note, group in noted.groupby("note", sort=False)
        ]
        if notes:
            parts.append('<ul class="notes">' + "\n".join(notes) + "</ul>")
    if "anova_diagnostics" in campaign and len(campaign["anova_diagnostics"]):
        found = campaign["anova_diagnostics"]
        tests = found[["test", "meaning"]].drop_duplicates("test")
        columns = {"residuals": _texts(tests["test"])}
        for model in found["model"].unique():
            by_test = found[found["model"] == model].set_index("test")
            columns[analysis_figures.MODEL_TITLE.get(model, model)] = [
                NOT_MEASURED if name not in by_test.index else
                number(float(by_test.loc[name, "statistic"]))
                + ("" if pd.isna(by_test.loc[name, "p_value"]) else
                   f" (p = {probability(by_test.loc[name, 'p_value'])})")
                for name in tests["test"]
            ]
        columns["how to read it"] = _texts(tests["meaning"])
        parts.append(campaign.table(
            columns, "Residuals of the models. Angles come in modes: where residuals are not "
            "normal, of unequal variance, or alike within a geometry, the F test's p is not to be "
            "taken at its word, and those beside it are.", ["anova_diagnostics"],
        ))
    if "sobol" in campaign and len(campaign["sobol"]):
        inside = campaign["sobol"]["inside_share"].iloc[0]
        parts.append(campaign.figure(
            "sobol", analysis_figures.draw_sobol(campaign["sobol"]),
            "Sobol indices of the surrogate, inputs independent and uniform over the sweep, with "
            f"95 % bootstrap intervals; {_percent(inside)} of the points lie inside the domain. "
            "Total minus first order is what an input does together with others. Unlike an "
            "analysis of variance they need no linear model, but they describe the surrogate.",
            ["sobol"],
        ))
    return "\n".join(parts)


def _robustness(campaign: Campaign) -> str:
    if "robustness" not in campaign:
        return campaign.absent("robustness")
    table = campaign["robustness"]
    if not table["stability_score_deg2"].notna().any():
        return ('<p class="absent">No array has a neighbour in the sweep, so there is no '
                "stability score.</p>")
    best = table[table["robust"].astype(bool)].sort_values("stability_score_deg2")
    parts = [
        campaign.figure(
            "robustness_map", analysis_figures.draw_robustness(table),
            "Robustness map. Number: θ<sub>m</sub> averaged over the stiffness sets. Colour: "
            "stability score, mean squared change of that angle to the neighbouring arrays of the "
            "sweep, one parameter changed at a time; low is stable. Frame: the most stable 15 %. "
            "The score depends on the steps of the sweep, and an array in which nothing happens "
            "is stable too.", ["robustness"],
        ),
        campaign.table(
            {
                "<i>P</i><sub>r</sub> [µm]": _numbers(best["pillar_radius_um"]),
                "<i>P</i><sub>g</sub> [µm]": _numbers(best["gap_um"]),
                "<i>N</i><sub>p</sub>": _numbers(best["periodicity"]),
                "mean θ<sub>m</sub> [°]": _angles(best["mean_migration_angle_deg"]),
                "score [deg²]": _numbers(best["stability_score_deg2"]),
                "neighbours": _numbers(best["neighbours"]), "modes": _texts(best["modes"]),
            },
            "The most stable arrays.", ["robustness"],
        ),
    ]
    frequent = most_frequent(table)
    parts.append(campaign.table(
        {"parameter": [_term(p) for p in frequent["parameter"]],
         "value": _numbers(frequent["value"]), "among the most stable": _numbers(frequent["count"]),
         "expected of a random choice": _angles(frequent["expected"], 1)},
        "Values that occur among the most stable arrays, most frequent first. The source paper "
        "found <i>P</i><sub>r</sub> 10, 11, 12; <i>P</i><sub>g</sub> 20, 21, 22; "
        "<i>N</i><sub>p</sub> 4, 8, 10, 11, 12. A small score there means wide gaps, in which "
        "little happens at all.", ["robustness"],
    ))
    if "fabrication" in campaign and len(campaign["fabrication"]):
        risk = campaign["fabrication"]
        wrong = int((risk.drop_duplicates([*GEOMETRY, "stiffness_set"]).eval(
            "predicted_mode != simulated_mode")).sum())
        parts.append(campaign.figure(
            "fabrication", analysis_figures.draw_fabrication(risk),
            "What a designer needs instead: probability that pillars too thick or too thin, all "
            "alike (P<sub>r</sub> ± standard deviation, pitch kept, so that the gap changes by "
            "twice as much the other way), change the mode; the worst of the stiffness sets. By "
            "Monte Carlo on the surrogate. *: more than half of the sizes lie outside its domain. "
            f"At nominal size the surrogate's mode differs from the simulated one in {wrong} of "
            f"{len(risk.drop_duplicates([*GEOMETRY, 'stiffness_set']))} runs.", ["fabrication"],
        ))
        worst = analysis_figures.worst_risk(risk)
        parts.append(campaign.table(
            {"error of <i>P</i><sub>r</sub> [µm]": _numbers(ordered_errors(worst)),
             "arrays that keep their mode with 95 %": [
                 f"{int((part['mode_change_probability'] <= 0.05).sum())} of {len(part)}"
                 for _, part in worst.groupby("radius_error_um")],
             f"arrays that move by less than {risk['moved_limit_deg'].iloc[0]:g}° with 95 %": [
                 f"{int((part['moved_probability'] <= 0.05).sum())} of {len(part)}"
                 for _, part in worst.groupby("radius_error_um")]},
            "Arrays that bear a fabrication error, for all stiffness sets.", ["fabrication"],
        ))
    return "\n".join(parts)


def ordered_errors(worst: pd.DataFrame) -> list[float]:
    """Fabrication errors in increasing order [µm]."""
    return sorted(float(e) for e in worst["radius_error_um"].unique())


def _spread(values: pd.Series, digits: int = 2) -> str:
    """Mean ± standard deviation over folds."""
    mean = number(float(values.mean()), digits)
    return f"{mean} ± {number(float(values.std()), digits)}" if len(values) > 1 else mean


def _benchmark(campaign: Campaign) -> str:
    for kind in ("benchmark", "predictions"):
        if kind not in campaign:
            return campaign.absent(kind)
    benchmark, predictions = campaign["benchmark"], campaign["predictions"]
    if predictions.empty:
        return '<p class="absent">The benchmark holds no prediction.</p>'
    scores = analysis_figures.pooled_scores(predictions)
    models = list(dict.fromkeys(scores["model"]))
    splits = [s for s in analysis_figures.SPLIT_COLOUR if (scores["split"] == s).any()]
    columns: dict[str, list[str]] = {"model": _texts(models)}
    for split in splits:
        folds = benchmark[benchmark["split"] == split].groupby("model")
        found = scores[scores["split"] == split].set_index("model")
        mean = {n: folds[n].agg(_spread) for n in ("mse_deg2", "rmse_deg", "mae_deg")}
        for name, heading in (("mse_deg2", "MSE [deg²]"), ("rmse_deg", "RMSE [°]"),
                              ("mae_deg", "MAE [°]")):
            columns[f"{heading}<br><small>{split}</small>"] = [
                mean[name].get(m, NOT_MEASURED) for m in models]
        columns[f"median error [°]<br><small>{split}</small>"] = [
            fixed(found["median_deg"].get(m, math.nan), 2) for m in models]
        columns[f"R²<br><small>{split}</small>"] = [
            fixed(found["r2"].get(m, math.nan), 3) for m in models]
    times = benchmark.groupby("model")[["fit_time_s", "predict_time_s"]].mean()
    for name, heading in (("fit_time_s", "fit [ms]"), ("predict_time_s", "predict [ms]")):
        columns[heading] = [number(1e3 * float(times.loc[m, name]), 2) for m in models]
    best = models[0]
    parts = [
        "<p>A <b>random split</b> leaves other stiffness sets of the same array in the training "
        "data; a <b>split by geometry</b> keeps whole arrays back, a <b>split by stiffness set</b> "
        "whole cell types. Only the second tells a designer what an array that was never simulated "
        "will do. Settings are chosen by cross-validation within the training data. “Bounded” "
        "models predict the share of the bump displacement and know its two limits.</p>",
        campaign.figure(
            "benchmark", analysis_figures.draw_benchmark(scores, benchmark),
            "Error of the regressors on held-out runs. Large markers: all held-out predictions "
            "together, for R² with the range over repeated splits; bars: single folds. The source "
            "paper's R² = 0.9999 comes from a random split.", ["benchmark", "predictions"],
        ),
        campaign.table(
            columns, "Regressors, best by geometry first. MSE, RMSE and MAE: mean ± standard "
            "deviation over folds; median error and R² over all held-out predictions together.",
            ["benchmark", "predictions"],
        ),
        campaign.figure(
            "parity", analysis_figures.draw_parity(predictions, scores, best),
            f"Held-out predictions of {text(best)}, the best by geometry, against the simulated "
            "angle.", ["predictions"],
        ),
        campaign.figure(
            "residuals", analysis_figures.draw_residuals(predictions, campaign.outcomes, best),
            f"Residuals of {text(best)} on arrays held out. The source paper's are a narrow band "
            "about zero, from a random split; here they are widest between the limits, where an "
            "array decides between zigzag and bump.", ["predictions", "outcomes"],
        ),
    ]
    if "partial_dependence" in campaign and len(campaign["partial_dependence"]):
        parts.append(campaign.figure(
            "partial_dependence",
            analysis_figures.draw_partial_dependence(campaign["partial_dependence"]),
            "Interaction of pairs of inputs after the surrogate: mean prediction with the others "
            "as in the outcomes, over combinations inside the domain; blank where there is none. "
            "The source paper's maps of (<i>N</i><sub>p</sub>, <i>P</i><sub>g</sub>) and "
            "(<i>N</i><sub>p</sub>, <i>P</i><sub>r</sub>) are one and the same, since its gap "
            "follows from the radius.", ["partial_dependence"],
        ))
    return "\n".join([*parts, _card(campaign)])


def _card(campaign: Campaign) -> str:
    """What the surrogate's card says of errors, intervals and domain."""
    path = campaign.results / "surrogate_card.json"
    if not path.exists():
        return ('<p class="absent">The surrogate is not fitted. Make it with <code>snakemake -j2 '
                "surrogate</code>.</p>")
    card = json.loads(path.read_text(encoding="utf-8"))
    score, rule, target = (card[f"{n}_by_geometry"] for n in ("scores", "baseline", "target"))
    ranges = card["domain"]["ranges"]["deformation_index"]
    covered = campaign.table(
        {"level": [f"{100 * m['level']:g} %" for m in card["conformal"]["measured"]],
         "measured coverage": [
             f"{fixed(100 * m['coverage'], 1)} ± {fixed(100 * m['coverage_error'], 1)} %"
             for m in card["conformal"]["measured"]],
         "mean half width [°]": _angles(
             m["mean_half_width_deg"] for m in card["conformal"]["measured"])},
        "Conformal prediction intervals of the surrogate on geometries held out, each geometry "
        "counting once; ± standard error over the geometries.",
    )
    reached = "reached" if target["reached"] else "not reached"
    return (
        f"<p>The surrogate ({campaign.link(path)}) was learnt from "
        f"{counted(card['data']['used'], 'outcome')} of "
        f"{counted(card['data']['geometries'], 'array')}, {card['data']['undecided']} of them "
        "undecided. On arrays held out: RMSE "
        f"{number(score['rmse_deg'], 2)}°, median error "
        f"{number(score['median_absolute_error_deg'], 2)}°, R² "
        f"{fixed(score['r2'], 3)}; the rule of the critical diameter: RMSE "
        f"{number(rule['rmse_deg'], 2)}°. The target (R² of at least {target['r2']}, "
        f"median error of at most {target['median_absolute_error_deg']}°) is <b>{reached}</b>. It "
        f"holds for DI {fixed(ranges[0], 3)} to {fixed(ranges[1], 3)} and inside the hull of the "
        "arrays simulated; outside, an interval is the whole range from zigzag to bump.</p>\n"
        + covered
    )


def _designs(campaign: Campaign) -> str:
    parts = ["<h3>Designs verified by simulation</h3>", *_verified(campaign)]
    parts.append("<h3>Candidates of the search</h3>")
    if "designs" not in campaign:
        parts.append(campaign.absent("designs"))
    elif campaign["designs"].empty:
        parts.append('<p class="absent">No design was asked for.</p>')
    else:
        parts += _candidates(campaign)
    parts.append("<h3>Course of the search</h3>")
    if "design_trials" not in campaign:
        parts.append(campaign.absent("design_trials"))
    elif len(campaign["design_trials"]):
        parts += _course(campaign)
    return "\n".join(parts)


def _array_columns(table: pd.DataFrame) -> dict[str, list[str]]:
    return {
        "<i>P</i><sub>r</sub> [µm]": _angles(table["pillar_radius_um"]),
        "<i>P</i><sub>g</sub> [µm]": _angles(table["gap_um"]),
        "<i>N</i><sub>p</sub>": _numbers(table["periodicity"]),
    }


def _both(table: pd.DataFrame, name: str, decimals: int = 2) -> list[str]:
    """Values of both cell types, with their modes."""
    pairs = zip(table[f"{name}_1_deg"], table["mode_1"], table[f"{name}_2_deg"], table["mode_2"],
                strict=True)
    return [f"{fixed(a, decimals)} {figures.mode_name(m)},<br>"
            f"{fixed(b, decimals)} {figures.mode_name(n)}" for a, m, b, n in pairs]


def _range(table: pd.DataFrame, low: str, high: str) -> list[str]:
    return [f"{fixed(a, 2)} to {fixed(b, 2)}"
            for a, b in zip(table[low], table[high], strict=True)]


def _verified(campaign: Campaign) -> list[str]:
    """What came of simulating the candidates, request by request."""
    if "verified_designs" not in campaign or "verifications" not in campaign:
        return [campaign.absent("verified_designs")]
    verifications = campaign["verifications"]
    if verifications.empty:
        return ['<p class="absent">No candidate was simulated (verification.rounds).</p>']
    parts = [
        "<p>Both cell types were simulated in the best candidates of each round, with the "
        "campaign's solver and at their own radius; the runs were then learnt from and the search "
        "repeated. A prediction is confirmed if the simulated difference, ± σ<sub>num</sub>, meets "
        "its 90 % interval. A design separates if from every place of release the cells differ by "
        "more than 2 σ<sub>num</sub>, or the bounds of undecided outcomes do not overlap, and if "
        "the same holds on the next finer lattice at half the numerical Reynolds number; what is "
        "between is open. Measured.</p>",
        campaign.figure(
            "verification", design_figures.draw_rounds(verifications),
            "Prediction and simulation, in the order of the runs; dotted lines separate rounds. "
            "Bars of the markers: 2 σ<sub>num</sub>, where it was studied. The last ones repeat "
            "designs on a finer lattice or at another channel height, for which nothing was "
            "predicted: the grey bar there is the prediction after all simulations, for the "
            "nominal height.", ["verifications"],
        ),
    ]  # fmt: skip
    for request, table in campaign["verified_designs"].groupby("request", sort=False):
        folder = campaign.results / "designs" / str(request)
        links = [f"{text(n)}: {', '.join(map(campaign.link, files))}" for n in table["name"]
                 if (files := sorted(folder.glob(f"{n}.*")))]
        parts.append(campaign.table(
            {
                "rank": _numbers(table["rank"]), "design": _texts(table["name"]),
                "round": _numbers(table["round"]), **_array_columns(table),
                "simulated θ<sub>m</sub> of cells 1, 2 [°]": _both(table, "angle"),
                "simulated separation [°]": [
                    fixed(s, 2) + (f" ± {fixed(u, 2)}" if pd.notna(u) else "")
                    for s, u in zip(table["separation_deg"], table["sigma_num_deg"], strict=True)],
                "finer lattice, half Re [°]<br><small>simulated</small>": _angles(
                    table["separation_finer_deg"]),
                "predicted before [°]": [
                    f"{fixed(s, 2)} ± {fixed(u, 2)}" for s, u in zip(
                        table["predicted_separation_deg"], table["uncertainty_deg"], strict=True)],
                "over ± <i>P</i><sub>r</sub>, <i>P</i><sub>g</sub> [°]<br><small>predicted"
                "</small>": _range(table, "separation_tolerance_min_deg",
                                   "separation_tolerance_max_deg"),
                "lower, higher channel [°]<br><small>simulated</small>": [
                    f"{fixed(a, 2)}, {fixed(b, 2)}" for a, b in zip(
                        table["separation_low_height_deg"], table["separation_high_height_deg"],
                        strict=True)],
                "length [mm]": _numbers(table["length_mm"]),
                "pressure drop [kPa]": _numbers(table["pressure_drop_kPa"], 2),
                "verdict": _texts(table["verdict"]),
            },
            f"Designs for “{text(request)}”, ordered by the simulated separation. "
            f"Rounds ended: {text(table['stopped'].iloc[0])}. Throughput of the whole array: "
            f"{number(float(table['throughput_uL_per_h'].iloc[0]))} µL/h. Pressure drop over the "
            f"length given: {text(table['pressure_basis'].iloc[0])}."
            + (f" Files of {'; '.join(links)}." if links else ""),
            ["verified_designs"], table["separates"].isin([False]) | table["separation_deg"].isna(),
        ))
        parts += [_picture(path) for name in table["name"]
                  if (path := folder / f"{name}.passage.png").exists()]
    rows = verifications[verifications["population"] != "difference"]
    listing_ = campaign.table(
        {
            "request": _texts(rows["request"]), "round": _numbers(rows["round"]),
            "role": _texts(rows["role"]), **_array_columns(rows),
            "height [µm]": _numbers(rows["height_um"]), "cell": _texts(rows["population"]),
            "radius [µm]": _numbers(rows["cell_radius_um"]),
            "k<sub>s</sub> [µN/m]": _numbers(rows["ks_uN_per_m"]),
            "predicted [°]": _range(rows, "predicted_low_deg", "predicted_high_deg"),
            "simulated [°]": [
                fixed(s, 2) + (f" ± {fixed(u, 2)}" if pd.notna(u) else "")
                for s, u in zip(rows["simulated_deg"], rows["sigma_num_deg"], strict=True)],
            "mode": map(figures.mode_name, rows["mode"]), "verdict": _texts(rows["verdict"]),
            "note": _texts(rows["note"]),
        },
        "All outcomes of the verification. Shaded: the prediction was missed, or no angle.",
        ["verifications"],
        rows["agrees"].isin([False]) | rows["simulated_deg"].isna(),
    )
    parts.append(f"<details><summary>All {len(rows)} outcomes of the verification</summary>\n"
                 f"{listing_}\n</details>")
    return parts


def _picture(path: Path) -> str:
    """A picture file embedded in the page."""
    payload = base64.b64encode(path.read_bytes()).decode()
    name = path.name.partition(".")[0]
    return (f'<figure><img alt="{text(name)}" width="920" src="data:image/png;base64,{payload}">'
            f"<figcaption>{text(name)}: both cell types on their way through the array, simulated "
            "one by one.</figcaption></figure>")


def _candidates(campaign: Campaign) -> list[str]:
    designs = campaign["designs"]
    parts = [campaign.figure(
        "designs", figures.draw_designs(designs),
        "Candidates, predicted by the surrogate and not simulated. Line: range of the separation "
        "over the fabrication tolerance on <i>P</i><sub>r</sub> and <i>P</i><sub>g</sub>. Shade: "
        "half-width of the 90 % prediction interval of the difference; a separation inside the "
        "shade is not resolved. Candidates of one rank are closer than their σ<sub>num</sub>: "
        "their order means nothing.", ["designs"],
    )]  # fmt: skip
    for request, table in designs.groupby("request", sort=False):
        parts.append(campaign.table(
            {
                "rank": _numbers(table["rank"]), **_array_columns(table),
                "θ<sub>m</sub> of cells 1, 2 [°]": _both(table, "angle"),
                "separation [°]": [
                    f"{fixed(s, 2)} ± {fixed(u, 2)}" for s, u in zip(
                        table["separation_deg"], table["uncertainty_deg"], strict=True)],
                "σ<sub>num</sub> [°]": _angles(table["sigma_num_deg"]),
                "over tolerance [°]": _range(table, "separation_tolerance_min_deg",
                                             "separation_tolerance_max_deg"),
                "robust [°]": _angles(table["robust_separation_deg"]),
                "mode changes": [f"{p:.0%}" for p in table["mode_change_probability"]],
                "length [mm]": _numbers(table["length_mm"]),
                "pressure drop [kPa]": _numbers(table["pressure_drop_kPa"], 2),
                "in training domain": _numbers(table["inside_training_domain"]),
                "verdict": _texts(table["verdict"]),
            },
            f"Candidates for “{text(request)}”, objective {text(table['objective'].iloc[0])}. "
            "Robust: the separation that nine of ten Monte Carlo draws exceed, with spread of the "
            "cells, error of the prediction and fabrication tolerance; mode changes: share of the "
            "draws with another mode. Pressure drop: "
            f"{text(table['pressure_basis'].iloc[0])}. Predicted, not simulated.", ["designs"],
        ))
    if "design_tolerances" in campaign:
        table = campaign["design_tolerances"]
        table = table[table["design"] == 1]
        parts.append(campaign.table(
            {
                "request": _texts(table["request"]), "off": _texts(table["parameter"]),
                "by": _numbers(table["offset"], 2),
                "θ<sub>m</sub> of cells 1, 2 [°]": _both(table, "angle"),
                "separation [°]": _angles(table["separation_deg"]),
                "slope [° per µm or per 1]": _numbers(table["sensitivity_deg_per_unit"], 2),
            },
            "Best candidate of each request with one thing off. edge_um: every pillar edge "
            "outwards at the pitch of the mask. The channel height is no input of the surrogate: "
            "the verification simulates it. Predicted.", ["design_tolerances"],
        ))
    return parts


def _course(campaign: Campaign) -> list[str]:
    trials = campaign["design_trials"]
    refused = trials[~trials["feasible"].astype(bool)]
    reasons = refused["reason"].fillna("").value_counts()
    listed = "; ".join(f"{number(int(n))} × {text(r)}" for r, n in reasons.items())
    parts = [
        campaign.figure(
            "search", design_figures.draw_history(trials),
            "Course of the search. The robust objective is in degrees above zero; below, where the "
            "order of the cells is open, a share of the range of the draws. Crosses on the axis: "
            "infeasible trials." + (f" Reasons: {listed}." if listed else ""), ["design_trials"],
        ),
        campaign.figure(
            "search_parallel", design_figures.draw_parallel(trials),
            "Feasible trials over the parameters and the objective, best in yellow. Numbers: ends "
            "of the axes.", ["design_trials"],
        ),
    ]
    if "design_importance" in campaign:
        table = campaign["design_importance"]
        parts.append(campaign.figure(
            "search_importance", design_figures.draw_importance(table),
            "Importance of the parameters: " + text("; ".join(table["evaluator"].unique()))
            + ".", ["design_importance"],
        ))
    if "design_slices" in campaign and "designs" in campaign:
        parts.append(campaign.figure(
            "search_slices", design_figures.draw_slices(campaign["design_slices"],
                                                        campaign["designs"]),
            "Predicted difference of the angles over two parameters, the third as in the best "
            "candidate (star). Hatched: infeasible, or outside the training geometries.",
            ["design_slices"],
        ))
    return parts


def _flow(campaign: Campaign) -> str:
    if "flows" not in campaign:
        return campaign.absent("flows")
    table = campaign["flows"]
    if table.empty:
        return '<p class="absent">The table of flows has no row.</p>'
    if table["permeability_over_pitch2"].isna().all():
        return '<p class="absent">Every flow of this campaign failed.</p>'
    worst = float(table["lateral_flux_ratio"].abs().max())
    return "\n".join([
        campaign.figure(
            "flows", figures.draw_flows(table),
            "Flow through the arrays without a cell. Left: permeability along x. Right: angle by "
            "which the stream would leave the x axis under a force along x alone. With the drive "
            f"of the runs, the lateral flux is at most {number(worst, 2)} of the axial one. "
            "Measured.", ["flows"],
        ),
        "<details><summary>Table of flows</summary>",
        campaign.table(
            {
                "<i>P</i><sub>r</sub> [µm]": _numbers(table["pillar_radius_um"]),
                "<i>P</i><sub>g</sub> [µm]": _numbers(table["gap_um"]),
                "<i>N</i><sub>p</sub>": _numbers(table["periodicity"]),
                "permeability/λ²": _numbers(table["permeability_over_pitch2"]),
                "tilt [°]": _angles(table["tilt_deg"]),
                "lateral/axial flux": _numbers(table["lateral_flux_ratio"], 2),
                "Δx [µm]": _numbers(table["spacing_um"]),
                "nodes": _numbers(table["nodes"]), "steps": _numbers(table["steps"]),
                "time [s]": _numbers(table["wall_time_s"], 2),
                "status": _texts(table["status"]),
            },
            "Empty arrays.", ["flows"],
        ),
        "</details>",
    ])


NUMERICS = {
    "ms_per_step": ("wall time per step", "ms"),
    "mlups": ("speed", "MLUPS"),
    "steps": ("steps", "1"),
    "nodes": ("fluid nodes", "1"),
    "vertices": ("membrane vertices", "1"),
    "wall_time_s": ("wall time per run", "s"),
    "spacing_um": ("lattice spacing Δx", "µm"),
    "time_step_us": ("time step", "µs"),
    "capillary_number": ("capillary number μU/k<sub>s</sub>", "1"),
    "lag_number": ("lag number (numerical Reynolds number)", "1"),
    "mach_max": ("largest Mach number", "1"),
    "volume_drift_max": ("largest volume drift", "1"),
    "area_drift_max": ("largest area drift", "1"),
    "min_clearance_um": ("smallest clearance", "µm"),
    "lateral_flux_ratio": ("lateral/axial flux", "1"),
}


def _numerics(campaign: Campaign) -> str:
    runs = campaign.runs
    if runs.empty:
        return '<p class="absent">No run of this campaign was finished.</p>'
    names = [name for name in NUMERICS if runs[name].notna().any()]

    def column(what: Callable) -> list[str]:
        return [number(float(what(runs[name].dropna())), 3) for name in names]

    left_out = runs["left_out"].fillna("").replace("", "nothing").value_counts()
    return "\n".join([
        campaign.figure(
            "numerics", figures.draw_numerics(runs),
            "Cost and conservation. Left: wall time of a step. Middle: share of runs whose largest "
            "drift of volume or area stays below the value; dotted: 2 %. Right: wall time of each "
            "run by migration mode. Measured.", ["runs"],
        ),
        campaign.table(
            {
                "quantity": [NUMERICS[n][0] for n in names],
                "unit": [NUMERICS[n][1] for n in names],
                "smallest": column(np.min), "median": column(np.median),
                "largest": column(np.max),
            },
            "Numerics over all runs.", ["runs"],
        ),
        campaign.table(
            {"left out of the simulation": _texts(left_out.index),
             "runs": _numbers(left_out.to_numpy())},
            "What the scenes did not need and therefore did not compute.", ["runs"],
        ),
    ])


def _validation(campaign: Campaign) -> str:
    if "validation" not in campaign:
        return campaign.absent("validation")
    table = campaign["validation"]
    present = set(table.loc[table["relative_error"].notna(), "case"])
    parts = [
        "<p>Cases with a reference that is exact, published, or computed by another method. They "
        "run apart from this campaign, at the resolutions stated. What each mark allows and why is "
        "in <code>docs/validation.md</code>.</p>",
        _case_table(campaign), _failing_table(campaign),
    ]
    if {"square-arrays", "row-shifted-arrays", "duct-poiseuille"} & present:
        parts.append(campaign.figure(
            "convergence", validation_figures.draw_convergence(table),
            "Error over resolution: every quantity (thin) and their root mean square (thick). "
            "Surfaces that fit the lattice, and interpolated bounce-back on average, gain with "
            "order two; half-way bounce-back gains with order one, unsteadily, as the staircase "
            "changes with the resolution. Measured.", ["validation"],
        ))
    if "square-arrays" in present:
        parts.append(campaign.figure(
            "square_arrays", validation_figures.draw_square_arrays(table),
            "Permeability of square arrays of cylinders beside Sangani &amp; Acrivos (1982). "
            "Dotted: error of a wall out of place by half a node (half-way) or a tenth of one "
            "(interpolated). Measured.", ["validation"],
        ))
    if {"row-shifted-arrays", "finite-height-arrays"} & present:
        parts.append(campaign.figure(
            "tilts", validation_figures.draw_tilts(table),
            "Angle by which the stream leaves the x axis under a force along x, beside independent "
            "computations; errors at all resolutions on the right. Measured.", ["validation"],
        ))
    if "erythrocyte-stretching" in present:
        parts.append(campaign.figure(
            "stretching", validation_figures.draw_stretching(table),
            "Red cell pulled by optical tweezers, no parameter fitted. Bars: bounds of the "
            "experiment on the side of our value. Lines computed, points from literature (Mills et "
            "al. 2004, Suresh et al. 2005).", ["validation"],
        ))
    if "capsule-in-shear" in present:
        parts.append(campaign.figure(
            "capsules", validation_figures.draw_capsules(table),
            "Capsules in simple shear, with the surface shear modulus in Ca. Dots: ours; squares: "
            "boundary integral (G<sub>s</sub> laws) and small-deformation theory; grey: published "
            "codes, membranes without bending. Springs have the shear modulus √3/4 k<sub>s</sub> "
            "and are another law, beside the neo-Hookean curve. Measured.", ["validation"],
        ))
    if "rigid-transition" in present:
        parts.append(campaign.figure(
            "transition", validation_figures.draw_transition(table),
            "Critical diameter of stiff spheres, bracketed by bisection (bars), over the row "
            "shift. Line: empirical law of measured devices with their scatter; dashed: critical "
            "diameter of a point-like follower, from the stream lanes. Measured.", ["validation"],
        ))
    if "constriction-shape" in present:
        parts.append(campaign.figure(
            "constriction_shape", validation_figures.draw_constriction_shape(table),
            "Diameters along (D) and across (H) the flow at four positions of a constriction: the "
            "source paper's experiment (bars: 11.25 %, the largest deviation of its own "
            "simulation), and ours in channels that the experiment does not name. "
            "Measured.", ["validation"],
        ))
    return "\n".join(parts)


def _case_table(campaign: Campaign) -> str:
    table = validation_figures.with_levels(campaign["validation"])
    unresolved = table.groupby("case")["resolution"].transform("count") == 0
    finest = table[table["finest"] & table["mark"].notna()
                   & (table["resolution"].notna() | unresolved)]
    orders = validation_figures.observed_orders(campaign["validation"])
    cases = verdicts(_records(campaign["validation"]))

    def largest_error(case: str) -> str:
        part = finest[finest["case"] == case].assign(size=lambda t: t["relative_error"].abs())
        if not set(part["variant"]) <= set(validation_figures.VARIANT_COLOUR):
            part = part.assign(variant="")
        return _by_variant(part.groupby("variant")["size"].max().items(), _percent)

    def order(case: str) -> str:
        part = orders[orders["case"] == case]
        return _by_variant(zip(part["variant"], part["order"], strict=True), lambda v: fixed(v, 1))

    names = [case["case"] for case in cases]
    return campaign.table(
        {
            "case": _texts(names),
            "what": _texts(CASES[name].title if name in CASES else "" for name in names),
            "reference": _texts(CASES[name].source if name in CASES else "" for name in names),
            "largest error, finest resolution": map(largest_error, names),
            "order": map(order, names),
            "within marks": [f"{case['marked'] - case['failed']} of {case['marked']}"
                             for case in cases],
            "result": ["fails" if case["failed"] else "passes" for case in cases],
            "time [s]": _numbers((case["wall_time_s"] for case in cases), 2),
        },
        "Validation cases. Order: of the root mean square error, between the coarsest and the "
        "finest resolution; a dash where the error is rounding or there is one resolution. Failing "
        "cases are shaded.",
        ["validation"], [case["failed"] > 0 for case in cases],
    )


def _by_variant(values: Iterable[tuple[str, float]], form: Callable[[float], str]) -> str:
    """Values with their variants, a dash for none."""
    parts = [f"{text(variant)} {form(value)}" if variant else form(value)
             for variant, value in values]
    return ", ".join(parts) or NOT_MEASURED


def _percent(value: float) -> str:
    return NOT_MEASURED if pd.isna(value) else f"{number(100 * float(value), 2)} %"


def _failing_table(campaign: Campaign) -> str:
    table = campaign["validation"]
    failing = table[table["passed"].eq(False)]
    if failing.empty:
        return "<p>Every case keeps to its marks.</p>"
    reasons = failing.loc[failing["note"] != "", ["case", "note"]].drop_duplicates()
    return campaign.table(
        {
            "case": _texts(failing["case"]), "quantity": _texts(failing["quantity"]),
            "variant": _texts(failing["variant"]),
            "at": [f"{text(name)} {number(value)}" if name else NOT_MEASURED for name, value in zip(
                failing["parameter_of"], failing["parameter"], strict=True)],
            "error": map(_percent, failing["relative_error"]),
            "allowed": map(_percent, failing["mark"]),
        },
        "Comparisons that miss their mark.", ["validation"],
    ) + '<ul class="notes">' + "".join(
        f"<li>{text(case)}: {text(note)}</li>" for case, note in reasons.to_numpy()
    ) + "</ul>"


def _records(table: pd.DataFrame) -> list[dict]:
    """Rows as dicts, null as None."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def _stability(campaign: Campaign) -> str:
    if "stability" not in campaign:
        return campaign.absent("stability")
    table = campaign["stability"]
    found = stability_sweep.verdict(_records(table))
    broken, least, largest = found["broken"], found["least_failing"], found["largest_running"]
    sentences = [
        f"{counted(found['points'], 'run')} of one cell each over two or three rows, with one "
        "thing driven to an extreme.",
        f"{counted(len(broken), 'run')} predicted safe blew up." if broken
        else "None that was predicted safe blew up.",
    ]
    if least is not None:
        sentences.append(
            f"With the step as given, the smallest margin that blew up is {number(least)}"
            + (f", the largest that ran {number(largest)}." if largest is not None else ".")
        )
    if found["refused"]:
        sentences.append(
            f"{counted(found['refused'], 'scene')} did not fit its place and was refused with a "
            "message (listed below)."
        )
    parts = [
        f"<p>{' '.join(sentences)} Measured; the margins are predictions made before each run "
        "(<code>docs/validation.md</code>).</p>",
        campaign.figure(
            "stability_map", stability_figures.draw_map(table),
            "Margin of every point, and what happened. Right of the line the step given is not "
            "safe: filled markers ran with a shorter one. Measured.", ["stability"],
        ),
    ]
    if table["family"].str.startswith("stiffness-").any():
        parts.append(campaign.figure(
            "stability_cost", stability_figures.draw_cost(table),
            "Cost of stiff membranes: factor on the number of time steps. Measured.",
            ["stability"],
        ))
    odd = table[(table["outcome"] != stability_sweep.RAN) & (table["time_step"] == "automatic")]
    if len(odd):
        parts.append(campaign.table(
            {
                "scene": _texts(odd["title"]), "point": _texts(odd["label"]),
                "outcome": _texts(odd["outcome"]), "margin": _numbers(odd["margin"]),
                "reason": _texts(odd["reason"]),
            },
            "Points that did not run with the automatic time step.", ["stability"],
        ))
    return "\n".join(parts)


def _accuracy(campaign: Campaign) -> str:
    parts = ["<h3>Simulation: error against run time</h3>"]
    if "accuracy" not in campaign:
        parts.append(campaign.absent("accuracy"))
    else:
        parts += _work_precision(campaign)
    parts.append("<h3>Numerical uncertainty of an angle</h3>")
    parts.append(_basis_of_sigma(campaign))
    if "reference_check" in campaign:
        parts += _reference_check(campaign)
    if "spot_check" in campaign:
        parts += _spot_check(campaign)
    if "convergence" in campaign:
        parts.append(_convergence(campaign))
    parts.append("<h3>Surrogate: error against the number of outcomes</h3>")
    if "learning_curve" not in campaign:
        parts.append(campaign.absent("learning_curve"))
    elif len(campaign["learning_curve"]):
        sigma = campaign.outcomes["sigma_num_deg"].dropna()
        parts.append(campaign.figure(
            "learning_curve", accuracy_figures.draw_learning_curve(
                campaign["learning_curve"],
                float(np.sqrt(np.mean(sigma**2))) if len(sigma) else None),
            "Left: error on arrays that were held out, against the number of outcomes learnt from; "
            "median and quartiles over repeated splits. A curve that still falls at its right end "
            "gains from more outcomes. Right: time of one fit, and of simulating them one after "
            "the other. Measured.", ["learning_curve"],
        ))
    parts.append("<h3>Design search: regret against time</h3>")
    if "search_regret" not in campaign:
        parts.append(campaign.absent("search_regret"))
    elif len(campaign["search_regret"]):
        parts.append(campaign.figure(
            "search_regret", accuracy_figures.draw_regret(campaign["search_regret"]),
            "What a search misses of the largest separation that any of them found, against the "
            "geometries tried and against time; median and range over repeats with different "
            "seeds. Every evaluation is a prediction of the surrogate, not a simulation, and the "
            "largest separation is one of the surrogate too. Measured.", ["search_regret"],
        ))
    return "\n".join(parts)


def _work_precision(campaign: Campaign) -> list[str]:
    table = campaign["accuracy"]
    angles, indices = (table[table["quantity"] == q] for q in (ANGLE, INDEX))
    parts = [
        "<p><b>Measured</b>: angles, deformation indices and wall times of the runs named below, "
        "each repeated with other numerical settings. <b>Assumed</b>: that the combined reference "
        "is near enough to the limit of vanishing spacing and time step; its own error is not in "
        "the figures. Nothing here is from literature. An error of θ<sub>m</sub> is given as a "
        "share of the bump angle, which it can hardly exceed: where a setting changes the mode, it "
        "says that the mode is undecided, and not by how much. Angles are means over nearby "
        "starts; the shaded band is what they differ by through the starts alone, and smaller "
        "errors mean nothing.</p>",
    ]
    for part, quantity, name in ((angles, ANGLE, "knobs_angle"), (indices, INDEX, "knobs_index")):
        if (part["kind"] == "knob").any() and part["error_share"].notna().any():
            parts.append(campaign.figure(
                name, accuracy_figures.draw_knobs(part, quantity),
                f"Error of {accuracy_figures.NAMES[quantity]} against the finest value of each "
                "knob, all else at its default, over the wall time of a run. Ringed: the default. "
                "Open: a motion that did not repeat. Errors below 0.01 % are drawn there.",
                ["accuracy"],
            ))
    whole = {q: accuracy_figures.overall(table, q) for q in (ANGLE, INDEX)}
    if any(len(t) for t in whole.values()):
        parts.append(campaign.figure(
            "pareto", accuracy_figures.draw_pareto(table),
            "Error against the combined reference, root mean square over the cases, and cost. "
            "On the Pareto front no other setting studied is both cheaper and better.",
            ["accuracy"],
        ))
        parts.append(campaign.figure(
            "gains", accuracy_figures.draw_gains(table),
            "Which knob buys most: change of that error when one setting leaves its default, with "
            "the factor in wall time. To the left it gets better. Inside the band it is not told "
            "from the choice of the start.", ["accuracy"],
        ))
        parts.append(_settings_table(campaign))
    missing = table[table["value"].isna()]
    if len(missing):
        parts.append(campaign.table(
            {"case": _texts(missing["case"]), "setting": [
                f"{text(knob)} = {text(value)}" for knob, value in zip(
                    missing["knob"], missing["setting"], strict=True)],
             "status": _texts(missing["status"])},
            "Points without a value; they are in no figure.", ["accuracy"],
        ))
    parts.append(_points_table(campaign))
    return parts


def _settings_table(campaign: Campaign) -> str:
    whole = campaign["accuracy"]
    whole = whole[whole["kind"] == SETTING]

    def value(row) -> str:
        unit = "°" if row["quantity"] == ANGLE else ""
        return fixed(row["value"], 2 if unit else 4) + unit

    rows = [row for _, row in whole.iterrows()]
    return campaign.table(
        {
            "case": _texts(whole["case"]), "setting": _texts(whole["knob"]),
            "differs from the default in": [
                "nothing" if s == "{}" else text(s.strip("{}").replace('"', ""))
                for s in whole["setting"]],
            "θ<sub>m</sub> or DI": map(value, rows),
            "mode": [text(row["mode"].strip("/")) for row in rows],
            "error": map(_percent, whole["error_to_reference_share"]),
            "starts": map(_percent, whole["noise_share"]),
            "wall time [s]": _numbers(whole["wall_time_s"], 2),
            "spacing [µm]": _numbers(whole["spacing_um"]),
            "status": _texts(whole["status"]),
        },
        "Whole settings against the combined reference. Error: of the mean over the starts, as a "
        "share of the bump angle or of the reference's deformation index. Starts: what the starts "
        "alone make such an error differ by. Shaded: a motion had not "
        "settled.", ["accuracy"], ~whole["settled"].astype(bool),
    )


def _points_table(campaign: Campaign) -> str:
    table = campaign["accuracy"]
    knobs = table[table["kind"] != SETTING]
    inner = campaign.table(
        {
            "case": _texts(knobs["case"]), "knob": _texts(knobs["knob"]),
            "value": [text(s.strip('"')) + (" (default)" if d else "") for s, d in zip(
                knobs["setting"], knobs["is_default"], strict=True)],
            "θ<sub>m</sub> [°] or DI": _angles(knobs["value"].astype(float), 4),
            "error": map(_percent, knobs["error_share"]),
            "to the reference": map(_percent, knobs["error_to_reference_share"]),
            "wall time [s]": _numbers(knobs["wall_time_s"], 2),
            "status": _texts(knobs["status"]),
        },
        "One knob at a time: error against the finest value of the knob (the last of its list), "
        "and against the combined reference. Shaded: not settled.", ["accuracy"],
        ~knobs["settled"].astype(bool),
    )
    return f"<details><summary>Table of all {len(knobs)} points</summary>\n{inner}\n</details>"


def _basis_of_sigma(campaign: Campaign) -> str:
    bases = campaign.outcomes["sigma_num_basis"].str.partition(":")[0].value_counts()
    listed = "; ".join(f"{text(basis)} ({number(int(n))})" for basis, n in bases.items())
    return (
        "<p>σ<sub>num</sub>² = (<i>h</i>/1.96)² + (<i>c</i> θ<sub>bump</sub>)² + <i>v</i> Δ²: half "
        "the 95 % interval of the angle; what angles of the same mode are off by; and the step to "
        "the other mode, whose variance <i>v</i> follows from the distance to the transition and "
        "is ¼ where the other mode has a chance of 5 % or more. It is one standard deviation. In "
        f"this campaign it is {listed}.</p>"
    )


def _reference_check(campaign: Campaign) -> list[str]:
    check = campaign["reference_check"]
    parts = [f"<p>{text(uncertainty.closing_sentence(_records(check)))}</p>"]
    if check["error_over_sigma"].notna().any():
        parts.append(campaign.figure(
            "sigma_num", accuracy_figures.draw_sigma(check),
            "Difference of the angles at the campaign's numerics from those at the reference's, "
            "beside σ<sub>num</sub>. Measured.", ["reference_check"],
        ))
    parts.append(campaign.table(
        {
            "pair": _texts(check["outcome_id"]),
            "mode": [text(m if m == r else f"{m}, reference {r}") for m, r in zip(
                check["mode"], check["reference_mode"], strict=True)],
            "θ<sub>m</sub> [°]": _angles(check["migration_angle_deg"]),
            "reference [°]": _angles(check["reference_angle_deg"]),
            "difference [°]": _angles(check["error_deg"]),
            "σ<sub>num</sub> [°]": _angles(check["sigma_num_deg"]),
            "distance, reference": [f"{fixed(a, 2)}, {fixed(b, 2)}" for a, b in zip(
                check["transition_distance"], check["reference_distance"], strict=True)],
            "spacings [µm]": [f"{number(a)}, {number(b)}" for a, b in zip(
                check["spacing_um"], check["reference_spacing_um"], strict=True)],
            "verdict": _texts(check["verdict"]),
        },
        "Pairs of the reference at the campaign's numerics. Distance: from the transition, in row "
        "shifts. Shaded: not within two σ<sub>num</sub>, or not to be told.", ["reference_check"],
        ~(check["error_over_sigma"] <= uncertainty.BEYOND),
    ))
    return parts


def _spot_check(campaign: Campaign) -> list[str]:
    check = campaign["spot_check"]
    return [
        f"<p>{text(spot_check.closing_sentence(_records(check)))}</p>",
        campaign.table(
            {
                "outcome": _texts(check["outcome_id"]),
                "mode": [text(m if m == r else f"{m}, check {r}") for m, r in zip(
                    check["mode"], check["check_mode"], strict=True)],
                "θ<sub>m</sub> [°]": _angles(check["migration_angle_deg"]),
                "check [°]": _angles(check["check_angle_deg"]),
                "σ<sub>num</sub> [°]": _angles(check["sigma_num_deg"]),
                "verdict": _texts(check["verdict"]),
            },
            "Outcomes drawn at random, once more with half the spacing, half the numerical "
            f"Reynolds number, {spot_check.ROWS} rows and from other places. Shaded: changed by "
            "more than two σ<sub>num</sub>, or not to be told.", ["spot_check"],
            ~(check["change_over_sigma"] <= uncertainty.BEYOND),
        ),
    ]  # fmt: skip


def _convergence(campaign: Campaign) -> str:
    found = campaign["convergence"]
    return campaign.table(
        {
            "P<sub>r</sub> [µm]": _numbers(found["pillar_radius_um"]),
            "N<sub>p</sub>": _numbers(found["periodicity"]), "cell": _texts(found["stiffness_set"]),
            "knob": _texts(found["knob"]),
            "steps": [", ".join(fixed(v, 3) for v in steps) for steps in found["steps"]],
            "critical gaps [µm]": [", ".join(fixed(v, 2) for v in gaps)
                                   for gaps in found["critical_gaps_um"]],
            "order": _angles(found["observed_order"]),
            "limit [µm]": _angles(found["extrapolated_gap_um"]),
            "campaign − limit [µm]": _angles(found["error_um"]), "note": _texts(found["note"]),
        },
        "Gap at which the bump lane vanishes, one setting changed at a time.", ["convergence"],
    )


def _interval(low, high) -> list[str]:
    return [f"{fixed(a, 2)} to {fixed(b, 2)}" if pd.notna(a) else NOT_MEASURED
            for a, b in zip(low, high, strict=True)]


def _all_outcomes(campaign: Campaign) -> str:
    outcomes = campaign.outcomes.sort_values("outcome_id")
    shares = outcomes[[f"share_{mode}" for mode in ("bump", "mixed", "zigzag")]].to_numpy(float)
    table = campaign.table(
        {
            "outcome": _texts(outcomes["outcome_id"]), "status": _texts(outcomes["status"]),
            "mode": [figures.mode_name(mode) for mode in outcomes["mode"]],
            "θ<sub>m</sub> [°]": [
                fixed(a, 2) + (f" ± {fixed(s, 2)}" if pd.notna(s) else "") for a, s in zip(
                    outcomes["migration_angle_deg"], outcomes["sigma_num_deg"], strict=True)],
            "95 % interval [°]": _interval(outcomes["angle_low_deg"], outcomes["angle_high_deg"]),
            "spread [°]": _angles(outcomes["angle_spread_deg"]),
            "source's protocol [°]": _angles(outcomes["source_angle_deg"]),
            "bump [°]": _angles(outcomes["bump_angle_deg"]),
            "bump, mixed, zigzag [%]": [
                ", ".join(f"{100 * v:.0f}" for v in row) if np.isfinite(row).all()
                else NOT_MEASURED for row in shares],
            "distance from the transition": _angles(outcomes["transition_distance"]),
            "releases": _numbers(outcomes["releases"]), "rows": _numbers(outcomes["rows_total"]),
            "DI": _angles(outcomes["deformation_index"], 3),
            "time [s]": _numbers(outcomes["wall_time_s"], 2),
            "why": _texts(outcomes["stop_reason"]),
        },
        "All outcomes. ± σ<sub>num</sub>; spread: largest minus least angle over the releases; "
        "bump, mixed, zigzag: shares of the flux of cells; distance from the transition: largest "
        "lateral step in row shifts, less one. Shaded: undecided, or without an angle.",
        ["outcomes"], ~figures.settled(outcomes),
    )
    return (f"<details><summary>Table of all {len(outcomes)} outcomes</summary>\n{table}\n"
            "</details>")


def _all_runs(campaign: Campaign) -> str:
    runs = campaign.runs.sort_values("run_id")
    table = campaign.table(
        {
            "run": _texts(runs["run_id"]), "status": _texts(runs["status"]),
            "mode": [figures.mode_name(mode) for mode in runs["mode"]],
            "θ<sub>m</sub> [°]": _angles(runs["migration_angle_deg"]),
            "95 % interval [°]": _interval(runs["angle_low_deg"], runs["angle_high_deg"]),
            "first period [°]": _angles(runs["first_period_angle_deg"]),
            "rows": _numbers(runs["rows_completed"]),
            "orbit [rows]": [number(int(v)) if v else NOT_MEASURED for v in runs["orbit_rows"]],
            "settled from row": [
                NOT_MEASURED if pd.isna(v) else number(int(v)) for v in runs["settled_row"]],
            "largest step [row shifts]": _angles(runs["row_map_peak"]),
            "time [s]": _numbers(runs["wall_time_s"], 2),
            "why it stopped": _texts(runs["stop_reason"]),
        },
        "All runs, each from one place of release (y: gap fraction). Shaded: not settled, or "
        "broken off.", ["runs"], ~figures.settled(runs),
    )
    return f"<details><summary>Table of all {len(runs)} runs</summary>\n{table}\n</details>"


SECTIONS: tuple[tuple[str, str, Callable[[Campaign], str]], ...] = (
    ("summary", "Summary", _summary),
    ("trajectories", "Trajectories", _trajectories),
    ("angles", "Migration angle", _angle_section),
    ("modes", "Migration modes", _mode_section),
    ("calibration", "Calibration of the deformation index", _calibration),
    ("anova", "Analysis of variance", _anova),
    ("robustness", "Robustness map", _robustness),
    ("benchmark", "Regressors", _benchmark),
    ("designs", "Designs", _designs),
    ("flow", "Flow without a cell", _flow),
    ("numerics", "Numerics", _numerics),
    ("validation", "Validation", _validation),
    ("accuracy", "Accuracy", _accuracy),
    ("stability", "Stability", _stability),
    ("outcomes", "All outcomes", _all_outcomes),
    ("runs", "All runs", _all_runs),
)

STYLE = """
:root { --ink: #1d2126; --soft: #5f6368; --line: #d9dce0; --blue: #0b5c92; --paper: #fff; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); line-height: 1.5;
  font: 1.02rem/1.55 Charter, "Bitstream Charter", "Sitka Text", Cambria, Georgia, serif; }
.page { display: grid; grid-template-columns: 14rem minmax(0, 58rem); gap: 3rem; margin: 0 auto;
  max-width: 78rem; padding: 2rem 1.5rem 5rem; }
nav { position: sticky; top: 2rem; align-self: start; font: .86rem/1.5 system-ui, sans-serif; }
nav ol { list-style: none; margin: 0; padding: 0; counter-reset: s; }
nav li { padding: .18rem 0; }
a { color: var(--blue); text-decoration: none; } a:hover { text-decoration: underline; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.4rem; margin: 3.2rem 0 .8rem; padding-top: .6rem;
  border-top: 1px solid var(--line); }
h3 { font-size: 1.08rem; margin: 1.8rem 0 .4rem; }
.lead { color: var(--soft); margin: 0; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(15rem, 1fr)); gap: .8rem;
  margin: 1.2rem 0; font-family: system-ui, sans-serif; }
.cards div { border: 1px solid var(--line); border-radius: .4rem; padding: .7rem .9rem; }
.cards b { display: block; font-size: 1.2rem; font-weight: 600; }
.cards span { color: var(--soft); font-size: .82rem; }
figure { margin: 1.6rem 0 2.2rem; } figure img { display: block; max-width: 100%; height: auto; }
figcaption, caption { font: .86rem/1.45 system-ui, sans-serif; color: #33383e; text-align: left; }
figcaption { margin-top: .6rem; max-width: 52rem; }
caption { padding-bottom: .5rem; }
.source { display: block; color: var(--soft); margin-top: .15rem; }
.table { overflow-x: auto; margin: 1.4rem 0 2rem; }
table { border-collapse: collapse; font: .84rem/1.4 system-ui, sans-serif;
  font-variant-numeric: tabular-nums; border-bottom: 1.5px solid var(--ink); min-width: 60%; }
thead th { border-top: 1.5px solid var(--ink); border-bottom: 1px solid var(--ink);
  text-align: left; vertical-align: bottom; font-weight: 600; padding: .35rem .7rem .35rem 0; }
td { padding: .24rem .9rem .24rem 0; vertical-align: top; border-bottom: 1px solid #eef0f2; }
tr.marked td { background: #f6f3ea; }
small { font-weight: 400; color: var(--soft); }
code { font: .86em ui-monospace, "SFMono-Regular", Menlo, Consolas, monospace;
  background: #f3f4f6; padding: .05em .3em; border-radius: .2em; }
.basis { display: grid; grid-template-columns: 9rem 1fr; gap: .5rem 1rem; margin: .5rem 0 1.5rem; }
.basis dt { font-weight: 600; } .basis dd { margin: 0; }
.absent { border-left: 3px solid var(--line); padding-left: .9rem; color: var(--soft); }
.warning { border-left: 3px solid #d55e00; padding-left: .9rem; }
.notes { font: .84rem/1.45 system-ui, sans-serif; color: #33383e; margin: -1.2rem 0 2rem;
  padding-left: 1.1rem; }
summary { cursor: pointer; color: var(--blue); font-family: system-ui, sans-serif; }
@media (max-width: 60rem) { .page { display: block; } nav { position: static; margin: 1rem 0; } }
@media print {
  @page { margin: 16mm 14mm; }
  body { font-size: 10pt; } .page { display: block; padding: 0; max-width: none; }
  nav { position: static; columns: 2; margin-bottom: 1rem; }
  a { color: inherit; } h2 { break-after: avoid; } h3 { break-after: avoid; }
  figure, tr, .cards { break-inside: avoid; }
  figure img { max-height: 21cm; width: auto; } .table { overflow: visible; }
  table { font-size: 7.6pt; }
}
"""


# --------------------------------------------------------------------------------------------- page


def make_report(results_dir: Path, output: Path, config: dict) -> None:
    """Write the report of a results folder as one self-contained HTML file.

    Figures go to results_dir/figures as PNG and SVG. Optional tables that do not exist are named
    in their section with the rule that makes them. Raises DldsimError when the table of runs is
    missing, that of outcomes is missing or empty, or a table cannot be read.
    """
    results_dir, output = Path(results_dir), Path(output)
    tables = {}
    for kind in SHOWN:
        _, name, rule = TABLES[kind]
        path = results_dir / name
        if path.exists():
            tables[kind] = read_table(kind, path)
        elif kind in REQUIRED:
            raise DldsimError(
                f"The report needs the table of {kind}, and {path} does not exist. "
                f"Make it with: snakemake -j2 {rule}"
            )
    if tables["outcomes"].empty:
        raise DldsimError(
            f"The table of outcomes {results_dir / TABLES['outcomes'].file} has no row, so there "
            "is nothing to report. Check the sweep in config.yaml, then run: snakemake -j2 all"
        )
    campaign = Campaign(results_dir, output, config, tables)
    bodies = [(anchor, title, make(campaign)) for anchor, title, make in SECTIONS]
    contents = "\n".join(f'<li><a href="#{a}">{title}</a></li>' for a, title, _ in bodies)
    sections = "\n".join(
        f'<section id="{a}"><h2>{title}</h2>\n{body}\n</section>' for a, title, body in bodies
    )
    preset = campaign.setting("preset")
    name = f"Campaign “{text(preset)}”" if preset else "Campaign"
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{name}: deformable cells in DLD arrays</title>
<style>{STYLE}</style></head>
<body><div class="page">
<nav aria-label="Contents"><ol>
{contents}
</ol></nav>
<main>
<h1>{name}</h1>
<p class="lead">Deformable cells in deterministic lateral displacement arrays: simulated
trajectories, statistics, surrogate and designs.</p>
{sections}
</main></div></body></html>
"""
    with atomic_path(output) as part:
        part.write_text(page, encoding="utf-8")
