"""Tables of what leaves a device, predicted and simulated; parts of the answer to a request."""

from dldsim.tables.column import Column, count, flag, optional, real, table, text


def _with_interval(name: str, unit: str, description: str) -> tuple[Column, ...]:
    """Median over the devices, and both ends of the 90 % interval."""
    return (
        real(name, unit, description),
        real(f"{name}_low", unit, "lower end of its 90 % interval over the draws of the array"),
        real(f"{name}_high", unit, "upper end of it"),
    )


REQUEST = (
    text("request", "name of the design request"),
    text("device", "name of the design"),
    count("stage", "1, or 2: fed by an outlet of stage 1"),
)
POPULATION = count("population", "cell type, 1 or 2")

TABLES = {
    "device_outcomes": table(
        None,
        None,
        *REQUEST,
        POPULATION,
        text("outlet", "outlet that collects it: lower or upper, by the wall at cut_um"),
        *optional(
            *_with_interval(
                "purity", "1", "share of this type among the cells of that outlet, where any arrive"
            ),
            *_with_interval(
                "recovery",
                "1",
                "share of the cells of this type that leave there, of draws that any enter",
            ),
            *_with_interval(
                "enrichment", "1", "purity over share of this type in the first sample"
            ),
            *_with_interval("lost", "1", "share of this type that needs more width than the gap"),
        ),
        real("recovery_of_sample", "1", "recovery over all stages so far, median"),
        real("share_bump", "1", "share of the drawn cells that bump"),
        real("share_mixed", "1", "share of the drawn cells in mixed mode"),
        real("share_zigzag", "1", "share of the drawn cells that zigzag"),
        real("extrapolated", "1", "share of the drawn cells outside what was learnt"),
        real("radius_mean_um", "µm", "mean radius of the drawn cells"),
        real("radius_99_um", "µm", "radius that one cell in a hundred exceeds"),
        real("ks_mean_uN_per_m", "µN/m", "geometric mean of k_s of the drawn cells"),
        real("cut_um", "µm", "middle of the wall between the outlets above the lower side wall"),
        *optional(
            real(
                "purity_recovery",
                "1",
                "smallest purity or recovery, exceeded by nine of ten draws that both types enter",
            ),
            *_with_interval("value", "1", "smallest of both purities and both recoveries"),
            *_with_interval(
                "length_90_mm", "mm", "length at which it first is 90 % of that; null: never grows"
            ),
            *_with_interval(
                "length_95_mm", "mm", "length at which it first is 95 % of that; null: never grows"
            ),
        ),
        real("array_length_mm", "mm", "length of the array, whole rows"),
        real("array_width_mm", "mm", "width of the array, whole lanes"),
        real("sample_uL_per_h", "µL/h", "flow of the sample stream"),
        text("basis", "what the motion rests on: predicted, or simulated in this array"),
    ),
    "device_outlets": table(
        None,
        None,
        *REQUEST,
        count("outlet", "number of the outlet from the lower side wall"),
        real("low_um", "µm", "middle of its lower wall above the lower side wall"),
        real("high_um", "µm", "middle of its upper wall"),
        count("collects", "cell type that it is meant for, after the wall at cut_um"),
        *optional(
            *_with_interval(
                "cells_1", "1", "share of the entering cells of type 1 that leave here"
            ),
            *_with_interval(
                "cells_2", "1", "share of the entering cells of type 2 that leave here"
            ),
            *_with_interval(
                "purity_1", "1", "share of type 1 among the cells that leave here, where any do"
            ),
        ),
    ),
    "device_positions": table(
        None,
        None,
        *REQUEST,
        POPULATION,
        real("x_mm", "mm", "length of array passed"),
        real("y_05_um", "µm", "place above the lower side wall that 5 % of the cells are below"),
        real("y_25_um", "µm", "that 25 % are below"),
        real("y_50_um", "µm", "that half are below"),
        real("y_75_um", "µm", "that 75 % are below"),
        real("y_95_um", "µm", "that 95 % are below"),
        *optional(
            *_with_interval("value", "1", "smallest purity or recovery with the best cut here")
        ),
    ),
    "device_exits": table(
        None,
        None,
        *REQUEST,
        POPULATION,
        real("low_um", "µm", "lower end of the interval above the lower side wall"),
        real("high_um", "µm", "upper end of it"),
        real("cells", "1", "share of the entering cells of this type that leave there, mean"),
        real("cells_low", "1", "lower end of its 90 % interval over the draws of the array"),
        real("cells_high", "1", "upper end of it"),
    ),
    "device_checks": table(
        None,
        None,
        *REQUEST,
        POPULATION,
        count("simulated", "simulated cells that count"),
        count("own", "of these, cells that leave by the outlet that collects them"),
        count("lost", "of these, cells that leave by none"),
        count("open", "of these, cells that had not settled when the rows were spent"),
        count("failed", "cells that could not be simulated"),
        *_with_interval("predicted", "1", "recovery as predicted for the nominal array"),
        real("recovery", "1", "simulated recovery"),
        real("recovery_low", "1", "lower end of its 90 % interval (Clopper–Pearson)"),
        real("recovery_high", "1", "upper end of it"),
        real("chance_outlet", "1", "chance of such a count or a less likely one by the prediction"),
        real("chance_exit", "1", "chance that as many exits are as unlike the predicted ones"),
        flag("agrees", "neither chance is below 0.05"),
    ),
    "checked_cells": table(
        None,
        None,
        *REQUEST,
        count("cell", "number of the cell"),
        POPULATION,
        real("radius_um", "µm", "radius of the cell"),
        real("ks_uN_per_m", "µN/m", "edge spring constant k_s"),
        real("start_um", "µm", "place of entry above the lower side wall"),
        real("release_gap_fraction", "1", "centre above the lower pillar at release / P_g"),
        text("status", "how the run ended"),
        text("mode", "bump, zigzag, mixed or none"),
        *optional(
            count("rows_completed", "rows simulated"),
            real("exit_um", "µm", "where it leaves the array above the lower side wall"),
        ),
    ),
}
