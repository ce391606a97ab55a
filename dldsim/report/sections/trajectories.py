"""Trajectories: typical paths over the pillars, and all runs at once."""

from dldsim.report import trajectory_figures
from dldsim.report.page import Page


def contents(page: Page) -> dict | None:
    runs = page["runs"]
    tracks = page["trajectory"] if "trajectory" in page else None
    picked = (
        []
        if tracks is None
        else [
            (heading, ids)
            for heading, ids in trajectory_figures.pick_trajectories(runs)
            if set(ids) <= set(tracks["run_id"])
        ]
    )
    panels = [
        trajectory_figures.trajectory_panel(heading, ids, runs, tracks) for heading, ids in picked
    ]
    moved = (runs["rows_completed"] > 0).any()
    if not panels and not moved:
        return None
    return {
        "with_tracks": tracks is not None,
        "modes_without": [m for m in ("bump", "zigzag") if not (runs["mode"] == m).any()],
        "paths": page.figure(
            "trajectories", trajectory_figures.draw_trajectories(panels), ["trajectory", "runs"]
        )
        if panels
        else None,
        "all_runs": page.figure(
            "all_runs",
            trajectory_figures.draw_all_runs(runs, tracks),
            ["runs"] if tracks is None else ["runs", "trajectory"],
        )
        if moved
        else None,
    }
