"""The surrogate of the migration angle: fitted model, intervals, domain, file and card.

A :class:`dldsim.analysis.regressors.BoundedXGBoost` on all outcomes of a campaign, and of the
survey where that is learnt from. Prediction intervals are conformal, shape by shape, with
geometries (not outcomes) as the units that are exchangeable; their coverage is measured on
geometries held out. The card says what the model was learnt from, what it scores, and where it
holds.
"""

import copy
import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from dldsim import PHYSICS_VERSION, __version__
from dldsim.analysis import domain
from dldsim.analysis.benchmark import FOLDS, folds_of, groups_of, pooled, tune
from dldsim.analysis.conformal import factors_of, reach_of, scores_of
from dldsim.analysis.features import (
    ANGLE,
    FEATURES,
    INPUTS,
    SHAPES,
    CellInFlow,
    angle_of,
    features,
    inputs_and_angles,
    learnable,
    share_of,
)
from dldsim.analysis.learning import SURVEY_SOURCE, with_survey
from dldsim.analysis.regressors import (
    BASELINE,
    SURROGATE,
    CriticalDiameterRule,
    TwoLimitCurve,
    bounded_share,
    make_regressors,
)
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.files import atomic_path
from dldsim.laws import SCATTER_OF_DAVIS, critical_diameter
from dldsim.vocabulary import DECIDED, GEOMETRY

if TYPE_CHECKING:
    from xgboost import Booster

KIND = "dldsim surrogate of the migration angle"
LEVELS = (0.68, 0.9)
"""Levels at which the coverage of the intervals is measured."""
LEVEL = 0.9
TARGET = {"r2": 0.95, "median_absolute_error_deg": 0.3}
"""What a designer would like on geometries never seen."""
BEAD = "sphere"
"""The shape whose stiff limit is a bead."""
BEAD_ROWS = (4, 5, 6, 8, 12)
"""Periodicities at which beads are held against the law of the critical diameter."""
BEAD_STEPS = 200


@dataclass
class Surrogate:
    """The regressor that designs are searched on, with the card that says what it is."""

    booster: "Booster"
    card: dict[str, Any]

    @cached_property
    def _factors(self) -> dict[float, dict[str, float]]:
        """Conformal factors by level and shape, as they are asked for."""
        return {}

    @cached_property
    def _curve(self) -> TwoLimitCurve:
        return TwoLimitCurve.from_state(self.card["curve"])

    @cached_property
    def domains(self) -> dict[str, domain.Domain]:
        """What was learnt of each shape."""
        return domain.from_state(self.card["domain"])

    def share(self, pillar_radius_um, gap_um, periodicity, cell: CellInFlow) -> np.ndarray:
        """Share of the bump displacement, 0 (zigzag) to 1 (bump), (n,); arguments broadcast."""
        x = features(pillar_radius_um, gap_um, periodicity, cell)
        return bounded_share(self.booster, self._curve, x)

    def predict(self, pillar_radius_um, gap_um, periodicity, cell: CellInFlow) -> np.ndarray:
        """Migration angles [deg], shape (n,); the arguments are broadcast to one length."""
        share = self.share(pillar_radius_um, gap_um, periodicity, cell)
        return angle_of(share, np.broadcast_to(np.atleast_1d(periodicity), share.shape))

    def predict_interval(
        self, pillar_radius_um, gap_um, periodicity, cell: CellInFlow, level: float = LEVEL
    ) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper angle [deg], (n,) each, that hold a new geometry's angle so often.

        Conformal, see the module. Where there are too few geometries for the level, and outside
        the domain (see `inside_domain`), nothing was learnt about errors: the interval is then the
        whole range from the least to the largest share of the bump displacement ever simulated.
        """
        if not 0 < level < 1:
            raise DldsimError(f"Surrogate: level of an interval must be between 0 and 1: {level}.")
        at = pillar_radius_um, gap_um, periodicity, cell
        share = self.share(*at)
        rows = np.broadcast_to(np.atleast_1d(periodicity), share.shape)
        shape = np.broadcast_to(np.atleast_1d(np.asarray(cell.shape, str)), share.shape)
        least, largest = self.card["conformal"]["range"]
        if level not in self._factors:
            self._factors[level] = factors_of(self.card["conformal"]["scores"], level)
        reach = reach_of(self._factors[level], shape, share)
        reach = np.where(self.inside_domain(*at), reach, np.inf)
        return (
            angle_of(np.clip(share - reach, least, largest), rows),
            angle_of(np.clip(share + reach, least, largest), rows),
        )

    def inside_domain(self, pillar_radius_um, gap_um, periodicity, cell: CellInFlow) -> np.ndarray:
        """Whether the surrogate interpolates, (n,): by shape, arrays, Ca and channel height."""
        near = self.distance_outside(pillar_radius_um, gap_um, periodicity, cell)
        shape = np.atleast_1d(np.asarray(cell.shape, str))
        held = np.zeros(np.broadcast(near, shape, np.atleast_1d(cell.capillary_number)).shape, bool)
        for name, own in self.domains.items():
            held |= (shape == name) & own.holds(cell)
        return held & (near <= domain.DOMAIN_TOLERANCE)

    def distance_outside(
        self, pillar_radius_um, gap_um, periodicity, cell: CellInFlow
    ) -> np.ndarray:
        """How far arrays lie outside those learnt from for this shape, (n,); see `Domain`.

        Infinite for a shape that was not learnt.
        """
        shape = np.atleast_1d(np.asarray(cell.shape, str))
        place = np.broadcast(*map(np.atleast_1d, (pillar_radius_um, gap_um, periodicity)), shape)
        found = np.full(place.shape, np.inf)
        for name, own in self.domains.items():
            if (shape == name).any():
                beyond = own.distance_outside(pillar_radius_um, gap_um, periodicity, cell)
                found = np.where(shape == name, beyond, found)
        return found

    @property
    def holds_for(self) -> str:
        """Shapes, capillary numbers and channel heights that predictions hold for, in words."""
        return domain.learnt(self.card["domain"])

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


def fit(outcomes: pd.DataFrame, seed: int, survey: pd.DataFrame | None = None) -> Surrogate:
    """Fit the surrogate to all usable outcomes; its card holds its error on geometries held out.

    Raises DldsimError for missing columns, too few usable outcomes, or a survey of other numerics.
    """
    import xgboost

    everything = with_survey(outcomes, survey)
    data = learnable(everything)
    x, y = inputs_and_angles(data)
    groups, rows = groups_of(data, "geometry"), data["periodicity"].to_numpy(float)
    shape, share = data["cell_shape"].to_numpy(str), share_of(y, rows)
    prototype, grid, _ = make_regressors(seed)[SURROGATE]
    held_out = np.empty_like(y)
    covered = []
    for train, test in folds_of(groups, FOLDS, seed):
        chosen, inner = tune(prototype, grid, x[train], y[train], groups[train], seed)
        held_out[test] = chosen.fit(x[train], y[train]).predict(x[test])
        known = scores_of(share_of(inner, rows[train]), share[train], groups[train], shape[train])
        predicted = share_of(held_out[test], rows[test])
        for level in LEVELS:
            reach = reach_of(factors_of(known, level), shape[test], predicted)
            covered.append(
                pd.DataFrame(
                    {
                        "level": level,
                        "shape": shape[test],
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
    card = {
        "kind": KIND,
        "response": "share of the bump displacement tan(migration angle) N_p",
        "features": FEATURES,
        "shapes": list(SHAPES),
        "seed": int(seed),
        "curve": model.curve.state(),
        "settings": {"penalty": model.penalty, "trees": model.trees, "depth": model.depth},
        "data": {
            "sha256": _data_hash(data),
            "outcomes": len(everything),
            "used": len(data),
            "undecided": int((~data["status"].isin([*DECIDED, "measured"])).sum()),
            "geometries": int(data.groupby(GEOMETRY).ngroups),
            "survey": None if survey is None else int((data["source"] == SURVEY_SOURCE).sum()),
        },
        "scores_by_geometry": scores,
        "scores_by_shape": {
            name: pooled(frame[shape == name]) for name in np.unique(shape).tolist()
        },
        "baseline_by_geometry": {"model": BASELINE} | rule,
        "target_by_geometry": TARGET
        | {
            "reached": bool(
                (scores["r2"] or 0) >= TARGET["r2"]
                and scores["median_absolute_error_deg"] <= TARGET["median_absolute_error_deg"]
            )
        },
        "conformal": {
            "scores": scores_of(share_of(held_out, rows), share, groups, shape),
            "range": [float(min(share.min(), 0)), float(max(share.max(), 1))],
            "measured": [
                _coverage(level, name, part)
                for (name, level), part in pd.concat(covered).groupby(["shape", "level"])
            ],
        },
        "numerical_uncertainty": _numerical_uncertainty(data),
        "domain": {name: own.state() for name, own in domain.domains_of(data).items()},
        "versions": {
            "dldsim": __version__,
            "physics": PHYSICS_VERSION,
            "xgboost": xgboost.__version__,
            "numpy": np.__version__,
        },
    }
    made = Surrogate(_serial(booster), card)
    card["beads"] = beads(made)
    return made


def beads(surrogate: Surrogate) -> list[dict[str, Any]]:
    """Critical diameter of the stiffest spheres learnt over that of the law, by periodicity.

    Beside pillars of the median radius learnt, in the highest channel: the diameter over
    D_c = 1.4 G ε^0.48 at which half of the bump displacement is predicted, for the periodicities of
    BEAD_ROWS at which the surrogate interpolates there; and whether it is within the scatter of
    devices about the law. Empty where no such transition of spheres was learnt.
    """
    own = surrogate.domains.get(BEAD)
    if own is None:
        return []
    low, high = own.geometries[:, 1].min(), own.geometries[:, 1].max()
    gap = np.geomspace(low, high, BEAD_STEPS)
    tall = 2 / own.vertical_confinement[0] if own.vertical_confinement[0] > 0 else 0.0
    bead = CellInFlow(BEAD, 1.0, tall, own.capillary_number[0])
    pillar = float(np.median(own.geometries[:, 0]))
    found = []
    for rows in BEAD_ROWS:
        share = surrogate.share(pillar, gap, rows, bead)
        inside = surrogate.inside_domain(pillar, gap, rows, bead)
        at = half_way(gap, share, inside)
        if np.isnan(at):
            continue
        ratio = float(2 / critical_diameter(at, 1 / rows))
        found.append(
            {
                "periodicity": rows,
                "pillar_radius_over_cell_radius": pillar,
                "over_law": ratio,
                "within_scatter": abs(ratio - 1) <= SCATTER_OF_DAVIS,
            }
        )
    return found


def half_way(gap: np.ndarray, share: np.ndarray, inside: np.ndarray) -> float:
    """Widest of rising gaps (n,) at which half of the bump displacement is predicted, interpolated.

    share: of that displacement (n,); inside: where it was learnt (n,). NaN if it does not fall
    through a half there.
    """
    falls = np.flatnonzero((share[:-1] >= 0.5) & (share[1:] < 0.5) & inside[:-1] & inside[1:])
    if not falls.size:
        return float("nan")
    i = falls[-1]
    return float(gap[i] + (share[i] - 0.5) / (share[i] - share[i + 1]) * (gap[i + 1] - gap[i]))


def _coverage(level: float, shape: str, found: pd.DataFrame) -> dict[str, float | int | str]:
    """Share of outcomes of held-out geometries inside their intervals, each geometry counting once.

    The error of the share is that of a mean over geometries.
    """
    by_geometry = found.groupby("geometry")["inside"].mean()
    return {
        "shape": shape,
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


def _data_hash(data: pd.DataFrame) -> str:
    """SHA-256 over the rows learnt from: inputs, angle and status, in order of outcome_id."""
    rows = data[["outcome_id", *INPUTS, ANGLE, "status"]]
    numbers = [name for name in (*INPUTS, ANGLE) if name != "cell_shape"]
    text = rows.astype(dict.fromkeys(numbers, float)).to_csv(index=False)
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
    if kind != KIND or card.get("features") != FEATURES or card.get("shapes") != list(SHAPES):
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
