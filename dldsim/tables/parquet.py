"""Parquet tables: one schema per kind, with unit, meaning and provenance in the file.

A table is written whole or not at all, holds no NaN (null means "not measured"), and is refused on
reading if it is truncated, foreign, of another kind, or of another physics version.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from dldsim import PHYSICS_VERSION, __version__
from dldsim.errors import DldsimError
from dldsim.files import atomic_path, why_not_read

METADATA_KEY = b"dldsim"


class Column(NamedTuple):
    """One column of a table. A nullable one may hold null, "not measured"."""

    name: str
    type: pa.DataType
    unit: str
    description: str
    nullable: bool = False


_TEXT, _INT, _FLOAT, _BOOL = pa.string(), pa.int64(), pa.float64(), pa.bool_()


def _text(name: str, description: str, nullable: bool = False) -> Column:
    return Column(name, _TEXT, "", description, nullable)


def _count(name: str, description: str, nullable: bool = False) -> Column:
    return Column(name, _INT, "1", description, nullable)


def _flag(name: str, description: str, nullable: bool = False) -> Column:
    return Column(name, _BOOL, "", description, nullable)


def _real(name: str, unit: str, description: str, nullable: bool = False) -> Column:
    return Column(name, _FLOAT, unit, description, nullable)


def _nullable(*columns: Column) -> tuple[Column, ...]:
    return tuple(column._replace(nullable=True) for column in columns)


_RUN_ID = _text("run_id", "identifier of the run")
_GEOMETRY = (
    _real("pillar_radius_um", "µm", "pillar radius P_r"),
    _real("gap_um", "µm", "gap P_g between pillar surfaces"),
    _count("periodicity", "rows N_p after which the array repeats"),
)
_SPRINGS = (
    _real("ks_uN_per_m", "µN/m", "edge spring constant k_s"),
    _real("kb_pN_um", "pN·µm", "dihedral bending constant k_b"),
    _real("kal_uN_per_m", "µN/m", "local area constant k_α"),
)
_OUTCOME_ID = _text("outcome_id", "identifier of array and cell")
_ARRAY_AND_CELL = (
    *_GEOMETRY[:2],
    _real("pitch_um", "µm", "centre-to-centre distance λ = 2 P_r + P_g"),
    _GEOMETRY[2],
    _real("row_shift_fraction", "1", "row shift / pitch, ε = 1/N_p"),
    _text("stiffness_set", "name of the membrane"),
    _text("cell_shape", "rest shape"),
    _real("cell_radius_um", "µm", "largest radius of the rest shape"),
    _real("height_um", "µm", "channel height; 0: two-dimensional limit"),
    *_SPRINGS,
    _real("kag_uN_per_m", "µN/m", "global area constant k_ag"),
    _real("kv_Pa", "Pa", "volume constant k_v"),
    _real("kvisc_nN_s_per_m", "nN·s/m", "edge dashpot k_visc"),
    _real("mean_velocity_mm_s", "mm/s", "mean velocity over the unit cell"),
)
_INTERVAL = (
    _real("angle_low_deg", "°", "lower end of its 95 % interval"),
    _real("angle_high_deg", "°", "upper end of its 95 % interval"),
)
_TRANSITION = _real("transition_distance", "1", "largest lateral step of the row map / row shift, "
                    "less one: above 0 there is a bump lane")
_CAPILLARY = _real("capillary_number", "1", "μU/k_s, with the spring constant; null for k_s = 0")
_CONFINEMENT = _real("confinement", "1", "2R/P_g")
_LAG = _real("lag_number", "1", "relaxation time of the fluid / time in which the cell moves by "
             "its radius, twice: U·2R/ν where the cell is the largest length")
_LEFT_OUT = _text("left_out", "what the scene did without")
_NUMERICS = _text("numerics", "numerics asked for, JSON; the time step may be shorter")
_REQUESTS = (
    _text("request", "name of the design request"),
    _text("status", "answered or failed"),
    _text("reason", "why it failed"),
)
_STATUS = (
    _text("status", "how the run ended"),
    _text("stop_reason", "why it ended so"),
)
_COST = _nullable(
    _count("steps", "lattice-Boltzmann steps"),
    _real("wall_time_s", "s", "time of the calculation"),
    _real("mlups", "1e6/s", "lattice node updates a second"),
)
_DRIFT = _nullable(
    _real("volume_drift_max", "1", "largest relative deviation of the cell volume from rest"),
    _real("area_drift_max", "1", "largest relative deviation of the membrane area from rest"),
)
_POSITION = (
    _RUN_ID,
    _count("step", "lattice-Boltzmann step"),
    _real("t_ms", "ms", "physical time since release"),
    _real("x_um", "µm", "centre of mass along the flow, unwrapped"),
    _real("y_um", "µm", "centre of mass across the flow, unwrapped"),
    _real("z_um", "µm", "centre of mass above mid-height"),
)
_RATIOS = (
    _real("volume_ratio", "1", "cell volume / volume at rest"),
    _real("area_ratio", "1", "membrane area / area at rest"),
)

COLUMNS: dict[str, tuple[Column, ...]] = {
    "trajectory": (
        *_POSITION,
        _real("vx_mm_s", "mm/s", "velocity of the centre of mass along the flow"),
        _real("vy_mm_s", "mm/s", "velocity of the centre of mass across the flow"),
        _real("vz_mm_s", "mm/s", "velocity of the centre of mass along the height"),
        _real("deformation_index", "1", "(a − b)/(a + b) of the projected profile's bounding box"),
        _real("axis_a_um", "µm", "longer side of that box"),
        _real("axis_b_um", "µm", "shorter side of that box"),
        *_RATIOS,
        _real("clearance_um", "µm", "least distance of membrane and solid", nullable=True),
        _real("energy_stretching_aJ", "aJ", "edge spring energy"),
        _real("energy_bending_aJ", "aJ", "bending energy"),
        _real("energy_local_area_aJ", "aJ", "local area energy"),
        _real("energy_global_area_aJ", "aJ", "global area energy"),
        _real("energy_volume_aJ", "aJ", "volume energy"),
    ),
    "runs": (
        _RUN_ID,
        _OUTCOME_ID,
        *_ARRAY_AND_CELL,
        _text("release_axis", "direction of the symmetry axis at release"),
        _real("release_gap_fraction", "1", "centre above the lower pillar at release / P_g"),
        _text("status", "converged, periodic, stationary, undecided, stuck, unstable or failed"),
        _STATUS[1],
        _text("mode", "bump, zigzag, mixed or none"),
        *_nullable(
            _real("migration_angle_deg", "°", "migration angle θ_m of the settled motion"),
            *_INTERVAL,
            _real("first_period_angle_deg", "°", "angle of the first N_p rows after release"),
        ),
        _real("bump_angle_deg", "°", "angle of full bump mode, atan(1/N_p)"),
        _count("rows_completed", "rows passed"),
        _count("orbit_rows", "rows after which the motion repeats; 0: it did not"),
        *_nullable(
            _count("settled_row", "row from which on the settled motion holds"),
            _real("row_map_peak", "1", "largest lateral step of the settled motion / row shift"),
            _TRANSITION,
            _real("capture_chance", "1", "chance per row to be caught by the bump lane"),
        ),
        Column("lateral_steps_um", pa.list_(_FLOAT), "µm", "lateral step of each row"),
        _COST[0],
        *_nullable(
            _count("nodes", "fluid nodes"),
            _count("vertices", "membrane vertices"),
            _real("spacing_um", "µm", "lattice spacing"),
            _count("rows_in_domain", "pillar rows in the periodic domain"),
            _count("lanes_in_domain", "pillars per row in the periodic domain"),
            _real("height_on_lattice_um", "µm", "channel height in whole nodes"),
            _real("time_step_us", "µs", "time step, in the time of the physical flow"),
            _real("velocity_lu", "1", "mean velocity in lattice units, after shortening the step"),
            _real("relaxation_time", "1", "relaxation time τ, lattice units"),
        ),
        _COST[1],
        _real("ms_per_step", "ms", "wall time per step", nullable=True),
        _COST[2],
        *_nullable(
            _CAPILLARY,
            _real("reynolds_number", "1", "U·2R/ν of the simulation"),
            _LAG,
            _real("mach_max", "1", "largest Mach number"),
        ),
        _CONFINEMENT,
        *_nullable(_real("lateral_flux_ratio", "1", "lateral / axial flux, mean over the run")),
        *_DRIFT,
        *_nullable(
            _real("min_clearance_um", "µm", "least distance of membrane and solid"),
            _real("mean_deformation_index", "1", "deformation index in the array, mean in time"),
        ),
        _LEFT_OUT,
        _NUMERICS,
        _text("details", "margins of the time step and other particulars of the run, JSON"),
    ),
    "outcomes": (
        _OUTCOME_ID,
        *_ARRAY_AND_CELL,
        _text("release_axis", "direction of the symmetry axis at release"),
        _CAPILLARY._replace(nullable=True),
        _CONFINEMENT,
        *_nullable(
            _real("deformation_index", "1", "of the stiffness set, mean of the constriction runs"),
            _real("deformation_index_std", "1", "scatter of the constriction runs"),
        ),
        _text("status", "decided; coexisting: decided, but releases end in different motions; "
              "undecided; stuck, unstable or failed"),
        _STATUS[1],
        _text("mode", "bump, zigzag, mixed or none, after the mean angle"),
        *_nullable(
            _real("migration_angle_deg", "°", "settled migration angle θ_m, mean over the flux of "
                  "cells"),
            *_INTERVAL,
            _real("angle_spread_deg", "°", "largest minus least angle over the releases"),
            _real("source_angle_deg", "°", "first N_p rows of the release at mid-gap, as in the "
                  "source; null: no such release"),
            _real("sigma_num_deg", "°", "numerical uncertainty, see sigma_num_basis"),
        ),
        _text("sigma_num_basis", "modelled, extrapolated, spans the modes, not studied, or no "
              "angle: and why"),
        _real("bump_angle_deg", "°", "angle of full bump mode, atan(1/N_p)"),
        *_nullable(
            _real("share_bump", "1", "share of the flux of cells that bumps"),
            _real("share_mixed", "1", "share of the flux of cells in mixed mode"),
            _real("share_zigzag", "1", "share of the flux of cells that zigzags"),
            _real("share_none", "1", "share of the flux of cells without a mode"),
            _flag("coexisting", "whether releases end in different motions"),
            _count("settled_row", "row from which on every release has settled"),
            _TRANSITION,
        ),
        _count("releases", "places of release simulated"),
        _count("rows_total", "rows passed, all releases together"),
        _COST[0],
        _COST[1],
        *_nullable(
            _real("spacing_um", "µm", "lattice spacing"),
            _LAG,
        ),
        _LEFT_OUT,
        _NUMERICS,
    ),
    "flows": (
        *_GEOMETRY,
        _real("pitch_um", "µm", "centre-to-centre distance λ = 2 P_r + P_g"),
        _real("height_um", "µm", "channel height; 0: two-dimensional limit"),
        _text("drive", "no-lateral-flux, or axial: body force along x only"),
        *_STATUS,
        *_nullable(
            _real("permeability_over_pitch2", "1", "permeability k_xx / pitch²"),
            _real("permeability_xx_over_pitch2", "1", "permeability k_xx / pitch²"),
            _real("permeability_xy_over_pitch2", "1", "permeability k_xy / pitch²"),
            _real("permeability_yx_over_pitch2", "1", "permeability k_yx / pitch²"),
            _real("permeability_yy_over_pitch2", "1", "permeability k_yy / pitch²"),
            _real("tilt_deg", "°", "tilt of the mean flow under a force along x"),
            _real("lateral_flux_ratio", "1", "lateral / axial flux with the drive in force"),
            _real("drag_over_mu_U", "1", "drag of a pillar per length / (μU)"),
            _real("force_ratio_y_over_x", "1", "lateral / axial body force of the drive in force"),
            _real("spacing_um", "µm", "lattice spacing"),
            _count("nodes", "fluid nodes"),
        ),
        *_COST,
    ),
    "constriction_runs": (
        _RUN_ID,
        _text("group", "stiffness group"),
        _text("stiffness_set", "stiffness set that the group calibrates; empty: none"),
        *_SPRINGS,
        _real("velocity_mm_s", "mm/s", "mean velocity in the wide channel"),
        _text("design", "group-velocity: each group at its own; fixed-velocity: all at one"),
        _real("release_position_um", "µm", "release, from the first possible position"),
        *_STATUS,
        *_nullable(
            _real("deformation_index", "1", "with the centre in the middle of the throat"),
            _real("deformation_index_max", "1", "largest on the way"),
            _real("throat_d_um", "µm", "extent along the flow at the throat's centre"),
            _real("throat_h_um", "µm", "extent across the flow at the throat's centre"),
        ),
        *_COST,
        _real("capillary_number", "1", "μv/k_s, with the spring constant; null for k_s = 0", True),
        *_DRIFT,
    ),
    "constriction_trajectory": (
        *_POSITION,
        _real("diameter_d_um", "µm", "extent along the flow"),
        _real("diameter_h_um", "µm", "extent across the flow"),
        _real("deformation_index", "1", "(a − b)/(a + b) of the projected profile's bounding box"),
        *_RATIOS,
    ),
    "calibration": (
        _text("design", "group-velocity: each group at its own; fixed-velocity: all at one"),
        _text("group", "stiffness group"),
        _text("stiffness_set", "stiffness set that the group calibrates; empty: none"),
        *_SPRINGS,
        _real("velocity_mm_s", "mm/s", "mean velocity in the wide channel"),
        _count("runs", "constriction runs with a deformation index"),
        *_nullable(
            _real("deformation_index", "1", "mean over the release positions"),
            _real("deformation_index_std", "1", "standard deviation over the release positions"),
            _real("deformation_index_low", "1", "95 % confidence interval of the mean, lower end"),
            _real("deformation_index_high", "1", "95 % confidence interval of the mean, upper end"),
            _real("deformation_index_min", "1", "least over the release positions"),
            _real("deformation_index_max", "1", "largest over the release positions"),
            _real("coefficient_of_variation", "1", "standard deviation / mean"),
        ),
    ),
    "calibration_correlations": (
        _text("design", "group-velocity or fixed-velocity"),
        _text("variable_a", "column name"),
        _text("variable_b", "column name"),
        _real("pearson_r", "1", "Pearson correlation; null if a variable is constant", True),
        _count("n", "constriction runs compared"),
    ),
    "anova": (
        _text("model", "main_effects, seed_interactions or hierarchical"),
        _text("term", "factor, interaction or residual"),
        *_nullable(
            _real("sum_sq", "deg²", "sum of squares, type II"),
            _real("df", "1", "degrees of freedom"),
            _real("f_value", "1", "F statistic"),
            _real("p_value", "1", "probability of such an F by chance"),
            _real("partial_eta_sq", "1", "sum of squares / (itself + residual)"),
            _real("partial_omega_sq", "1", "the same, corrected for degrees of freedom"),
            _real("p_robust", "1", "p of the Wald test with the HC3 covariance"),
            _real("p_permutation", "1", "p by permutation of whole geometries"),
        ),
        _text("note", "what to know about this row"),
    ),
    "anova_diagnostics": (
        _text("model", "main_effects, seed_interactions or hierarchical"),
        _text("test", "what is looked at"),
        *_nullable(
            _real("statistic", "see test", "its value"),
            _real("p_value", "1", "probability of such a value under the assumption tested"),
        ),
        _text("meaning", "how to read it"),
    ),
    "sobol": (
        _text("factor", "input of the surrogate; a & b: varied together"),
        _real("first_order", "1", "share of the variance due to the input alone"),
        _real("first_order_low", "1", "95 % bootstrap interval, lower end"),
        _real("first_order_high", "1", "95 % bootstrap interval, upper end"),
        _real("total_order", "1", "share of the variance that it takes part in"),
        _real("total_order_low", "1", "95 % bootstrap interval, lower end"),
        _real("total_order_high", "1", "95 % bootstrap interval, upper end"),
        _count("points", "base points of the design"),
        _real("inside_share", "1", "share of points at which the surrogate interpolates"),
    ),
    "partial_dependence": (
        _text("x_name", "first input"),
        _text("y_name", "second input"),
        _real("x", "see x_name", "value of the first input"),
        _real("y", "see y_name", "value of the second input"),
        _real("angle_deg", "°", "mean predicted angle; null: nowhere inside the domain", True),
        _real("share", "1", "mean predicted share of the bump displacement", nullable=True),
        _real("inside_share", "1", "share of combinations inside the domain"),
    ),
    "fabrication": (
        *_GEOMETRY,
        _text("stiffness_set", "name of the membrane"),
        _real("deformation_index", "1", "of the stiffness set"),
        _real("cell_radius_um", "µm", "largest radius of the rest shape"),
        _real("radius_error_um", "µm", "standard deviation of P_r at the pitch of the mask"),
        _real("moved_limit_deg", "°", "change of the angle that counts as moved"),
        _real("predicted_angle_deg", "°", "angle of the surrogate at nominal size"),
        _text("predicted_mode", "mode of the surrogate at nominal size"),
        _text("simulated_mode", "mode of the outcome"),
        _real("mode_change_probability", "1", "that the error changes the surrogate's mode"),
        _real("moved_probability", "1", "that the angle moves by more than the limit"),
        _real("angle_std_deg", "°", "standard deviation of the angle"),
        _real("inside_share", "1", "share of sizes at which the surrogate interpolates"),
    ),
    "robustness": (
        *_GEOMETRY,
        *_nullable(
            _real("mean_migration_angle_deg", "°", "mean over the stiffness sets"),
            _real("robustness_score_deg2", "deg²", "mean squared difference to the neighbours"),
        ),
        _count("neighbours", "geometries that differ in one parameter by one level"),
        _flag("robust", "among the most robust 15 %"),
        _text("modes", "modes seen"),
    ),
    "benchmark": (
        _text("model", "regressor"),
        _text("split", "random, by geometry, or by stiffness set"),
        _count("repeat", "number of the repetition"),
        _count("fold", "number of the split"),
        _count("n_train", "rows learnt from"),
        _count("n_test", "rows predicted"),
        _real("mse_deg2", "deg²", "mean squared error"),
        _real("rmse_deg", "°", "its root"),
        _real("mae_deg", "°", "mean absolute error"),
        _real("r2", "1", "coefficient of determination; null for constant test rows", True),
        _real("fit_time_s", "s", "time of the fit"),
        _real("predict_time_s", "s", "time of the prediction"),
    ),
    "predictions": (
        _OUTCOME_ID,
        _text("model", "regressor"),
        _text("split", "random, by geometry, or by stiffness set"),
        _count("repeat", "number of the repetition"),
        _count("fold", "number of the split"),
        _real("observed_deg", "°", "simulated migration angle"),
        _real("predicted_deg", "°", "predicted migration angle"),
        _flag("decided", "whether the simulated motion had settled"),
    ),
    "designs": (
        _text("request", "name of the design request"),
        _count("design", "number of the candidate within its request, best first"),
        _count("rank", "1 is the best; equal: apart by less than the numerical uncertainty"),
        *_GEOMETRY,
        _text("objective", "what was maximised: separation, or robust"),
        _real(
            "value", "°; 1 below zero", "its value; robust, below zero: share of the draws' range"
        ),
        _real("separation_deg", "°", "difference of the two predicted angles"),
        _real("angle_1_deg", "°", "predicted angle of the first cell type"),
        _real("angle_2_deg", "°", "predicted angle of the second cell type"),
        _text("mode_1", "predicted mode of the first cell type"),
        _text("mode_2", "predicted mode of the second cell type"),
        _real("separation_tolerance_min_deg", "°", "least separation within the tolerance", True),
        _real("separation_tolerance_max_deg", "°", "largest separation within the tolerance", True),
        _real("robust_separation_deg", "°", "exceeded by nine of ten Monte Carlo draws"),
        _real("mode_change_probability", "1", "share of the draws in which a mode differs"),
        _real("sigma_num_deg", "°", "numerical uncertainty of the separation", nullable=True),
        _real("uncertainty_deg", "°", "half-width of the separation's 90 % prediction interval"),
        _real("length_mm", "mm", "array length for the lateral separation wanted", nullable=True),
        _real("pressure_drop_kPa", "kPa", "over that length at the flow's velocity", nullable=True),
        _text("pressure_basis", "where the pressure drop comes from"),
        _real("throughput_uL_per_h", "µL/h", "flow through the width of the device's array"),
        _text("verdict", "resolved or not, and why"),
        _flag("inside_training_domain", "whether the surrogate interpolates"),
    ),
    "design_trials": (
        _text("request", "name of the design request"),
        _count("trial", "number of the trial"),
        *_GEOMETRY,
        *_nullable(
            _real("angle_1_deg", "°", "predicted angle of the first cell type"),
            _real("angle_2_deg", "°", "predicted angle of the second cell type"),
            _real("separation_deg", "°", "difference of the two predicted angles"),
            _real("value", "°; 1 below zero", "value of the objective"),
        ),
        _flag("feasible", "whether the constraints hold"),
        _text("reason", "what is violated"),
    ),
    "design_tolerances": (
        _text("request", "name of the design request"),
        _count("design", "number of the candidate within its request"),
        _text("parameter", "what is off; edge_um: every pillar edge outwards at the same pitch"),
        _real("offset", "µm; 1 for a deformation index", "by how much"),
        _real("angle_1_deg", "°", "predicted angle of the first cell type"),
        _real("angle_2_deg", "°", "predicted angle of the second cell type"),
        _real("separation_deg", "°", "their difference, negative if the order is reversed"),
        _text("mode_1", "predicted mode of the first cell type"),
        _text("mode_2", "predicted mode of the second cell type"),
        _real("sensitivity_deg_per_unit", "° per unit", "slope of the separation over ± offset"),
    ),
    "design_importance": (
        _text("request", "name of the design request"),
        _text("parameter", "parameter of the search"),
        _real("importance", "1", "share of the importance; null: values do not differ", True),
        _text("evaluator", "how it was judged"),
    ),
    "design_slices": (
        _text("request", "name of the design request"),
        _text("x_parameter", "parameter along x"),
        _text("y_parameter", "parameter along y; the third is that of the best candidate"),
        _real("x", "as the parameter", "value along x"),
        _real("y", "as the parameter", "value along y"),
        _real("difference_deg", "°", "predicted angle 2 − angle 1"),
        _flag("feasible", "whether the constraints hold"),
        _flag("inside_training_domain", "whether the surrogate interpolates"),
    ),
    "verifications": (
        _text("request", "name of the design request"),
        _count("round", "round of search, simulation and refit"),
        _text("role", "design; finer or height: the same, set so; transition: near a mode change"),
        _count("array", "number of the array within its request"),
        _text("population", "cell type 1 or 2; difference: angle 2 − angle 1"),
        *_GEOMETRY,
        _real("height_um", "µm", "channel height"),
        _text("outcome_id", "identifier of the outcome; of both for the difference"),
        *_nullable(
            _real("deformation_index", "1", "of the cell type"),
            _real("cell_radius_um", "µm", "radius of the cell type"),
            _real("ks_uN_per_m", "µN/m", "edge spring constant k_s as simulated"),
        ),
        _text("stiffness_basis", "where the moduli come from"),
        _real("predicted_deg", "°", "prediction before the simulation"),
        _real("predicted_low_deg", "°", "lower end of its 90 % interval"),
        _real("predicted_high_deg", "°", "upper end of its 90 % interval"),
        *_nullable(
            _real("simulated_deg", "°", "simulated angle, or difference"),
            _real("sigma_num_deg", "°", "numerical uncertainty of it"),
        ),
        _text("predicted_mode", "mode after the predicted angle; of both for the difference"),
        _text("mode", "simulated mode; of both for the difference"),
        _text("status", "status of the outcome; of both for the difference"),
        _real("wall_time_s", "s", "wall time", nullable=True),
        _flag("agrees", "simulated ± σ_num meets the interval; null: nothing to compare, or an "
              "interval of the difference that includes zero", True),
        _text("verdict", "the same in words"),
        _text("note", "what to know about this row"),
    ),
    "verified_designs": (
        _text("request", "name of the design request"),
        _count("rank", "1 is the best by simulation; equal: apart by less than σ_num"),
        _text("name", "name of its files"),
        _count("array", "its number in the verifications"),
        _count("round", "round in which it was simulated"),
        *_GEOMETRY,
        *_nullable(
            _real("separation_deg", "°", "simulated difference of the two angles"),
            _real("sigma_num_deg", "°", "numerical uncertainty of it"),
            _real("separation_finer_deg", "°", "on a finer lattice at half Re; < 0: other order"),
            _real("finer_spacing_um", "µm", "lattice spacing there"),
            _real("finer_lag_number", "1", "numerical Reynolds number there"),
            _real("angle_1_deg", "°", "simulated angle of the first cell type"),
            _real("angle_2_deg", "°", "simulated angle of the second cell type"),
        ),
        _text("mode_1", "simulated mode of the first cell type"),
        _text("mode_2", "simulated mode of the second cell type"),
        _text("status_1", "status of the outcome of the first cell type"),
        _text("status_2", "status of the outcome of the second cell type"),
        _real("predicted_separation_deg", "°", "separation predicted before the simulations"),
        _real("uncertainty_deg", "°", "half-width of its 90 % interval"),
        _real("separation_tolerance_min_deg", "°", "least over ± P_r and P_g, refitted surrogate"),
        _real("separation_tolerance_max_deg", "°", "largest over ± P_r and P_g, likewise"),
        _real("robust_separation_deg", "°", "exceeded by nine of ten draws, likewise"),
        _real("mode_change_probability", "1", "share of the draws with another mode, likewise"),
        *_nullable(
            _real("separation_low_height_deg", "°", "simulated, channel lower by the tolerance"),
            _real("separation_high_height_deg", "°", "simulated, channel higher by the tolerance"),
            _real("permeability_over_pitch2", "1", "permeability along x / pitch²"),
            _real("length_mm", "mm", "array length for the lateral separation wanted"),
            _real("pressure_drop_kPa", "kPa", "over that length at the flow's velocity"),
        ),
        _text("pressure_basis", "where permeability and pressure drop come from"),
        _real("throughput_uL_per_h", "µL/h", "flow through the width of the device's array"),
        _flag("agrees", "whether prediction and simulation agree; null: not comparable, or the "
              "prediction left the order open", True),
        _flag("separates", "beyond 2 σ_num from all releases, at two settings; null: open", True),
        _text("verdict", "the same in words"),
        _text("stopped", "why the rounds of the request ended"),
    ),
    "accuracy": (
        _text("quantity", "migration_angle [°] or deformation_index"),
        _text("kind", "knob: one setting changed; setting: whole settings"),
        _text("case", "run that is repeated"),
        _text("run", "its run id, or its constriction group"),
        _text("knob", "setting that is changed, or name of the whole setting"),
        _text("setting", "value of the knob, or what differs from the default, as JSON"),
        _count("rank", "position in the list of values, coarse to finest"),
        _flag("is_default", "the campaign's own setting"),
        _flag("is_reference", "finest value of the knob, or the combined reference"),
        Column("values", pa.list_(_FLOAT), "see quantity", "of each start; stuck, unstable: none"),
        *_nullable(
            _real("value", "see quantity", "mean over the starts"),
            _real("spread", "see quantity", "standard deviation over the starts"),
            _real("error", "see quantity", "difference from the finest value of the knob"),
            _real("error_share", "1", "error / bump angle, or / index of the reference"),
            _real("error_to_reference", "see quantity", "difference from the combined reference"),
            _real("error_to_reference_share", "1", "the same, as a share"),
            _real("noise", "see quantity", "standard deviation of a difference from starts alone"),
            _real("noise_share", "1", "the same, as a share"),
            _real("bump_angle_deg", "°", "angle of full bump motion, arctan(1/N_p)"),
        ),
        _text("mode", "bump, zigzag, mixed or none; of each start where they differ"),
        _text("status", "how the runs ended; of each start where they differ"),
        _flag("settled", "whether the motion of every start repeats"),
        *_nullable(
            _real("half_width_deg", "°", "half of the 95 % interval, mean over the starts"),
            _real("rows", "1", "rows that the cell was followed, mean over the starts"),
            _real("wall_time_s", "s", "wall time of a run, mean over the starts"),
            _count("steps", "time steps, mean over the starts"),
            _count("nodes", "fluid nodes"),
            _count("vertices", "membrane vertices"),
            _real("spacing_um", "µm", "lattice spacing"),
        ),
    ),
    "critical_gap_points": (
        _text("search", "identifier of the search"),
        _count("number", "number of the point in the search"),
        _real("gap_um", "µm", "gap that was simulated"),
        _count("side", "1: a bump lane exists, -1: none, 0: cannot be told"),
        _real("transition_distance", "1", "largest lateral step of a row in row shifts − 1", True),
        _text("status", "of the outcome"),
        _text("mode", "of the outcome"),
        *_nullable(
            _real("migration_angle_deg", "°", "migration angle θ_m of the outcome"),
            _real("spacing_um", "µm", "lattice spacing"),
            _real("height_on_lattice_um", "µm", "channel height on the lattice"),
            _real("lag_number", "1", "numerical Reynolds number of the runs"),
        ),
        _count("releases", "runs, one for each place of release"),
        _real("wall_time_s", "s", "time of the calculation", nullable=True),
    ),
    "critical_gaps": (
        _text("search", "identifier of the search"),
        *(c for c in _GEOMETRY if c.name != "gap_um"),
        _text("stiffness_set", "name of the membrane; sphere: a stiff sphere"),
        _text("cell_shape", "rest shape"),
        _real("cell_radius_um", "µm", "largest radius of the rest shape"),
        _real("height_um", "µm", "channel height"),
        _real("height_on_lattice_um", "µm", "channel height on the lattice", nullable=True),
        _text("knob", "setting that differs from the campaign's; campaign: none"),
        _real("spacing_asked_um", "µm", "numerics.spacing_um of the search"),
        _real("spacing_um", "µm", "lattice spacing at the critical gap", nullable=True),
        _real("reynolds_max", "1", "numerics.reynolds_max of the search"),
        *_nullable(
            _real("lag_number", "1", "numerical Reynolds number at the critical gap"),
            _real("critical_gap_um", "µm", "gap at which the transition distance vanishes"),
            _real("low_um", "µm", "largest gap seen with a bump lane"),
            _real("high_um", "µm", "smallest gap seen without"),
            _real("diameter_over_gap", "1", "cell diameter / critical gap"),
        ),
        _count("points", "gaps simulated"),
        _count("runs", "runs simulated"),
        _real("wall_time_s", "s", "time of the calculation, all points"),
        _text("note", "what to know about this row"),
    ),
    "convergence": (
        *(c for c in _GEOMETRY if c.name != "gap_um"),
        _text("stiffness_set", "name of the membrane; sphere: a stiff sphere"),
        _text("cell_shape", "rest shape"),
        _real("cell_radius_um", "µm", "largest radius of the rest shape"),
        _text("knob", "setting that is changed, all else the campaign's"),
        Column("steps", pa.list_(_FLOAT), "µm or 1", "spacing, or numerical Reynolds number"),
        Column("critical_gaps_um", pa.list_(_FLOAT), "µm", "critical gap at each step"),
        *_nullable(
            _real("range_um", "µm", "largest difference between these gaps"),
            _real("observed_order", "1", "order p of gap = limit + C step^p; null: see note"),
            _real("extrapolated_gap_um", "µm", "the limit"),
            _real("error_um", "µm", "critical gap at the campaign's numerics − limit"),
        ),
        _text("note", "what to know about this row"),
    ),
    "reference_check": (
        _text("outcome_id", "identifier of the array × cell pair"),
        *_GEOMETRY,
        _text("stiffness_set", "name of the membrane"),
        _text("mode", "at the campaign's numerics"),
        _text("reference_mode", "at the reference's numerics"),
        _text("status", "of the outcome at the campaign's numerics"),
        _text("reference_status", "of the outcome at the reference's numerics"),
        _real("bump_angle_deg", "°", "angle of full bump mode, atan(1/N_p)"),
        *_nullable(
            _real("migration_angle_deg", "°", "at the campaign's numerics"),
            _real("reference_angle_deg", "°", "at the reference's numerics"),
            _real("transition_distance", "1", "at the campaign's numerics"),
            _real("reference_distance", "1", "at the reference's numerics"),
            _real("spacing_um", "µm", "lattice spacing at the campaign's numerics"),
            _real("reference_spacing_um", "µm", "lattice spacing at the reference's numerics"),
            _real("error_deg", "°", "angle − reference angle"),
            _real("sigma_num_deg", "°", "numerical uncertainty of the angle"),
            _real("error_over_sigma", "1", "size of the error / σ_num"),
        ),
        _text("sigma_num_basis", "on what σ_num rests"),
        _text("verdict", "agrees, disagrees, or cannot be told, and by how much"),
    ),
    "spot_check": (
        _text("outcome_id", "identifier of the array × cell pair"),
        *_GEOMETRY,
        _text("stiffness_set", "name of the membrane"),
        _text("mode", "of the campaign"),
        _text("check_mode", "of the check"),
        _text("status", "of the campaign's outcome"),
        _text("check_status", "of the check"),
        *_nullable(
            _real("migration_angle_deg", "°", "of the campaign"),
            _real("check_angle_deg", "°", "of the check"),
            _real("change_deg", "°", "check − campaign"),
            _real("sigma_num_deg", "°", "numerical uncertainty of the campaign's angle"),
            _real("change_over_sigma", "1", "size of the change / σ_num"),
            _real("spacing_um", "µm", "lattice spacing of the campaign"),
            _real("check_spacing_um", "µm", "lattice spacing of the check"),
            _real("check_wall_time_s", "s", "time of the calculation of the check"),
        ),
        _text("verdict", "holds, changes, or cannot be told, and by how much"),
    ),
    "learning_curve": (
        _text("model", "regressor"),
        _count("repeat", "number of the split into arrays learnt from and held out"),
        _count("geometries", "arrays learnt from"),
        _count("outcomes", "outcomes learnt from"),
        _count("n_test", "outcomes of the arrays held out"),
        _real("rmse_deg", "°", "root mean squared error on the arrays held out"),
        _real("mae_deg", "°", "mean absolute error on them"),
        _real("fit_time_s", "s", "time of the fit"),
        _real("simulation_time_s", "s", "wall time of the outcomes learnt from", nullable=True),
    ),
    "design_requests": _REQUESTS,
    "verified_requests": _REQUESTS,
    "search_regret": (
        _text("request", "name of the design request"),
        _text("method", "tpe, random, or grid: exhaustive"),
        _count("repeat", "number of the repetition, each with its own seed"),
        _count("evaluations", "geometries tried so far"),
        _real("best_deg", "°", "largest separation found so far, 0 for none"),
        _real("regret_deg", "°", "largest separation that any method found, minus that"),
        _real("time_s", "s", "time since the start of the search"),
    ),
    "stability": (
        _text("family", "what is driven to an extreme"),
        _text("title", "the same in words"),
        _text("label", "point of the family"),
        _real("parameter", "see parameter_of", "value of what is changed"),
        _text("parameter_of", "name and unit of the parameter"),
        _text("stiffness_set", "membrane that the point starts from"),
        _text("time_step", "automatic, or as-given where automatic is shorter"),
        *_nullable(
            _flag("predicted_safe", "by the bound, or made so by a shorter step"),
            _real("margin", "1", "largest of the margins; up to 1 is safe as given"),
            _real("margin_elastic", "1", "ω² of the stiffest elastic mode / safe ω²"),
            _real("margin_mass", "1", "vertex mass asked for by springs / by friction"),
            _real("margin_lag", "1", "delay of the dashpots / largest allowed"),
            _real("margin_speed", "1", "fluid speed at release / largest allowed"),
            _real("refinement", "1", "factor by which the time step was shortened"),
        ),
        _text("outcome", "ran, unstable, stuck or refused"),
        _text("reason", "why it did not run, or may not have"),
        *_nullable(
            _count("steps", "time steps"),
            _count("nodes", "fluid nodes"),
            _count("vertices", "membrane vertices"),
            _real("wall_time_s", "s", "time of the loop"),
            _real("mach_max", "1", "largest Mach number"),
            _real("volume_drift_max", "1", "largest relative deviation of the cell volume"),
            _real("area_drift_max", "1", "largest relative deviation of the membrane area"),
            _real("inverted_faces_max", "1", "largest share of inverted faces"),
            _real("min_clearance_um", "µm", "smallest distance from a surface, with sign"),
        ),
    ),
    "validation": (
        _text("case", "validation case"),
        _text("group", "fluid, membrane, cell or scenes"),
        _text("quantity", "what is compared"),
        _text("variant", "what tells rows of one quantity apart, such as the kind of bounce-back"),
        _text("unit", "unit of value and reference, in words or symbols"),
        _real("parameter", "see parameter_of", "what the quantity is a function of", nullable=True),
        _text("parameter_of", "name and unit of the parameter"),
        _real("resolution", "1", "nodes or edges over the length resolution_of", nullable=True),
        _text("resolution_of", "what the resolution counts"),
        *_nullable(
            _real("reference", "see unit", "reference value"),
            _real("value", "see unit", "our value"),
            _real("relative_error", "1", "value / reference − 1; of a field: norm of difference"),
            _real("observed_order", "1", "order of the error since the next coarser resolution; "
                  "null below rounding and where the error changes its sign"),
            _real("mark", "1", "allowed size of the relative error; null: shown only"),
            _flag("passed", "whether the error keeps to the mark; null: shown only"),
        ),
        _real("wall_time_s", "s", "time of this comparison"),
        _text("source", "origin of the reference"),
        _text("note", "what to know about this row"),
    ),
}


def schema(kind: str) -> pa.Schema:
    """Arrow schema of one kind of table, with unit and description on each field."""
    if kind not in COLUMNS:
        raise DldsimError(f"Unknown kind of table {kind!r}. Known: {', '.join(COLUMNS)}.")
    return pa.schema(
        pa.field(c.name, c.type, c.nullable, {"unit": c.unit, "description": c.description})
        for c in COLUMNS[kind]
    )


def write_table(kind: str, data: Any, path: Path, provenance: Mapping[str, Any]) -> None:
    """Write a table whole or not at all.

    `data` is a dict of columns, a list of row dicts, or a pandas DataFrame (whose NaN is null).
    `provenance` goes into the file's metadata beside the versions: `config_hash`, `seed`, …
    Raises DldsimError naming the column for a missing, extra, mistyped or not finite one.
    """
    target = schema(kind)
    columns = _as_columns(kind, data, target.names)
    arrays = [_array(kind, field, columns[field.name]) for field in target]
    lengths = {field.name: len(array) for field, array in zip(target, arrays, strict=True)}
    if len(set(lengths.values())) > 1:
        raise DldsimError(f"table {kind}: columns of unequal length: {lengths}.")
    table = pa.table(arrays, schema=_stamped(kind, target, provenance))
    with atomic_path(path) as part:
        pq.write_table(table, part, compression="zstd")


def concatenate(kind: str, sources: Iterable[Path], path: Path,
                provenance: Mapping[str, Any]) -> None:
    """Join tables of one kind into one, in order, one row group per non-empty source."""
    target = _stamped(kind, schema(kind), provenance)
    with atomic_path(path) as part, pq.ParquetWriter(part, target, compression="zstd") as writer:
        for source in sources:
            table = read_columns(kind, source)
            if table.num_rows:
                writer.write_table(table.replace_schema_metadata(target.metadata))


def read_columns(kind: str, path: Path) -> pa.Table:
    """A checked table as Arrow columns.

    Raises DldsimError if the file is absent, truncated, foreign, of another kind or another
    physics version.
    """
    metadata = _provenance(path)
    if metadata["kind"] != kind:
        raise DldsimError(f"{path} holds a table of kind {metadata['kind']}, not {kind}.")
    if metadata["physics_version"] != PHYSICS_VERSION:
        raise DldsimError(
            f"{path} was made by physics version {metadata['physics_version']} (dldsim "
            f"{metadata['dldsim_version']}); this is version {PHYSICS_VERSION} (dldsim "
            f"{__version__}), whose trajectories differ. Move results/ away, or make everything "
            "anew with `snakemake -j2 all --forceall`."
        )
    try:
        table = pq.ParquetFile(path).read()
    except (pa.ArrowInvalid, OSError) as error:
        raise DldsimError(_unreadable(path, error)) from error
    if not table.schema.equals(schema(kind)):
        differing = set(table.schema.names) ^ set(schema(kind).names)
        raise DldsimError(
            f"{path} has other columns than a table of kind {kind} in dldsim {__version__} "
            f"({', '.join(sorted(differing)) or 'types or order differ'}); it was made by dldsim "
            f"{metadata['dldsim_version']}. Move it away and run `snakemake -j2 all`."
        )
    return table


def read_table(kind: str, path: Path):
    """A checked table as a pandas DataFrame; see `read_columns`."""
    return read_columns(kind, path).to_pandas()


def read_many(kind: str, paths: Iterable[Path]):
    """Checked tables of one kind, one below the other, as a pandas DataFrame."""
    return pa.concat_tables([schema(kind).empty_table(), *(read_columns(kind, p) for p in paths)],
                            promote_options="default").to_pandas()


def read_rows(kind: str, path: Path) -> list[dict]:
    """A checked table as a list of row dicts; see `read_columns`."""
    return read_columns(kind, path).to_pylist()


def write_csv(kind: str, path: Path) -> Path:
    """Write a table's CSV twin beside it, lists as JSON; returns its path."""
    table = read_columns(kind, path)
    for i, field in enumerate(table.schema):
        if pa.types.is_list(field.type):
            texts = [None if v is None else json.dumps(v) for v in table[i].to_pylist()]
            table = table.set_column(i, field.name, pa.array(texts, _TEXT))
    csv = Path(path).with_suffix(".csv")
    with atomic_path(csv) as part:
        pyarrow.csv.write_csv(table, part)
    return csv


def describe(path: Path) -> dict:
    """Kind, provenance, rows and columns (name, type, unit, description) of any dldsim table."""
    metadata = _provenance(path)
    file = pq.ParquetFile(path)
    columns = [
        {
            "name": field.name,
            "type": str(field.type),
            "nullable": field.nullable,
            "unit": (field.metadata or {}).get(b"unit", b"").decode(),
            "description": (field.metadata or {}).get(b"description", b"").decode(),
        }
        for field in file.schema_arrow
    ]
    kind = metadata.pop("kind")
    return {"file": str(path), "kind": kind, "rows": file.metadata.num_rows, "columns": columns,
            "provenance": metadata}


def _stamped(kind: str, target: pa.Schema, provenance: Mapping[str, Any]) -> pa.Schema:
    record = {"kind": kind, "dldsim_version": __version__, "physics_version": PHYSICS_VERSION}
    text = json.dumps(record | dict(provenance), ensure_ascii=False, sort_keys=True)
    return target.with_metadata({METADATA_KEY: text.encode()})


def _unreadable(path: Path, error: Exception) -> str:
    """Damaged; or good but out of reach, which is no reason to delete it."""
    return why_not_read(path, error) or (
        f"{path} is not a readable Parquet file: truncated, or of another format. Delete it and "
        "run `snakemake -j2 all`, which makes it anew."
    )


def _provenance(path: Path) -> dict:
    try:
        metadata = pq.ParquetFile(path).schema_arrow.metadata or {}
    except FileNotFoundError as error:
        raise DldsimError(f"{path} does not exist. Check the path, or make it with "
                          "`snakemake -j2 all`.") from error
    except (pa.ArrowInvalid, OSError) as error:
        raise DldsimError(_unreadable(path, error)) from error
    if METADATA_KEY not in metadata:
        raise DldsimError(f"{path} was not written by dldsim: it carries no dldsim metadata. "
                          "Move it out of the results folder, or check the path.")
    return json.loads(metadata[METADATA_KEY])


def _as_columns(kind: str, data: Any, names: Sequence[str]) -> dict[str, Any]:
    if isinstance(data, list):
        given = dict.fromkeys(name for row in data for name in row) if data else names
        columns = {name: [row.get(name) for row in data] for name in given}
        absent = {name for row in data for name in names if name not in row}
    elif isinstance(data, Mapping):
        columns, absent = dict(data), set()
    else:  # DataFrame
        columns, absent = {name: data[name] for name in data.columns}, set()
    absent |= set(names) - set(columns)
    extra = [str(name) for name in columns if name not in names]
    if absent or extra:
        parts = [f"missing {', '.join(n for n in names if n in absent)}" if absent else "",
                 f"unknown {', '.join(extra)}" if extra else ""]
        raise DldsimError(f"table {kind}: columns {' and '.join(filter(None, parts))}.")
    return columns


def _array(kind: str, field: pa.Field, values: Any) -> pa.Array:
    """One checked Arrow column."""
    where = f"table {kind}, column {field.name}"
    is_series = hasattr(values, "to_numpy")
    try:
        array = pa.array(values, from_pandas=is_series)
        if isinstance(array, pa.ChunkedArray):
            array = array.combine_chunks()
        array = array.cast(field.type)
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise DldsimError(f"{where}: cannot be held as {field.type}: {error}") from error
    flat = array.flatten() if pa.types.is_list(field.type) else array
    if pa.types.is_floating(flat.type):
        bad = pc.indices_nonzero(pc.fill_null(pc.invert(pc.is_finite(flat)), False))
        if len(bad):
            row = bad[0].as_py()
            if flat is not array:
                row = pc.list_parent_indices(array)[row].as_py()
            value = array[row].as_py()
            value = value if isinstance(value, list) or math.isnan(value) else f"{value}"
            raise DldsimError(f"{where}, row {row}: {value} is not finite. Use null for a value "
                              "that was not measured.")
    nulls = array.null_count if not field.nullable else 0
    nulls += flat.null_count if flat is not array else 0
    if nulls:
        row = np.flatnonzero(array.is_null().to_numpy(zero_copy_only=False))
        raise DldsimError(f"{where}{f', row {row[0]}' if row.size else ''}: null in a column that "
                          "must have a value.")
    return array
