"""A surrogate by formula, and searches on it."""

import numpy as np

from dldsim.analysis.domain import DOMAIN_TOLERANCE, Domain
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.sections import Flow, Stiffness
from dldsim.design.chip import Chip
from dldsim.design.populations import flow_of, make_populations
from dldsim.design.search import regret, search
from dldsim.design.task import Task

SOFT = Stiffness(
    ks_uN_per_m=5.0,
    kb_pN_um=0.1,
    kal_uN_per_m=10.0,
    kag_uN_per_m=500.0,
    kv_Pa=900.0,
    kvisc_nN_s_per_m=1.5,
)


class Known:
    """A surrogate with the interface of the real one and a formula for an angle [deg].

    The formula is asked with P_r, P_g, N_p, Ca and the cell's radius.
    """

    domains = {"biconcave": Domain(np.array([[0.1, 0.1, 2], [9, 9, 99]]), (0.3, 0.9), (0.1, 5))}
    card = {"numerical_uncertainty": {"share_by_mode": {}}, "data": {"survey": None}}

    def __init__(self, angle, half=0.1, outside=lambda r, g, n: 0.0, sigma=None):
        self.angle, self.half, self.outside, self.sigma = angle, half, outside, sigma

    def predict(self, pillar_radius_um, gap_um, periodicity, cell):
        values = pillar_radius_um, gap_um, periodicity, cell.capillary_number, cell.radius_um
        return np.asarray(
            self.angle(
                *np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in values))
            ),
            float,
        )

    def predict_interval(self, radius, gap, periodicity, cell, level=0.9):
        angle = self.predict(radius, gap, periodicity, cell)
        return angle - self.half, angle + self.half

    def inside_domain(self, radius, gap, periodicity, cell):
        return self.distance_outside(radius, gap, periodicity, cell) <= DOMAIN_TOLERANCE

    def sigma_num_deg(self, angle_deg, periodicity):
        return None if self.sigma is None else np.full(len(periodicity), self.sigma)

    def distance_outside(self, radius, gap, periodicity, cell):
        places = np.broadcast(*map(np.atleast_1d, (radius, gap, periodicity)))
        return np.array([self.outside(*at) for at in places])


CHIP = Chip(Flow(), Device(), 2.0)


def people(request, surrogate=Known, flow=CHIP.flow):
    """Both cell types of a request without a calibration."""
    return make_populations(request, flow_of(request, flow), {"1": SOFT}, None, surrogate.domains)


def task_of(surrogate, request, chip=CHIP, seed=1, populations=None):
    populations = populations or people(request, surrogate)
    return Task(surrogate, request, populations, chip, seed)


def run(surrogate, request, chip=CHIP, seed=1, populations=None):
    return search(surrogate, request, populations or people(request, surrogate), chip, seed)


def regret_of(surrogate, request, chip=CHIP, seed=1):
    return regret(surrogate, request, people(request, surrogate), chip, seed)


def found(surrogate, request, seed, safety=2.0, **changes):
    """Candidates and trials of a search."""
    result = run(surrogate, request, CHIP._replace(safety_distance_um=safety, **changes), seed)
    return result.designs, result.trials


def hill(r, g, n, d, cell):
    """One smooth summit of the separation at P_r 7, P_g 17, N_p 8."""
    return 10 * d * np.exp(-((r - 7) ** 2) / 4 - (g - 17) ** 2 / 9 - (n - 8) ** 2 / 8)


def ask(ca_1=0.5, ca_2=0.8, **changes):
    """A request of two discs by their capillary numbers at 0.5 mm/s and 1.5 mPa·s."""
    return DesignRequest(
        **{
            "name": "test",
            "ks_1_uN_per_m": 0.75 / ca_1,
            "ks_2_uN_per_m": 0.75 / ca_2,
            "pillar_radius_um": (5, 10),
            "gap_um": (14, 22),
            "periodicity": (4, 12),
            "trials": 80,
            "objective": "separation",
        }
        | changes
    )
