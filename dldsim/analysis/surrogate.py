"""The surrogate of the migration angle: fitted model, intervals, domain, file and card.

A :class:`dldsim.analysis.regressors.BoundedXGBoost` on all outcomes. Prediction intervals are
conformal, with geometries (not outcomes) as the units that are exchangeable; their coverage is
measured on geometries held out. The card says what the model was learnt from, what it scores, and
where it holds.
"""

import copy
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from dldsim import PHYSICS_VERSION, __version__
from dldsim.analysis.regressors import (
    ANGLE,
    BASELINE,
    CONDITIONS,
    FEATURES,
    FOLDS,
    INPUTS,
    SURROGATE,
    CriticalDiameterRule,
    TwoLimitCurve,
    angle_of,
    bounded_share,
    features,
    folds_of,
    groups_of,
    inputs_and_angles,
    learnable,
    make_regressors,
    pooled,
    share_of,
    tune,
)
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.files import atomic_path
from dldsim.vocabulary import DECIDED, GEOMETRY

if TYPE_CHECKING:
    from xgboost import Booster

KIND = "dldsim surrogate of the migration angle"
DOMAIN_TOLERANCE = 0.02
"""How far outside the training geometries still counts as inside, in units of their range."""
LEVELS = (0.68, 0.9)
"""Levels at which the coverage of the intervals is measured."""
LEVEL = 0.9
SPREAD_FLOOR = 0.01
"""Least variance of a share in the scores: near the limits errors are small, but not zero."""
TARGET = {"r2": 0.95, "median_absolute_error_deg": 0.3}
"""What a designer would like on geometries never seen."""


# ------------------------------------------------------------------------------ conformal intervals


def spread_of(share) -> np.ndarray:
    """Scale of the error of a predicted share s: √(s (1 − s) + floor), largest half way."""
    share = np.clip(share, 0, 1)
    return np.sqrt(share * (1 - share) + SPREAD_FLOOR)


def conformal_factor(scores: list[list[float]], level: float) -> float:
    """Smallest q so that a share level of scores of a new geometry is below q; inf if too few.

    `scores` holds those of each geometry. Every geometry has equal weight, and one more of unknown,
    infinite score stands for the new one (hierarchical conformal prediction, Lee, Barber & Willett,
    arXiv:2306.06342, eq. 4).
    """
    values = np.concatenate([np.asarray(s, float) for s in scores])
    weights = np.concatenate([np.full(len(s), 1 / len(s)) for s in scores]) / (len(scores) + 1)
    order = np.argsort(values)
    reached = np.flatnonzero(np.cumsum(weights[order]) >= level - 1e-12)
    return float(values[order][reached[0]]) if reached.size else float("inf")


def _scores(predicted: np.ndarray, observed: np.ndarray, groups: np.ndarray) -> list[list[float]]:
    """Error of shares over its scale, by group."""
    score = np.abs(observed - predicted) / spread_of(predicted)
    return [score[groups == g].tolist() for g in np.unique(groups)]


@dataclass
class Surrogate:
    """The regressor that designs are searched on, with the card that says what it is."""

    booster: "Booster"
    card: dict[str, Any]

    def share(self, pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um):
        """Share of the bump displacement, 0 (zigzag) to 1 (bump), (n,); arguments broadcast."""
        x = features(pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um)
        return bounded_share(self.booster, TwoLimitCurve.from_state(self.card["curve"]), x)

    def predict(self, pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um):
        """Migration angles [deg], shape (n,); the arguments are broadcast to one length."""
        at = pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um
        share = self.share(*at)
        return angle_of(share, np.broadcast_to(np.atleast_1d(periodicity), share.shape))

    def predict_interval(
        self,
        pillar_radius_um,
        gap_um,
        periodicity,
        deformation_index,
        cell_radius_um,
        level: float = LEVEL,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper angle [deg], (n,) each, that hold a new geometry's angle so often.

        Conformal, see the module. Where there are too few geometries for the level, and outside
        the domain (see `inside_domain`), nothing was learnt about errors: the interval is then the
        whole range from the least to the largest share of the bump displacement ever simulated.
        """
        if not 0 < level < 1:
            raise DldsimError(f"Surrogate: level of an interval must be between 0 and 1: {level}.")
        at = pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um
        share = self.share(*at)
        rows = np.broadcast_to(np.atleast_1d(periodicity), share.shape)
        least, largest = self.card["conformal"]["range"]
        reach = conformal_factor(self.card["conformal"]["scores"], level) * spread_of(share)
        reach = np.where(self.inside_domain(*at), reach, np.inf)
        return (
            angle_of(np.clip(share - reach, least, largest), rows),
            angle_of(np.clip(share + reach, least, largest), rows),
        )

    def inside_domain(
        self, pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um
    ) -> np.ndarray:
        """Whether the surrogate interpolates, (n,): by DI range and hull of the geometries."""
        radius, gap, rows, index, cell = np.broadcast_arrays(
            *map(
                np.atleast_1d,
                (pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um),
            )
        )
        low, high = self.deformation_index_range
        slack = DOMAIN_TOLERANCE * (high - low)
        inside = (index >= low - slack) & (index <= high + slack)
        points = np.column_stack([radius / cell, gap / cell, rows])
        unique, where = np.unique(points, axis=0, return_inverse=True)
        known = np.zeros(len(unique), bool)
        surely = self._surely_inside(unique)
        for i in np.flatnonzero(self.may_be_inside(*unique.T, 1.0)):
            known[i] = surely[i] or self.distance_outside(*unique[i], 1.0) <= DOMAIN_TOLERANCE
        return inside & known[where.ravel()]

    @cached_property
    def _half_spaces(self) -> np.ndarray | None:
        """Facets (n, 4) of the hull of the training geometries: outward normal and offset.

        In units of the training ranges; None where the geometries lie in a plane or a line.
        """
        from scipy.spatial import ConvexHull

        known = np.array(self.card["domain"]["geometries"])
        span = np.ptp(known, axis=0)
        spread = (known - known.mean(axis=0)) / np.where(span > 0, span, 1)
        if len(known) < 5 or np.linalg.matrix_rank(spread, tol=1e-9) < 3:
            return None
        return np.unique(ConvexHull(known / span).equations.round(12), axis=0)

    def _surely_inside(self, points: np.ndarray) -> np.ndarray:
        """True where the half-spaces of the hull all hold a point (P_r/R, P_g/R, N_p), (n,).

        All False where the training geometries have no volume; `distance_outside` then decides.
        """
        if self._half_spaces is None:
            return np.zeros(len(points), bool)
        span = np.ptp(np.array(self.card["domain"]["geometries"]), axis=0)
        beyond = points / span @ self._half_spaces[:, :3].T + self._half_spaces[:, 3]
        return (beyond <= 1e-9).all(axis=1)

    @property
    def holds_for(self) -> str:
        """Shape of the cell, height and velocity that predictions hold for, in words."""
        return holds_for(self.card["data"]["conditions"])

    @property
    def deformation_index_range(self) -> tuple[float, float]:
        """Least and largest deformation index of the training data."""
        return tuple(self.card["domain"]["ranges"]["deformation_index"])

    @property
    def rmse_deg(self) -> float:
        """Root mean squared error [deg] on geometries never seen (cross-validated)."""
        return self.card["scores_by_geometry"]["rmse_deg"]

    def sigma_num_deg(self, angle_deg, periodicity) -> np.ndarray | None:
        """Numerical uncertainty [deg] of predicted angles; None if none learnt from has one.

        That of the outcomes learnt from in the same mode (bump, mixed or zigzag, by angle), as a
        share of the bump angle; of a mode without outcomes, the largest share of any mode.
        """
        shares = self.card["numerical_uncertainty"]["share_by_mode"]
        if not shares:
            return None
        angles, rows = np.broadcast_arrays(np.atleast_1d(angle_deg), np.atleast_1d(periodicity))
        share = [
            shares.get(mode_of(a, 1 / n), max(shares.values()))
            for a, n in zip(angles, rows, strict=True)
        ]
        return np.array(share) * np.degrees(np.arctan(1 / rows))

    def may_be_inside(self, pillar_radius_um, gap_um, periodicity, cell_radius_um) -> np.ndarray:
        """False where `distance_outside` surely exceeds DOMAIN_TOLERANCE, (n,); quick.

        By the ranges of the training geometries, and by the plane or line that they may lie in.
        """
        known = np.array(self.card["domain"]["geometries"])
        points = np.column_stack(
            [
                np.asarray(pillar_radius_um) / cell_radius_um,
                np.asarray(gap_um) / cell_radius_um,
                periodicity,
            ]
        )
        span = np.ptp(known, axis=0)
        span[span < 1e-9 * np.abs(known).max(axis=0)] = 1e-6
        off = (points - known.mean(axis=0)) / span
        spread = (known - known.mean(axis=0)) / span
        _, sizes, axes = np.linalg.svd(spread, full_matrices=True)
        flat = axes[np.append(sizes, np.zeros(3 - len(sizes))) < 1e-9]
        reach = (DOMAIN_TOLERANCE + 1e-9) * np.abs(flat).sum(axis=1)
        return (
            (off >= spread.min(axis=0) - DOMAIN_TOLERANCE - 1e-9)
            & (off <= spread.max(axis=0) + DOMAIN_TOLERANCE + 1e-9)
        ).all(axis=1) & (np.abs(off @ flat.T) <= reach).all(axis=1)

    def distance_outside(
        self, pillar_radius_um: float, gap_um: float, periodicity: int, cell_radius_um: float
    ) -> float:
        """How far a geometry lies outside the convex hull of the training geometries.

        In units of the training range of (P_r/R, P_g/R, N_p), largest component; 0 inside. The hull
        tells what ranges do not: outcomes with gap = radius + 10 µm fill a plane, not a box. A
        parameter that never varied allows no distance at all: then infinity.
        """
        from scipy.optimize import linprog

        known = np.array(self.card["domain"]["geometries"])
        point = np.array([pillar_radius_um / cell_radius_um, gap_um / cell_radius_um, periodicity])
        span = np.ptp(known, axis=0)
        fixed = span < 1e-9 * np.abs(known).max(axis=0)
        if np.any(np.abs(point - known[0])[fixed] > 1e-6 * np.abs(known[0])[fixed]):
            return np.inf
        scaled = ((known - point)[:, ~fixed] / span[~fixed]).T
        if scaled.size == 0 or self._surely_inside(point[None])[0]:
            return 0.0
        # least t with |Σ w_i (known_i − point)| ≤ t, w ≥ 0, Σ w = 1
        column = np.full((len(scaled), 1), -1.0)
        found = linprog(
            np.r_[np.zeros(len(known)), 1],
            A_ub=np.vstack([np.hstack([scaled, column]), np.hstack([-scaled, column])]),
            b_ub=np.zeros(2 * len(scaled)),
            A_eq=np.r_[np.ones(len(known)), 0][None],
            b_eq=[1.0],
        )
        return max(0.0, float(found.fun))

    def save(self, path: Path, card_path: Path) -> None:
        """Write the model in XGBoost's own JSON format and its card, each whole or not at all."""
        card = {key: value for key, value in self.card.items() if key != "model_sha256"}
        self.booster.set_attr(card_sha256=_card_hash(card))
        model = bytes(self.booster.save_raw("json"))
        card["model_sha256"] = hashlib.sha256(model).hexdigest()
        text = json.dumps(card, indent=1, allow_nan=False).encode()
        for target, content in ((path, model), (card_path, text)):
            with atomic_path(target) as part:
                part.write_bytes(content)


SHAPES = {"biconcave": "biconcave discs", "sphere": "spheres", "ellipsoid": "ellipsoids"}


def holds_for(conditions: Mapping[str, Any]) -> str:
    """Conditions that outcomes were made under, of CONDITIONS, in words."""
    shape = SHAPES.get(conditions.get("cell_shape"), "cells of one shape")
    known = [
        text
        for name, text in (
            ("height_um", "channel height {:g} µm"),
            ("mean_velocity_mm_s", "mean velocity {:g} mm/s"),
        )
        if name in conditions
        for text in [text.format(conditions[name])]
    ]
    return ", ".join([f"{shape} of the radii named", *known])


def fit(outcomes: pd.DataFrame, seed: int) -> Surrogate:
    """Fit the surrogate to all usable outcomes; its card holds its error on geometries held out.

    Raises DldsimError for missing columns or too few usable outcomes.
    """
    import xgboost

    data = learnable(outcomes)
    x, y = inputs_and_angles(data)
    groups, rows = groups_of(data, "geometry"), data["periodicity"].to_numpy(float)
    share = share_of(y, rows)
    prototype, grid = make_regressors(seed)[SURROGATE]
    held_out = np.empty_like(y)
    covered: dict[float, list] = {level: [] for level in LEVELS}
    for train, test in folds_of(groups, FOLDS, seed):
        chosen, inner = tune(prototype, grid, x[train], y[train], groups[train], seed)
        held_out[test] = chosen.fit(x[train], y[train]).predict(x[test])
        known = _scores(share_of(inner, rows[train]), share[train], groups[train])
        predicted = share_of(held_out[test], rows[test])
        for level in LEVELS:
            reach = conformal_factor(known, level) * spread_of(predicted)
            covered[level].append(
                pd.DataFrame(
                    {
                        "inside": np.abs(share[test] - predicted) <= reach,
                        "geometry": groups[test],
                        "half_width": np.minimum(reach, 1) * np.degrees(np.arctan(1 / rows[test])),
                    }
                )
            )
    chosen, _ = tune(prototype, grid, x, y, groups, seed)
    model = copy.deepcopy(chosen).fit(x, y)
    booster = model.booster
    booster.feature_names = FEATURES
    frame = pd.DataFrame({"observed_deg": y, "predicted_deg": held_out})
    scores = pooled(frame)
    rule = pooled(frame.assign(predicted_deg=CriticalDiameterRule().predict(x)))
    ratios = np.column_stack(
        [
            data["pillar_radius_um"] / data["cell_radius_um"],
            data["gap_um"] / data["cell_radius_um"],
            rows,
        ]
    )
    card = {
        "kind": KIND,
        "response": "share of the bump displacement tan(migration angle) N_p",
        "features": FEATURES,
        "seed": int(seed),
        "curve": model.curve.state(),
        "settings": {"penalty": model.penalty, "trees": model.trees, "depth": model.depth},
        "data": {
            "sha256": _data_hash(data),
            "outcomes": len(outcomes),
            "used": len(data),
            "undecided": int((~data["status"].isin([*DECIDED, "measured"])).sum()),
            "geometries": int(data.groupby(GEOMETRY).ngroups),
            "conditions": {n: _plain(data[n].iloc[0]) for n in CONDITIONS if n in data},
        },
        "scores_by_geometry": scores,
        "baseline_by_geometry": {"model": BASELINE} | rule,
        "target_by_geometry": TARGET
        | {
            "reached": bool(
                (scores["r2"] or 0) >= TARGET["r2"]
                and scores["median_absolute_error_deg"] <= TARGET["median_absolute_error_deg"]
            )
        },
        "conformal": {
            "scores": _scores(share_of(held_out, rows), share, groups),
            "range": [float(min(share.min(), 0)), float(max(share.max(), 1))],
            "measured": [_coverage(level, pd.concat(parts)) for level, parts in covered.items()],
        },
        "numerical_uncertainty": _numerical_uncertainty(data),
        "domain": {
            "ranges": {
                name: [float(c.min()), float(c.max())]
                for name, c in zip(FEATURES, x.T, strict=True)
            },
            "geometries": np.unique(ratios, axis=0).tolist(),
        },
        "versions": {
            "dldsim": __version__,
            "physics": PHYSICS_VERSION,
            "xgboost": xgboost.__version__,
            "numpy": np.__version__,
        },
    }
    return Surrogate(_serial(booster), card)


def _coverage(level: float, found: pd.DataFrame) -> dict[str, float | int]:
    """Share of outcomes of held-out geometries inside their intervals, each geometry counting once.

    The error of the share is that of a mean over geometries.
    """
    by_geometry = found.groupby("geometry")["inside"].mean()
    return {
        "level": level,
        "coverage": float(by_geometry.mean()),
        "coverage_error": float(by_geometry.sem()) if len(by_geometry) > 1 else 1.0,
        "geometries": len(by_geometry),
        "mean_half_width_deg": float(found["half_width"].mean()),
    }


def _numerical_uncertainty(data: pd.DataFrame) -> dict[str, Any]:
    """Root mean square of σ_num / bump angle of what was learnt from, by mode after its angle."""
    if "sigma_num_deg" not in data or data["sigma_num_deg"].isna().all():
        kinds = sorted(data["sigma_num_kind"].unique()) if "sigma_num_kind" in data else []
        return {"share_by_mode": {}, "outcomes": 0, "basis": kinds}
    known = data[data["sigma_num_deg"].notna()]
    mode = [mode_of(a, 1 / n) for a, n in zip(known[ANGLE], known["periodicity"], strict=True)]
    square = (known["sigma_num_deg"] / np.degrees(np.arctan(1 / known["periodicity"]))) ** 2
    shares = np.sqrt(square.groupby(np.array(mode)).mean())
    return {
        "share_by_mode": shares.to_dict(),
        "outcomes": len(known),
        "basis": sorted(known["sigma_num_kind"].unique()),
    }


def _serial(booster: "Booster") -> "Booster":
    booster.set_param({"nthread": 1})
    return booster


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value


def _data_hash(data: pd.DataFrame) -> str:
    """SHA-256 over the rows learnt from: inputs, angle and status, in order of outcome_id."""
    rows = data[["outcome_id", *INPUTS, ANGLE, "status"]]
    text = rows.astype(dict.fromkeys([*INPUTS, ANGLE], float)).to_csv(index=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _card_hash(card: dict[str, Any]) -> str:
    """SHA-256 of a card without the hash of its model; the model file keeps it."""
    content = {key: value for key, value in card.items() if key != "model_sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def load(path: Path, card_path: Path) -> Surrogate:
    """Read a surrogate and check that the card belongs to the model.

    Raises DldsimError if a file is absent, damaged, of another kind, physics version or set of
    features, or if card and model do not match.
    """
    import xgboost

    path, card_path = Path(path), Path(card_path)
    remedy = "Fit it anew: `snakemake -j2 surrogate`."
    for file in (path, card_path):
        if not file.is_file():
            raise DldsimError(f"{file} does not exist. {remedy}")
    try:
        card = json.loads(card_path.read_text())
        kind, digest, physics = card["kind"], card["model_sha256"], card["versions"]["physics"]
    except (ValueError, KeyError, TypeError) as error:
        raise DldsimError(f"{card_path} is no card of a surrogate: {error!r}. {remedy}") from error
    if kind != KIND or card.get("features") != FEATURES:
        raise DldsimError(f"{card_path} describes another model or other features. {remedy}")
    if physics != PHYSICS_VERSION:
        raise DldsimError(
            f"{card_path}: learnt from physics version {physics}, this is {PHYSICS_VERSION}. "
            f"{remedy}"
        )
    model = path.read_bytes()
    if hashlib.sha256(model).hexdigest() != digest:
        raise DldsimError(f"{path} is not the model that {card_path} describes. {remedy}")
    booster = xgboost.Booster()
    try:
        booster.load_model(bytearray(model))
    except xgboost.core.XGBoostError as error:
        raise DldsimError(f"{path} is no XGBoost model: {error}. {remedy}") from error
    if booster.attr("card_sha256") != _card_hash(card):
        raise DldsimError(f"{card_path} was changed after {path} was written. {remedy}")
    return Surrogate(_serial(booster), card)
