"""From what was measured of a cell to what acts on it, and to what is simulated."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis.calibration import stiffness_for
from dldsim.analysis.domain import domains_of
from dldsim.config.design_sections import DesignRequest
from dldsim.config.sections import Flow
from dldsim.design import populations
from dldsim.design.populations import doubt, flow_of, make_populations, told_apart
from dldsim.errors import DldsimError
from tests.analysis.made_outcomes import make_survey
from tests.design.known_surrogate import SOFT

SETS = {
    "soft": SOFT,
    "stiff": SOFT.model_copy(update={"ks_uN_per_m": 15.0, "kb_pN_um": 0.3, "kal_uN_per_m": 30.0}),
}
CALIBRATION = pd.DataFrame(
    [
        {
            "assay": assay,
            "default": assay == "slit",
            "kind": kind,
            "label": "read elsewhere" if assay == "gauge" else "",
            "cell_shape": shape,
            "cell_radius_um": radius,
            "group": g,
            "stiffness_set": s,
            "ks_uN_per_m": k,
            "kb_pN_um": b,
            "kal_uN_per_m": 2 * k,
            "velocity_mm_s": 1.0,
            "deformation_index": scale * d,
            "deformation_index_std": 0.02,
        }
        for assay, kind, shape, radius, scale in (
            ("slit", "constriction", "biconcave", 7.5, 1.0),
            ("slit", "constriction", "biconcave", 9.0, 1.1),
            ("gauge", "shear", "biconcave", 7.5, 0.5),
            ("gauge", "shear", "sphere", 7.5, 0.1),
        )
        for g, s, k, b, d in (
            ("G1", "soft", 5.0, 0.1, 0.4),
            ("G2", "middle", 10.0, 3.0, 0.6),
            ("G3", "", 15.0, 3.0, 0.8),
        )
    ]
)
DOMAINS = domains_of(make_survey(60, 60))


def ask(**changes):
    named = {"name": "test", "ks_1_uN_per_m": 5.0, "ks_2_uN_per_m": 15.0}
    return DesignRequest(**{k: v for k, v in (named | changes).items() if v is not None})


def made(calibration=CALIBRATION, flow=None, **changes):
    """Both cell types of a request; another name of the first's stiffness takes the place of
    k_s."""
    if changes.keys() & {"deformation_index_1", "stiffness_set_1", "rigid_1"}:
        changes = {"ks_1_uN_per_m": None} | changes
    if changes.keys() & {"deformation_index_2"}:
        changes = {"ks_2_uN_per_m": None} | changes
    request = ask(**changes)
    flow = flow_of(request, flow or Flow())
    return make_populations(request, flow, SETS, calibration, DOMAINS)


def test_index_to_stiffness_to_ca_with_an_interval_at_each_step():
    cell, _ = made(deformation_index_1=0.6, deformation_index_std_1=0.03)
    found = stiffness_for(0.6, CALIBRATION, 0.03, shape="biconcave", radius_um=7.5)
    assert cell.stiffness.ks_uN_per_m == pytest.approx(10.0)
    assert (cell.ks_low, cell.ks_high) == (found["ks_uN_per_m_low"], found["ks_uN_per_m_high"])
    row = cell.row("test")
    # ± 0.03 and the scatter of 0.02 are ± 0.036 of an index that rises by 0.2 in 5 µN/m
    assert row["ks_low_uN_per_m"] == pytest.approx(10 - 0.036 * 25, abs=0.05)
    assert row["capillary_number"] == pytest.approx(1.5 * 0.5 / 10)
    assert row["capillary_number_low"] == pytest.approx(0.75 / cell.ks_high)
    assert row["capillary_number_high"] == pytest.approx(0.75 / cell.ks_low)
    assert (row["assay"], row["deformation_index"]) == ("slit", 0.6)
    assert "between G2 and G2" in row["stiffness_basis"]
    below, above = cell.spread
    assert below == pytest.approx(np.log(cell.ks_high / 10)) and above > below > 0


def test_velocity_and_height_are_the_requests_or_the_campaigns():
    flow = Flow(mean_velocity_mm_s=0.4, height_um=18.0)
    own, _ = made(flow=flow)
    assert (own.flow, own.cell.height_um) == (flow, 18.0)
    other, _ = made(flow=flow, velocity_mm_s=2.0, height_um=25.0)
    assert other.capillary_number == pytest.approx(5 * own.capillary_number)
    assert other.cell.height_um == 25.0 and other.flow.viscosity_mPa_s == 1.5


def test_a_named_set_is_simulated_as_it_is():
    cell, _ = made(stiffness_set_1="soft")
    assert cell.stiffness == SOFT and cell.basis == "stiffness set soft"
    assert cell.deformation_index == 0.4 and cell.assay is None
    assert cell.ks_low == cell.ks_high == 5.0 and cell.spread == (0, 0)
    # one that only the calibration knows has the moduli of the campaign's sets at its k_s
    other, _ = made(stiffness_set_1="middle")
    assert other.stiffness.ks_uN_per_m == 10.0 and other.stiffness.kb_pN_um == pytest.approx(0.2)
    wide, _ = made(stiffness_set_1="soft", deformation_index_std_1=0.05)
    assert wide.assay == "slit" and wide.ks_high > 5.0
    with pytest.raises(DldsimError, match="set other is not known .*middle, soft, stiff") as caught:
        made(stiffness_set_1="other")
    assert caught.value.keys == ("stiffness_set_1",)


def test_an_index_means_another_stiffness_for_another_cell_or_assay():
    other, sphere = made(
        assay="gauge", deformation_index_1=0.3, deformation_index_2=0.06, shape_2="sphere"
    )
    assert other.assay == sphere.assay == "gauge"
    assert other.stiffness.ks_uN_per_m == pytest.approx(10)  # 0.6 in the slit
    assert "calibration gauge, k_s 10 µN/m" in other.basis and "read elsewhere" in other.basis
    assert sphere.stiffness.ks_uN_per_m == pytest.approx(10)
    # between calibrated radii the curve is linear in the radius: 1.05 of that of 7.5 µm at 8.25 µm
    between, small = made(deformation_index_1=0.63, radius_1_um=8.25)
    assert between.stiffness.ks_uN_per_m == pytest.approx(10)
    assert small.deformation_index is None  # k_s was named
    by_set, _ = made(stiffness_set_1="middle", assay="gauge")
    assert by_set.deformation_index == pytest.approx(0.3)


def test_a_spring_constant_needs_no_calibration():
    cell, _ = made(calibration=None, ks_1_uN_per_m=7.5)
    assert cell.stiffness.kb_pN_um == pytest.approx(0.15)
    assert cell.deformation_index is None and cell.assay is None
    stiff, _ = made(calibration=None, ks_1_uN_per_m=150.0)
    assert stiff.stiffness.kag_uN_per_m == pytest.approx(5000)


def test_a_bead_is_the_stiffest_sphere_learnt():
    bead, disc = made(shape_1="sphere", rigid_1=True, radius_1_um=4.0)
    assert bead.capillary_number == pytest.approx(DOMAINS["sphere"].capillary_number[0])
    assert bead.rigid and not disc.rigid and "stand for it" in bead.basis
    fast, _ = made(shape_1="sphere", rigid_1=True, velocity_mm_s=2.0)
    assert fast.capillary_number == pytest.approx(bead.capillary_number)
    assert fast.stiffness.ks_uN_per_m == pytest.approx(4 * bead.stiffness.ks_uN_per_m)
    request = ask(ks_1_uN_per_m=None, shape_1="sphere", rigid_1=True)
    with pytest.raises(DldsimError, match="rigid_1: the surrogate has learnt no spheres"):
        make_populations(request, Flow(), SETS, None, {"biconcave": DOMAINS["biconcave"]})


@pytest.mark.parametrize(
    ("changes", "words", "key"),
    [
        ({"deformation_index_1": 0.85}, "calibrated range 0.4 to 0.8", "deformation_index_1"),
        (
            {"deformation_index_1": 0.5, "calibration": None},
            "needs a calibration",
            "deformation_index_1",
        ),
        (
            {"deformation_index_1": 0.5, "shape_1": "sphere"},
            "slit is calibrated for biconcave, not sphere.*dldsim calibrate --assay slit",
            "shape_1",
        ),
        (
            {"deformation_index_2": 0.5, "radius_2_um": 6.0},
            "biconcave cells of radius 7.5 to 9 µm, not 6 µm",
            "radius_2_um",
        ),
        ({"deformation_index_2": 0.5, "assay": "mine"}, "no assay 'mine'.*slit, gauge", "assay"),
    ],
)
def test_what_no_assay_can_tell_is_refused(changes, words, key):
    with pytest.raises(DldsimError, match=words) as caught:
        made(**changes)
    assert caught.value.keys == (key,)


def test_a_cell_without_a_capillary_number_is_refused():
    sets = SETS | {"none": SOFT.model_copy(update={"ks_uN_per_m": 0.0})}
    request = ask(ks_1_uN_per_m=None, stiffness_set_1="none")
    with pytest.raises(DldsimError, match="stiffness_set_1: k_s = 0 .* allowed 0.001 or more"):
        make_populations(request, Flow(), sets, None, DOMAINS)
    with pytest.raises(ValueError, match="ks_1_uN_per_m"):
        ask(ks_1_uN_per_m=5e-324)


def test_a_channel_too_low_for_the_cell_is_refused():
    disc, _ = made(calibration=None)
    assert made(calibration=None, height_um=disc.width_um)[0].width_um == disc.width_um
    for height in (disc.width_um * 0.99, 0.1):
        with pytest.raises(DldsimError, match="height_um = .* needs .*thickness") as caught:
            made(calibration=None, height_um=height)
        assert caught.value.keys == ("height_um", "radius_1_um")


def test_the_narrowest_gap_rests_on_what_is_known():
    """Passage of a slit, thickness at rest, tube, or diameter."""
    by_index, by_ks = made(deformation_index_1=0.6)
    assert by_index.width_um == pytest.approx(7.5)  # 15 √(0.4/1.6)
    assert by_ks.width_um == pytest.approx(15 / 3)
    assert by_ks.width_basis == "width in the slit of slit, whose index is 0.8 there"
    sheared, _ = made(deformation_index_1=0.3, assay="gauge")  # free: no wall has squeezed it
    assert "thickness" in sheared.width_basis
    disc, sphere = made(calibration=None, shape_2="sphere")
    assert disc.width_um == pytest.approx(7.5 * 2.58 / 3.91, rel=0.01)
    assert "thickness" in disc.width_basis
    # a sphere of ten per cent more area is a cylinder with caps: A = 4πr² + 2πrl, V = 4πr³/3 + πr²l
    r = sphere.width_um / 2
    length = (4.4 * np.pi * 7.5**2 - 4 * np.pi * r**2) / (2 * np.pi * r)
    volume = 4 / 3 * np.pi * r**3 + np.pi * r**2 * length
    assert volume == pytest.approx(4 / 3 * np.pi * 7.5**3) and "tube" in sphere.width_basis
    bead, _ = made(shape_1="sphere", rigid_1=True)
    assert (bead.width_um, bead.width_basis) == (15.0, "diameter of the bead")
    assert populations.squeezed_width_um(7.5, 0.0) == 15


def test_an_assay_that_does_not_tell_two_cells_apart_is_named_first():
    near = made(
        deformation_index_1=0.58,
        deformation_index_2=0.6,
        deformation_index_std_1=0.02,
        deformation_index_std_2=0.02,
    )
    assert told_apart(near) is False
    said = doubt(near)
    assert said.startswith("The assay slit does not tell the two cell types apart: ")
    assert "µN/m, overlap; nothing else tells them apart" in said
    sized = [near[0], near[1]._replace(radius_um=9.0)]
    assert "only size or shape may part them" in doubt(sized)
    far = made(deformation_index_1=0.45, deformation_index_2=0.75)
    assert told_apart(far) is True and doubt(far) == ""
    assert told_apart(made()) is None and doubt(made()) == ""
    rows = populations.rows_of(near, "test")
    assert [row["told_apart"] for row in rows] == [False, False] and rows[0]["doubt"] == said


def test_a_flow_with_inertia_is_told():
    """Water at 100 mm/s past cells of 7.5 µm radius: Re = 0.1 · 15e-6 / 1.5e-6 = 1."""
    cells = made()
    assert "Reynolds" not in doubt(cells)
    fast = cells[0].flow.model_copy(update={"mean_velocity_mm_s": 100.0})
    told = doubt([cell._replace(flow=fast) for cell in cells])
    assert "U·2R/ν is 1 (in water)" in told
