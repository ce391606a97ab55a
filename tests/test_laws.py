"""Formulae against numbers computed otherwise; each has one home."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from dldsim import laws
from dldsim.config.sections import Geometry
from dldsim.solver import mesh

PACKAGE = Path(laws.__file__).parent


@pytest.mark.parametrize(
    "formula",
    [
        r"\*\* ?-?0\.48",
        r"- 0\.5\) ?/ 3\b",
        r"0\.207161",
        r"134\.1",
        r"94\.1 /",
        r"\(\"converged\", \"periodic\"",
        r"\(STUCK, UNSTABLE, \"failed\"\)",
    ],
)
def test_a_fact_has_one_home(formula):
    homes = [
        path.name
        for path in PACKAGE.rglob("*.py")
        if re.search(formula, path.read_text(encoding="utf-8"))
    ]
    assert homes in (["laws.py"], ["vocabulary.py"], [])
    assert len(homes) == 1 or formula.startswith("94")


def test_critical_diameter_takes_numbers_and_arrays():
    assert laws.critical_diameter(20.0, 1 / 8) == pytest.approx(
        20 * 1.4 * math.exp(0.48 * math.log(0.125))
    )
    found = laws.critical_diameter(np.array([10.0, 20.0]), np.array([0.1, 0.05]))
    np.testing.assert_allclose(found, [4.636, 6.647], rtol=1e-3)


@pytest.mark.parametrize(
    ("shape", "ratio"), [("sphere", 1.0), ("ellipsoid", 0.4), ("biconcave", 1.0)]
)
def test_volume_and_area_are_those_of_the_mesh(shape, ratio):
    x, faces = mesh.make_shape(shape, 1.0, 24, ratio)
    assert 4 / 3 * math.pi * laws.rest_volume(shape, ratio) == pytest.approx(
        mesh.volume(x, faces), rel=0.005
    )
    assert laws.rest_area(shape, ratio) == pytest.approx(mesh.area(x, faces), rel=0.02)


def test_pillars_stand_on_the_shifted_lattice():
    assert laws.pillar_centres(10.0, 2.5, 0, -1.0, 21.0) == [(0.0, 0.0), (0.0, 10.0), (0.0, 20.0)]
    assert laws.pillar_centres(10.0, 2.5, 4, 0.0, 9.0) == [(40.0, 0.0)]
    assert laws.pillar_centres(10.0, 2.5, -1, -3.0, 0.0) == [(-10.0, -2.5)]


def test_the_row_shift_is_whole_and_the_throat_even():
    geometry = Geometry(pillar_radius_um=6, gap_um=18, periodicity=8)
    spacing, nodes = laws.whole_shift_spacing(geometry, 1.25)
    assert spacing * nodes * 8 == pytest.approx(30) and spacing <= 1.25 * laws.COARSER_ALLOWED
    spacing, nodes = laws.even_throat(8.0, 1.3)
    assert nodes % 2 == 0 and spacing * nodes == pytest.approx(8) and spacing <= 1.3
