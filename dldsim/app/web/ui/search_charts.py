"""Figures of a search: convergence, importance, trials, contour surfaces.

Figures of the page take rows as the API answers them and compute no physics.
"""

from collections.abc import Iterable, Mapping, Sequence

import plotly.graph_objects as go

from dldsim.app.web.ui.chart_style import BLUE, GREY, PARAMETER, PILLAR, PLAIN, SKY, Row, new_figure

ORDERED = "Cividis"
BINS = 12
"""Colours of the lines in parallel coordinates."""


def value_title(objective: str) -> str:
    """What a value of the objective is, with its unit."""
    if objective == "robust":
        return "robust separation [°]"
    if objective == "purity-recovery":
        return "smallest purity or recovery"
    return "separation |Δθ| [°]"


def convergence(
    best: Sequence[float | None],
    objective: str,
    total: int | None = None,
    trials: Sequence[Row] = (),
) -> go.Figure:
    """Best value after each trial, and the trials if they are known.

    A negative robust value is the share of the draws' range by which the order of the two cell
    types is open, not an angle.
    """
    figure = new_figure(300, xaxis_title="trial", yaxis_title=value_title(objective))
    good = [t for t in trials if t["feasible"] and t["value"] is not None]
    if good:
        figure.add_scatter(
            x=[t["trial"] + 1 for t in good],
            y=[t["value"] for t in good],
            mode="markers",
            name="feasible trial",
            marker={"color": SKY, "size": 6},
            customdata=[[t["pillar_radius_um"], t["gap_um"], t["periodicity"]] for t in good],
            hovertemplate="trial %{x}: %{y:.3g}<br>P_r %{customdata[0]:.2f} µm, P_g "
            "%{customdata[1]:.2f} µm, N_p %{customdata[2]}<extra></extra>",
        )
    figure.add_scatter(
        x=list(range(1, len(best) + 1)),
        y=list(best),
        mode="lines",
        name="best so far",
        line={"color": BLUE, "width": 2.5, "shape": "hv"},
        hovertemplate="after trial %{x}: %{y:.3g}<extra></extra>",
    )
    known = [v for v in best if v is not None]
    if objective == "robust" and known and min(known) < 0:
        figure.add_hline(y=0, line={"color": GREY, "width": 1, "dash": "dot"})
    if total:
        figure.update_xaxes(range=[0, total + 1])
    figure.update_layout(showlegend=bool(good))
    return figure


def importance(rows: Sequence[Row]) -> go.Figure:
    """Bars, largest on top."""
    known = sorted((r for r in rows if r["importance"] is not None), key=lambda r: r["importance"])
    figure = new_figure(
        110 + 40 * len(known), xaxis_title="share of the importance", xaxis_range=[0, 1.08]
    )
    figure.add_bar(
        x=[r["importance"] for r in known],
        y=[PLAIN.get(r["parameter"], r["parameter"]) for r in known],
        orientation="h",
        marker_color=SKY,
        marker_line={"color": BLUE, "width": 1},
        text=[f"{r['importance']:.2f}" for r in known],
        textposition="outside",
        cliponaxis=False,
        hovertemplate="%{y}: %{x:.3f}<extra></extra>",
    )
    return figure


def parallel(trials: Sequence[Row], objective: str, best: int | None = None) -> go.Figure:
    """Feasible trials as lines over P_r, P_g, N_p, separation and value, coloured by the value.

    Drawn without WebGL, so that every browser shows it.
    """
    axes = {**PARAMETER, "separation_deg": "|Δθ| [°]", "value": value_title(objective)}
    if objective != "robust":
        del axes["value"]
    key = list(axes)[-1]
    good = sorted((t for t in trials if t["feasible"] and t[key] is not None), key=lambda t: t[key])
    figure = new_figure(
        380,
        xaxis={"visible": False, "range": [-0.25, len(axes) - 0.75]},
        yaxis={"visible": False, "range": [-0.08, 1.2]},
        showlegend=False,
        margin={"l": 10, "r": 10, "t": 10, "b": 10},
    )
    if not good:
        return figure
    ends = {n: (min(t[n] for t in good), max(t[n] for t in good)) for n in axes}

    def scaled(name: str, value: float) -> float:
        low, high = ends[name]
        return (value - low) / (high - low) if high > low else 0.5

    colours = _sampled(ORDERED, BINS)
    bins: list[list[Row]] = [[] for _ in range(BINS)]
    for trial in good:
        bins[min(int(scaled(key, trial[key]) * BINS), BINS - 1)].append(trial)
    for colour, part in zip(colours, bins, strict=True):
        if part:
            x, y, text = _lines(part, axes, scaled)
            figure.add_scatter(
                x=x,
                y=y,
                text=text,
                mode="lines",
                opacity=0.75,
                line={"color": colour, "width": 1.3},
                hoverinfo="text",
            )
    chosen = next((t for t in good if t["trial"] == best), None)
    if chosen is not None:
        x, y, text = _lines([chosen], axes, scaled)
        figure.add_scatter(
            x=x, y=y, text=text, mode="lines", hoverinfo="text", line={"color": "black", "width": 3}
        )
    for place, (name, title) in enumerate(axes.items()):
        figure.add_annotation(
            x=place,
            y=1,
            showarrow=False,
            yshift=24,
            yanchor="bottom",
            text=f"<b>{title.replace('separation [', 'separation<br>[')}</b>",
        )
        figure.add_shape(
            type="line",
            x0=place,
            x1=place,
            y0=0,
            y1=1,
            layer="below",
            line={"color": "#444444", "width": 1},
        )
        for at, value in zip((0, 1), ends[name], strict=True):
            figure.add_annotation(
                x=place,
                y=at,
                text=f"{value:.3g}",
                showarrow=False,
                yshift=-11 if at == 0 else 10,
                font_size=12,
                bgcolor="rgba(255,255,255,0.8)",
            )
    return figure


def _lines(trials: Iterable[Row], axes: Mapping[str, str], scaled) -> tuple[list, list, list]:
    x: list[float | None] = []
    y: list[float | None] = []
    text: list[str] = []
    for trial in trials:
        words = (
            f"trial {trial['trial'] + 1}<br>P_r {trial['pillar_radius_um']:.2f} µm, "
            f"P_g {trial['gap_um']:.2f} µm, N_p {trial['periodicity']}<br>"
            f"|Δθ| {trial['separation_deg']:.2f}°, objective {trial['value']:.3g}"
        )
        x += [*range(len(axes)), None]
        y += [*(scaled(name, trial[name]) for name in axes), None]
        text += [words] * (len(axes) + 1)
    return x, y, text


def _sampled(scale: str, count: int) -> list[str]:
    from plotly.colors import sample_colorscale

    return sample_colorscale(scale, [i / (count - 1) for i in range(count)])


def surface(slices: Sequence[Row], x: str, y: str, designs: Sequence[Row]) -> go.Figure:
    """Predicted angle 2 − angle 1 over two parameters, the third as in the best candidate.

    Hatched: extrapolated; grey: against a constraint. Candidates carry their number; one whose
    third parameter differs from that of the best is drawn hollow.
    """
    part = [r for r in slices if {r["x_parameter"], r["y_parameter"]} == {x, y}]
    points = {}
    for r in part:
        at = (r["x"], r["y"]) if r["x_parameter"] == x else (r["y"], r["x"])
        points[at] = r
    xs, ys = (sorted({at[i] for at in points}) for i in (0, 1))
    most = max((abs(r["difference_deg"]) for r in part), default=1.0) or 1.0

    def grid(value) -> list[list]:
        return [[value(points[a, b]) if (a, b) in points else None for a in xs] for b in ys]

    figure = new_figure(490, xaxis_title=PARAMETER[x], yaxis_title=PARAMETER[y], margin_t=50)
    hover = (
        f"{PARAMETER[x]} %{{x:.4g}}<br>{PARAMETER[y]} %{{y:.4g}}<br>"
        "θ₂ − θ₁ %{z:.2f}°<br>%{text}<extra></extra>"
    )
    about = grid(
        lambda r: (
            "against a constraint"
            if not r["feasible"]
            else "inside the training domain"
            if r["inside_training_domain"]
            else "extrapolated"
        )
    )
    values = grid(lambda r: r["difference_deg"])
    figure.add_heatmap(
        x=xs,
        y=ys,
        z=values,
        colorscale="PuOr",
        zmin=-most,
        zmax=most,
        text=about,
        colorbar={"title": {"text": "θ₂ − θ₁ [°]", "side": "right"}},
        hovertemplate=hover,
    )
    figure.add_heatmap(
        x=xs,
        y=ys,
        z=grid(lambda r: None if r["feasible"] else 1),
        hoverinfo="skip",
        showscale=False,
        colorscale=[[0, PILLAR], [1, PILLAR]],
    )
    if "periodicity" not in (x, y):  # there is nothing between whole rows
        figure.add_contour(
            x=xs,
            y=ys,
            z=values,
            showscale=False,
            hoverinfo="skip",
            ncontours=14,
            contours_coloring="none",
            showlegend=False,
            line={"width": 0.8, "color": "#444444"},
        )
    hatched = [
        at
        for i, a in enumerate(xs)
        for j, b in enumerate(ys)
        if (i + j) % 2 == 0
        and (at := (a, b)) in points
        and points[at]["feasible"]
        and not points[at]["inside_training_domain"]
    ]
    if hatched:
        figure.add_scatter(
            x=[a for a, _ in hatched],
            y=[b for _, b in hatched],
            mode="markers",
            name="extrapolated",
            hoverinfo="skip",
            marker={"symbol": "line-ne", "size": 8, "line": {"width": 1, "color": "#444444"}},
        )
    if not designs:
        return figure
    [third] = [name for name in PARAMETER if name not in (x, y)]
    for hollow in (False, True):
        shown = [d for d in designs if (d[third] != designs[0][third]) == hollow]
        if shown:
            figure.add_scatter(
                x=[d[x] for d in shown],
                y=[d[y] for d in shown],
                mode="markers",
                text=[str(d["design"]) for d in shown],
                marker={
                    "symbol": "star-open" if hollow else "star",
                    "size": 13,
                    "color": "black",
                    "line": {"width": 1.2, "color": "black"},
                },
                name="candidate" + (f" with another {PLAIN[third]}" if hollow else ""),
                hovertemplate="candidate %{text}<extra></extra>",
            )
    for d in designs:
        figure.add_annotation(
            x=d[x],
            y=d[y],
            text=str(d["design"]),
            showarrow=False,
            xshift=11,
            yshift=12,
            borderpad=1,
            bgcolor="rgba(255,255,255,0.8)",
        )
    return figure
