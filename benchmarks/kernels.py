"""Speed of every kernel of a time step, beside what this core can do.

``python -m benchmarks.kernels [--json] [--precision float64] [--scene 1.25:1:2:8] [--box 96]``

Times are processor time of the one thread (medians over rounds in which all parts take turns), so
that other jobs on the machine disturb them little. Limits of the core are measured beside: a triad
a = b + s c on arrays as large together as those of the scene, and chains of multiply-adds.
"""

import argparse
import ast
import inspect
import json
import sys
import textwrap
import time
from collections.abc import Callable

import numba
import numpy as np

from dldsim.config.sections import Cell, Flow, Geometry, Numerics, Stiffness
from dldsim.experiments.array_scene import make_scene
from dldsim.solver import collide, contact, immersed_boundary, lattice, membrane_forces
from dldsim.solver.flow import Fluid, solve_empty_array
from dldsim.solver.jit import aligned_zeros, restrict
from dldsim.solver.pillars import make_array
from dldsim.solver.scene import CellInFlow

GEOMETRY = Geometry(pillar_radius_um=6, gap_um=16, periodicity=8)
STIFFNESS = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)
EXTENT = "nx", "ny", "nz"
SCENES = ["1.25:1:2:8", "0.67:0.8:1:6"]
"""Two rows of the default array, as many nodes as by default; and 42×42×30 nodes with about 2000
vertices."""
WARM_UP = 500
"""Steps in which the cell deforms before anything is measured."""


def median_times(parts: dict[str, Callable[[int], None]], rounds: int) -> dict[str, float]:
    """Seconds per repetition of each part, called as part(repetitions); about 20 ms a turn."""
    repetitions, times = {}, {name: [] for name in parts}
    for name, part in parts.items():
        part(2)
        start = time.thread_time()
        part(10)
        repetitions[name] = 2 * max(1, round(0.1 / max(time.thread_time() - start, 1e-6)))
    for _ in range(rounds):
        for name, part in parts.items():
            start = time.thread_time()
            part(repetitions[name])
            times[name].append((time.thread_time() - start) / repetitions[name])
    return {name: float(np.median(t)) for name, t in times.items()}


# ------------------------------------------------------------------ limits of the core


@restrict
def _triad(repetitions, a, b, c, scale):
    for _ in range(repetitions):
        for i in range(len(a)):
            a[i] = b[i] + scale * c[i]
        scale += scale


@restrict
def _chain(x, b, c):
    return (((x * b + c) * b + c) * b + c) * b + c


@restrict
def _multiply_add(repetitions, a, b, c):
    for _ in range(repetitions):
        for i in range(len(a)):
            a[i] = _chain(_chain(_chain(_chain(a[i], b, c), b, c), b, c), b, c)


def core_limits(size: int, dtype, rounds: int) -> dict[str, float]:
    """Bandwidth [GB/s] of a triad over ``size`` bytes, and additions and products [GFLOP/s]."""
    one = np.dtype(dtype).type
    a, b, c = (aligned_zeros(size // 3 // np.dtype(dtype).itemsize, dtype) for _ in range(3))
    few = aligned_zeros(1024, dtype)
    times = median_times(
        {
            "triad": lambda n: _triad(n, a, b, c, one(1e-30)),
            "multiply-add": lambda n: _multiply_add(n, few, one(0.5), one(0.25)),
        },
        rounds,
    )
    return {
        "triad_GB_per_s": 3 * a.nbytes / times["triad"] / 1e9,
        "multiply_add_GFLOP_per_s": 2 * 16 * len(few) / times["multiply-add"] / 1e9,
    }


def operations_per_update() -> int:
    """Additions and products of one collision without inertia, counted in its source."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(collide.collide.py_func)))
    loop = next(node for node in ast.walk(tree) if isinstance(node, ast.For))

    def count(nodes) -> int:
        total = 0
        for node in nodes:
            if isinstance(node, ast.If):  # with inertia
                continue
            values = [n for n in ast.walk(node) if isinstance(n, ast.BinOp)]
            inside = [
                n
                for v in ast.walk(node)
                if isinstance(v, ast.Subscript)
                for n in ast.walk(v.slice)
                if isinstance(n, ast.BinOp)
            ]
            total += len(values) - len(inside)
        return total

    return count(loop.body)


def bytes_per_update(dtype) -> int:
    """Populations read and written where they were read (see dldsim.solver.stream_collide)."""
    return 2 * 19 * np.dtype(dtype).itemsize


# ------------------------------------------------------------------ scenes


def parse_scene(text: str, precision: str) -> tuple[Geometry, Numerics]:
    """spacing [µm]:edge/spacing[:rows[:N_p]], of two rows of the default array where left out."""
    spacing, edge, *more = text.split(":")
    rows, periodicity = [*map(int, more), *(2, GEOMETRY.periodicity)[len(more) :]]
    numerics = Numerics(
        precision=precision,
        spacing_um=float(spacing),
        edge_to_spacing=float(edge),
        rows=rows,
        lanes=1,
        images="aligned",
    )
    return GEOMETRY.model_copy(update={"periodicity": periodicity}), numerics


def unit_cell(geometry: Geometry, numerics: Numerics) -> CellInFlow:
    """A cell in the unit cell of an array, with pillars, walls and shifted periodicity."""
    flow = Flow()
    scene = make_scene(
        make_array(geometry, flow, numerics),
        solve_empty_array(geometry, flow, numerics),
        STIFFNESS,
        Cell(),
        flow,
        numerics,
    )
    scene.advance(WARM_UP)
    return scene


def empty_box(cells: tuple[int, int, int], precision: str) -> Fluid:
    """A periodic box without solids, moved by a body force."""
    dtype = np.dtype(precision)
    box = lattice.make_lattice(np.zeros(cells[:2], bool), cells[2], walls=False, dtype=dtype)
    fluid = Fluid.of(box, Numerics(precision=precision))
    fluid.set_body_force((1e-6, 0.0, 0.0))
    return fluid


def fluid_arrays(fluid: Fluid) -> int:
    """Bytes of the populations."""
    return fluid.f.nbytes


def repeated(kernel, *arguments) -> Callable[[int], None]:
    """The kernel in a compiled loop."""

    @numba.njit(error_model="numpy")
    def loop(repetitions, arguments):
        for _ in range(repetitions):
            kernel(*arguments)

    return lambda repetitions: loop(repetitions, arguments)


def cell_parts(scene: CellInFlow) -> dict[str, Callable[[int], None]]:
    """Every part of a step by itself; the scene stays as it is."""
    fluid, body = scene.fluid, scene.body
    x, v, total = body.x.copy(), body.smooth.copy(), body.force.copy()
    density, answer, near = np.zeros_like(fluid.force), np.zeros_like(x), fluid.near.copy()
    return {
        "membrane": repeated(
            membrane_forces.elastic_forces, x, v, scene.membrane, scene.moduli, scene.scratch, total
        ),
        "contact": repeated(contact.contact_forces, x, scene.contact, answer),
        "locate": repeated(immersed_boundary.locate, x, scene.domain, scene.stencil),
        "clear force": repeated(immersed_boundary.clear, density, near),
        "surround": repeated(immersed_boundary.surround, scene.domain, scene.stencil, near),
        "spread": repeated(immersed_boundary.spread, total * 1e-9, scene.stencil, density),
        "interpolate": repeated(
            immersed_boundary.interpolate, fluid.velocity, fluid.force, 0.5, scene.stencil, answer
        ),
    }


def without_cell(scene: CellInFlow) -> Fluid:
    """The fluid of a scene once more, by itself."""
    fluid = scene.fluid
    alone = Fluid(fluid.lattice, fluid.relaxation_time, fluid.collision, fluid.inertia, fluid.dtype)
    alone.f[:] = fluid.f
    alone.set_body_force(fluid.body_force)
    return alone


def measure_cell(geometry: Geometry, numerics: Numerics, rounds: int) -> dict:
    """Times [µs] of the parts of a step, and of the step as a whole, in one unit cell."""
    scene = unit_cell(geometry, numerics)
    fluid, alone = scene.fluid, without_cell(scene)
    parts = {"step": scene.advance, "fluid": alone.advance, **cell_parts(scene)}
    times = {name: 1e6 * t for name, t in median_times(parts, rounds).items()}
    return {
        "scene": "unit cell {}×{}×{}".format(*(getattr(fluid.lattice, n) for n in EXTENT)),
        "precision": numerics.precision,
        "nodes": fluid.lattice.nodes,
        "vertices": scene.vertices,
        "us": times,
        "cell_over_fluid": times["step"] / times["fluid"] - 1,
        "ns_per_vertex": {n: 1e3 * times[n] / scene.vertices for n in cell_parts(scene)},
        **rates(fluid, times["fluid"], rounds),
    }


def measure_box(cells: tuple[int, int, int], precision: str, rounds: int) -> dict:
    """Time [µs] of a step of the fluid alone in an empty box."""
    fluid = empty_box(cells, precision)
    us = 1e6 * median_times({"fluid": fluid.advance}, rounds)["fluid"]
    return {
        "scene": "box " + "×".join(map(str, cells)),
        "precision": precision,
        "nodes": fluid.lattice.nodes,
        "us": {"fluid": us},
        **rates(fluid, us, rounds),
    }


def rates(fluid: Fluid, us: float, rounds: int) -> dict[str, float]:
    """Lattice updates, and the shares of the core's limits that they take."""
    updates = fluid.lattice.nodes / us * 1e6
    limits = core_limits(fluid_arrays(fluid), fluid.dtype, rounds)
    traffic = updates * bytes_per_update(fluid.dtype) / 1e9
    operations = updates * operations_per_update() / 1e9
    return {
        "mlups": updates / 1e6,
        "bytes_per_update": bytes_per_update(fluid.dtype),
        "operations_per_update": operations_per_update(),
        **limits,
        "share_of_bandwidth": traffic / limits["triad_GB_per_s"],
        "share_of_arithmetic": operations / limits["multiply_add_GFLOP_per_s"],
    }


def table(results: list[dict]) -> str:
    """The results as text."""
    lines = []
    for r in results:
        cell = f", {r['vertices']} vertices" if "vertices" in r else ""
        lines += [
            f"{r['scene']}, {r['nodes']:,} fluid nodes{cell}, {r['precision']}",
            f"  fluid {r['mlups']:.1f} MLUPS; {r['bytes_per_update']} bytes and "
            f"{r['operations_per_update']} operations per update",
            f"  {r['share_of_bandwidth']:.0%} of the triad's {r['triad_GB_per_s']:.0f} GB/s, "
            f"{r['share_of_arithmetic']:.0%} of the {r['multiply_add_GFLOP_per_s']:.0f} GFLOP/s "
            "of multiply-adds",
        ]
        for name, us in r["us"].items():
            per = r.get("ns_per_vertex", {}).get(name)
            lines.append(
                f"  {name:<12}{us:10.2f} µs" + (f"{per:8.1f} ns per vertex" if per else "")
            )
        if "cell_over_fluid" in r:
            lines.append(f"  the cell costs {r['cell_over_fluid']:.0%} of the fluid")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="one JSON list instead of a table")
    parser.add_argument("--precision", nargs="+", default=["float32", "float64"])
    parser.add_argument(
        "--scene",
        nargs="*",
        default=SCENES,
        help="unit cells, each as lattice spacing [µm]:membrane edge over spacing[:rows[:N_p]]",
    )
    parser.add_argument("--box", nargs="*", type=int, default=[96], help="cubes' edges in nodes")
    parser.add_argument("--rounds", type=int, default=15)
    given = parser.parse_args()
    results = [
        measure_cell(*parse_scene(scene, precision), given.rounds)
        for precision in given.precision
        for scene in given.scene
    ]
    results += [
        measure_box((n, n, n), precision, max(3, given.rounds // 3))
        for precision in given.precision
        for n in given.box
    ]
    sys.stdout.write(json.dumps(results, indent=1) + "\n" if given.json else table(results))


if __name__ == "__main__":
    main()
