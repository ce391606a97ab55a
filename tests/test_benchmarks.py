"""What the benchmarks compute from what they measure, and that the Slurm profile is complete."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from dldsim.config import campaign
from dldsim.config.presets import read_config
from dldsim.config.sections import Cell, Flow
from dldsim.experiments.array_scene import make_scene
from dldsim.solver.flow import solve_empty_array
from dldsim.solver.pillars import make_array
from dldsim.solver.time_step import lag_number

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import __main__ as bench  # noqa: E402
from benchmarks import campaign_cost, design_time, growth, kernels, outcome_cost  # noqa: E402

SPEED = campaign_cost.Speed(100.0, 200.0, 2.0, 10.0, 60.0, 30.0)


def test_power_law_is_recovered():
    x = np.array([1.0, 2.0, 5.0, 9.0])
    fit = growth.power(x, 3 * x**1.5)
    assert fit["exponent"] == pytest.approx(1.5)
    assert fit["factor"] == pytest.approx(3)
    assert fit["error"] == pytest.approx(0, abs=1e-12)
    noisy = growth.power(x, x * [1.1, 0.9, 1.1, 0.9])
    assert noisy["error"] > 0.01


def test_scene_is_parsed_with_defaults_for_what_is_left_out():
    geometry, numerics = kernels.parse_scene("0.67:0.75:1:6", "float64")
    assert (geometry.periodicity, numerics.rows, numerics.spacing_um) == (6, 1, 0.67)
    geometry, numerics = kernels.parse_scene("1.25:1", "float32")
    assert geometry == kernels.GEOMETRY
    assert (numerics.rows, numerics.lanes, numerics.images) == (2, 1, "aligned")
    found = numerics.spacing_um, numerics.edge_to_spacing, numerics.precision
    assert found == (1.25, 1, "float32")


@pytest.mark.parametrize("index", [0, 13, 35])
def test_predicted_scene_is_the_one_simulated(index):
    config = read_config(ROOT / "config.yaml", {"preset": "paper"})
    geometry = campaign.geometries(config)[index]
    array = make_array(geometry, Flow(**config.flow.model_dump()), config.numerics)
    flow, cell = Flow(**config.flow.model_dump()), Cell(**config.cell.model_dump())
    empty = solve_empty_array(geometry, flow, config.numerics)
    scene = make_scene(array, empty, config.stiffness_sets["1"], cell, flow, config.numerics)
    nodes, vertices, per_row = campaign_cost.scene_size(geometry, config)
    assert nodes == pytest.approx(array.lattice.nodes, rel=0.03)
    assert vertices == scene.vertices
    velocity = config.numerics.velocity_lu * config.numerics.reynolds_max / lag_number(scene)
    assert per_row == pytest.approx(array.pitch / velocity)


def test_slurm_does_all_the_work_and_more_nodes_are_not_slower():
    work = campaign_cost.Work(200, 1000, 50, 2.0, 10.0, 4.0, 100.0, 60.0, 3)
    costs = [campaign_cost.on_slurm(work, SPEED, n, 32, 8, 4) for n in (1, 2, 4)]
    assert all(c["core_h"] * 3600 >= work.core_s for c in costs)
    assert costs[0]["wall_h"] >= costs[1]["wall_h"] >= costs[2]["wall_h"]
    assert costs[0]["core_h_of_starts_batched"] < costs[0]["core_h_of_starts_single"]


def test_a_missed_target_says_so():
    met, missed = (bench.row("a ratio", value, 1.8, True) for value in (1.9, 1.7))
    lines = bench.text([met, missed]).splitlines()
    assert "MISSED" not in lines[0] and lines[1].endswith("MISSED")


def test_cost_is_that_of_decided_outcomes():
    outcome = {"outcome": "a", "mode": "bump", "releases": 2, "rows": 40, "without_s": 30.0}
    results = [
        outcome | {"decided": True, "now_s": 6.0},
        outcome | {"decided": False, "now_s": 9.0},
    ]
    last = outcome_cost.table(results).splitlines()[-1]
    assert last == "1 of 2 decided: 15.0 s for each, without 60.0 s, ratio 4.00"


def test_time_of_an_answer_is_that_of_all_threads_of_its_process(tmp_path):
    spin = (
        "import threading, time, os; end = lambda: [None for _ in iter(lambda: time.thread_time()"
        " > 0.15, True)]; t = [threading.Thread(target=end) for _ in range(2)];"
        "[x.start() for x in t]; [x.join() for x in t]; assert 'OMP_NUM_THREADS' not in os.environ"
    )
    found = design_time.measure([sys.executable, "-c", spin], tmp_path)
    assert found["cpu_s"] > 0.29
    with pytest.raises(subprocess.CalledProcessError):
        design_time.measure([sys.executable, "-c", "raise SystemExit(2)"], tmp_path)


def test_requests_of_the_benchmark_are_commands():
    from dldsim.app import cli

    for words in design_time.REQUESTS.values():
        cli.make_parser().parse_args(words)


def test_growth_figure_is_drawn():
    points = {
        name: [
            {
                "nodes": 1e4 * k,
                "vertices": 300.0 * k,
                "periodicity": 4.0 * k,
                "resolution": 10.0 * k,
                "steps_per_row": 900.0 * k,
                "step_us": 150.0 * k,
                "fluid_us": 100.0 * k,
                "peak_MB": 250.0 + k,
                "more_MB": 10.0 * k,
            }
            for k in (1, 2, 4)
        ]
        for name in growth.SWEEPS
    }
    result = {"points": points, "fits": growth.fits(points), "two": "not measured"}
    assert result["fits"]["fluid step against nodes"]["exponent"] == pytest.approx(1)
    assert result["fits"]["a row against λ/Δx"]["exponent"] == pytest.approx(2)
    assert growth.render(growth.draw(result), "png").startswith(b"\x89PNG")
    assert "not measured" in growth.table(result)


def test_every_rule_of_the_campaign_has_its_batch_on_slurm():
    rules = set()
    for part in ("simulate", "calibrate", "analyse", "design", "report"):
        text = (ROOT / "workflow" / "rules" / f"{part}.smk").read_text(encoding="utf-8")
        rules |= set(re.findall(r"^rule (\w+):", text, re.MULTILINE))
    profile = yaml.safe_load((ROOT / "profiles/slurm/config.yaml").read_text(encoding="utf-8"))
    assert {entry.split("=")[0] for entry in profile["groups"]} == rules
    assert "attempt" in str(profile["default-resources"]) and profile["retries"]
