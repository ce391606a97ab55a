"""Tables of the assays and of the calibrations."""

from dldsim.tables.column import (
    COST,
    DRIFT,
    POSITION,
    PROCESSOR,
    RATIOS,
    RUN_ID,
    SPRINGS,
    STATUS,
    count,
    flag,
    optional,
    real,
    table,
    text,
)

ASSAY = text("assay", "name of the assay")
SETTINGS = (
    text("kind", "how it measures: constriction, channel, shear, or table for published pairs"),
    text("cell_shape", "rest shape; empty: the publication does not say"),
    real("cell_radius_um", "µm", "largest radius of the rest shape", True),
    text("group", "membrane: a constriction group, a stiffness set, or one between sets"),
    text("stiffness_set", "stiffness set that it stands for; empty: none"),
    *SPRINGS,
    real("velocity_mm_s", "mm/s", "mean velocity, of a constriction's wide channel", True),
    real("shear_stress_Pa", "Pa", "of the liquid between moving plates", True),
    real("viscosity_mPa_s", "mPa·s", "dynamic viscosity of the liquid", True),
)
RESULTS = optional(
    real(
        "deformation_index",
        "1",
        "(a − b)/(a + b) of the box seen along z, mid-throat or once steady; in shear "
        "(L − W)/(L + W), L along the flow",
    ),
    real("circularity_index", "1", "1 − 2 √(π A)/P of the outline, at the same place"),
    real("diameter_d_um", "µm", "extent along the flow there"),
    real("diameter_h_um", "µm", "extent across the flow there"),
)

TABLES = {
    "assay_runs": table(
        "assay_runs.parquet",
        "assays",
        RUN_ID,
        ASSAY,
        *SETTINGS,
        text("varied", "in what it differs from the first: release, offset, size, orientation"),
        real("release_position_um", "µm", "release along a slit, from the first possible position"),
        real("offset_um", "µm", "release off the axis, across the picture"),
        real("radius_factor", "1", "size / cell_radius_um"),
        text("axis", "direction of the cell's symmetry axis at release"),
        *STATUS,
        *RESULTS,
        *optional(
            real("deformation_index_max", "1", "largest on the way"),
            real("index_change", "1", "change of the index that was left when it was steady"),
        ),
        *COST,
        PROCESSOR,
        real("capillary_number", "1", "μU/k_s; in shear U = rate · R; null for k_s = 0", True),
        *DRIFT,
    ),
    "assay_trajectory": table(
        None,
        None,
        *POSITION,
        real("deformation_index", "1", "(a − b)/(a + b) of the box, or (L − W)/(L + W)"),
        real("circularity_index", "1", "1 − circularity of the outline"),
        real("diameter_d_um", "µm", "extent along the flow"),
        real("diameter_h_um", "µm", "extent across the flow"),
        *RATIOS,
    ),
    "calibration": table(
        "calibration.parquet",
        "calibration",
        text("assay", "name of the assay; of a channel's 1 − circularity: with -circularity"),
        flag("default", "the campaign's assay, whose index the outcomes have"),
        *SETTINGS,
        text("index", "what the index is"),
        text("label", "where it comes from, if not from simulations"),
        count("runs", "passages with an index"),
        *optional(
            real("deformation_index", "1", "mean over passages; of published pairs: as printed"),
            real("deformation_index_std", "1", "scatter of all causes, added in squares"),
            real("std_release", "1", "standard deviation over the releases along a slit"),
            real("std_offset", "1", "standard deviation over the releases on and off the axis"),
            real("std_size", "1", "standard deviation over the sizes"),
            real("std_orientation", "1", "standard deviation over the orientations"),
            real("deformation_index_min", "1", "least over the passages"),
            real("deformation_index_max", "1", "largest over the passages"),
            real("coefficient_of_variation", "1", "standard deviation / index"),
            real(
                "resolving_power",
                "1",
                "change of the index to the next stiffer membrane / pooled standard deviation",
            ),
            real(
                "resolving_power_all",
                "1",
                "change from the softest to the stiffest / pooled standard deviation",
            ),
        ),
    ),
    "calibration_correlations": table(
        "calibration_correlations.parquet",
        "calibration",
        ASSAY,
        text("variable_a", "column name"),
        text("variable_b", "column name"),
        real("pearson_r", "1", "Pearson correlation; null if a variable is constant", True),
        count("n", "passages compared"),
    ),
}
TABLES["calibration_library"] = TABLES["calibration"]._replace(
    file="calibration_library.parquet", rule="calibration_library"
)
TABLES["assay_study"] = TABLES["calibration"]._replace(
    file="assay_study.parquet", rule="assay_study"
)
