"""The fluid against lbmpy, which generates C for the same scheme.

``python -m benchmarks.peers [--json] [--precision float32] [--box 96]``

D3Q19, two relaxation times, uniform force (Guo), linear equilibrium on our side and the
incompressible one on theirs, one thread, the same number of nodes, both in turns in one process.
Ours also on a unit cell with its pillars, walls and shifted periodicity; lbmpy's box of the same
extent is periodic and empty. Needs lbmpy, py-cpuinfo and a C++ compiler (see README.md).
"""

import argparse
import json
import sys
from collections.abc import Callable

import numpy as np

from benchmarks.kernels import GEOMETRY, empty_box, median_times
from dldsim.config.sections import Flow, Numerics
from dldsim.solver.flow import Fluid
from dldsim.solver.pillars import make_array


def lbmpy_step(cells: tuple[int, int, int], precision: str) -> Callable[[int], None]:
    """Steps of lbmpy's vectorised kernel on arrays with ghost layers, periodic copies left out."""
    try:
        import pystencils
        from lbmpy import (
            ForceModel,
            LBMConfig,
            LBMOptimisation,
            LBStencil,
            Method,
            Stencil,
            create_lb_update_rule,
        )
    except ImportError as error:
        raise SystemExit(
            f"lbmpy is not installed ({error}): nothing to compare with. "
            "Install it as benchmarks/README.md says."
        ) from error
    source, target = pystencils.fields(f"source(19), target(19): {precision}[3D]", layout="fzyx")
    rule = create_lb_update_rule(
        lbm_config=LBMConfig(
            stencil=LBStencil(Stencil.D3Q19),
            method=Method.TRT,
            relaxation_rates=[0.8, 1.2],
            force=(1e-6, 0, 0),
            force_model=ForceModel.GUO,
            compressible=False,
            zero_centered=True,
        ),
        lbm_optimisation=LBMOptimisation(symbolic_field=source, symbolic_temporary_field=target),
    )
    config = pystencils.CreateKernelConfig(
        target=pystencils.Target.CurrentCPU, default_dtype=precision
    )
    config.cpu.vectorize.enable = True
    config.cpu.vectorize.assume_inner_stride_one = True
    kernel = pystencils.create_kernel(rule, config).compile()
    a, b = (np.zeros([n + 2 for n in cells] + [19], precision, order="F") for _ in range(2))

    def advance(steps: int) -> None:
        for _ in range(steps // 2):
            kernel(source=a, target=b)
            kernel(source=b, target=a)

    return advance


def compare(cells: tuple[int, int, int], precision: str, ours: Fluid, name: str, rounds: int):
    """MLUPS of both on one scene; those of lbmpy over all nodes of its box."""
    us = median_times({"dldsim": ours.advance, "lbmpy": lbmpy_step(cells, precision)}, rounds)
    mlups = {"dldsim": ours.lattice.nodes / us["dldsim"], "lbmpy": np.prod(cells) / us["lbmpy"]}
    return {
        "scene": name,
        "precision": precision,
        "cells": cells,
        "nodes": ours.lattice.nodes,
        "mlups": {code: float(rate / 1e6) for code, rate in mlups.items()},
        "ratio": float(mlups["dldsim"] / mlups["lbmpy"]),
    }


def measure(precisions, boxes, rounds: int) -> list[dict]:
    """The default unit cell, an empty box of its extent, and cubes."""
    results = []
    for precision in precisions:
        numerics = Numerics(precision=precision)
        array = make_array(GEOMETRY, Flow(), numerics).lattice
        fluid = Fluid.of(array, numerics)
        fluid.set_body_force((1e-6, 0.0, 0.0))
        extent = (array.nx, array.ny, array.nz)
        results.append(compare(extent, precision, fluid, "unit cell", rounds))
        for cells in (extent, *((n, n, n) for n in boxes)):
            name = "box " + "×".join(map(str, cells))
            results.append(compare(cells, precision, empty_box(cells, precision), name, rounds))
    return results


def table(results: list[dict]) -> str:
    """The results as text."""
    return "".join(
        f"{r['scene']:<14} {r['precision']}: dldsim {r['mlups']['dldsim']:6.1f}, "
        f"lbmpy {r['mlups']['lbmpy']:6.1f} MLUPS, ratio {r['ratio']:.2f}\n"
        for r in results
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="one JSON list instead of a table")
    parser.add_argument("--precision", nargs="+", default=["float32", "float64"])
    parser.add_argument("--box", nargs="*", type=int, default=[96], help="cubes' edges in nodes")
    parser.add_argument("--rounds", type=int, default=11)
    given = parser.parse_args()
    results = measure(given.precision, given.box, given.rounds)
    sys.stdout.write(json.dumps(results, indent=1) + "\n" if given.json else table(results))


if __name__ == "__main__":
    main()
