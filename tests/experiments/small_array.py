"""A small cell in a small array of 16 nodes pitch: a run takes tenths of a second."""

from dldsim.config.sections import Cell, Flow, Geometry, Numerics, Stiffness

SET_1 = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)
GEOMETRY = Geometry(pillar_radius_um=5, gap_um=12, periodicity=4)
CELL = Cell(radius_um=4.0)
FLOW = Flow(height_um=12.0)
NUMERICS = Numerics()
