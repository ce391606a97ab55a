"""What an answer holds for: shape and radius of the cells, height of the channel, velocity."""

from collections.abc import Iterable

from dldsim.report.angle_figures import volume_equivalent_diameter

NAMES = {"biconcave": "biconcave discs", "sphere": "spheres", "ellipsoid": "oblate ellipsoids"}


def holds_for(shape: str, radii_um: Iterable[float], height_um: float, velocity_mm_s: float) -> str:
    """One sentence: cell, channel and mean velocity that designs hold for."""
    sizes = " and ".join(f"{radius:g}" for radius in dict.fromkeys(radii_um))
    channel = f"{height_um:g} µm high" if height_um else "without top or bottom"
    return (
        f"Holds for {NAMES[shape]} of radius {sizes} µm at rest in a channel {channel} at a "
        f"mean velocity of {velocity_mm_s:g} mm/s."
    )


def meaning_of_radius(shape: str, radius_um: float, aspect_ratio: float = 1.0) -> str:
    """What the word radius stands for, by example."""
    volume = volume_equivalent_diameter(shape, radius_um, aspect_ratio)
    cell = f"A cell “of radius {radius_um:g} µm” is"
    if shape == "sphere":
        return f"{cell} a deformable sphere {2 * radius_um:g} µm across."
    what = "a biconcave disc" if shape == "biconcave" else "an oblate ellipsoid"
    return (
        f"{cell} {what} of that radius, {2 * radius_um:g} µm across, not a bead: its volume is "
        f"that of a sphere of {volume:.1f} µm diameter."
    )
