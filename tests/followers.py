"""Stiff spheres of the survey, and heights of a channel, beside point-like followers of the flow.

`python -m tests.followers` solves the flows again, which takes a minute or two, and prints what
docs/trust.md says of them.
"""

import sys
from collections.abc import Iterator

from dldsim.analysis.learning import SURVEY
from dldsim.config.sections import Flow, Geometry, Numerics
from dldsim.experiments.streamlines import critical_follower
from dldsim.laws import critical_diameter
from dldsim.solver.flow import solve_empty_array
from dldsim.tables.numerics import settings_of
from dldsim.tables.parquet import read_rows

STIFF = 0.03
"""Capillary number up to which spheres are taken for stiff."""
HEIGHTS = 0.1, 0.25, 0.5
GAP_UM = 20.0


def spheres() -> Iterator[tuple[float, float, dict]]:
    """Diameter over that of the follower and over that of the law, and the outcome."""
    for row in read_rows("outcomes", SURVEY):
        if row["cell_shape"] != "sphere" or row["capillary_number"] > STIFF:
            continue
        geometry = Geometry(**{name: row[name] for name in Geometry.model_fields})
        flow = Flow(height_um=row["height_um"])
        follower = critical_follower(
            solve_empty_array(geometry, flow, Numerics(**settings_of(row)))
        )
        over_gap = 2 * row["cell_radius_um"] / row["gap_um"]
        if follower:
            yield over_gap / follower, over_gap / critical_diameter(1, 1 / row["periodicity"]), row


def heights(periodicity: int) -> list[float]:
    """Diameters of followers at `HEIGHTS` over that midway; pillars as wide as the gap, the channel
    as high."""
    geometry = Geometry(pillar_radius_um=GAP_UM / 2, gap_um=GAP_UM, periodicity=periodicity)
    numerics = Numerics(spacing_um=GAP_UM / 20)
    flow = solve_empty_array(geometry, Flow(height_um=GAP_UM), numerics)
    found = [critical_follower(flow, height) for height in HEIGHTS]
    return [diameter / found[-1] for diameter in found]


def lines() -> Iterator[str]:
    yield "2R/follower  2R/law  height/gap  radius/gap  N_p     Ca   angle  mode, distance, status"
    for beside_follower, beside_law, row in sorted(spheres(), key=lambda found: found[0]):
        gap, angle, distance = row["gap_um"], row["migration_angle_deg"], row["transition_distance"]
        yield (
            f"{beside_follower:11.2f} {beside_law:7.2f} {row['height_um'] / gap:11.2f} "
            f"{row['pillar_radius_um'] / gap:11.2f} {row['periodicity']:4d} "
            f"{row['capillary_number']:6.3f} {'–' if angle is None else f'{angle:.2f}':>7}  "
            f"{row['mode']}, {'–' if distance is None else f'{distance:+.3f}'}, {row['status']}"
        )
    for periodicity in (6, 10, 16):
        said = (f"{h:g}: {d:.3f}" for h, d in zip(HEIGHTS, heights(periodicity), strict=True))
        yield f"N_p {periodicity}, diameter at a height over that midway: {', '.join(said)}"


if __name__ == "__main__":
    for line in lines():
        sys.stdout.write(f"{line}\n")
