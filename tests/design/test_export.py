"""Everything that is written for a design: complete, measured, with units and provenance."""

import csv
import json
import math

import ezdxf
import gdstk
import h5py
import numpy as np
import pytest
from PIL import Image

from dldsim import PHYSICS_VERSION
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.sections import Cell, Flow, Geometry, Numerics, RunControl
from dldsim.design.export import FILES, Verified, export_design, make_streams, meaning_of
from dldsim.errors import DldsimError
from dldsim.experiments.array_outcome import simulate_outcome
from dldsim.experiments.vtk import Recorder
from dldsim.solver.flow import solve_empty_array
from dldsim.tables.registry import COLUMNS
from tests.experiments.test_vtk import SOFT

GEOMETRY = Geometry(pillar_radius_um=5, gap_um=12, periodicity=4)
DEVICE = Device(array_length_mm=1.0, array_width_mm=0.8)
REQUEST = DesignRequest(
    name="soft-from-stiff",
    deformation_index_1=0.6,
    deformation_index_2=0.4,
    radius_1_um=4.0,
    radius_2_um=4.0,
)
DESIGN = {
    "request": "soft-from-stiff",
    "rank": np.int64(1),
    **GEOMETRY.model_dump(),
    "separation_deg": 9.0,
    "angle_1_deg": 1.0,
    "angle_2_deg": 10.0,
    "separation_tolerance_min_deg": np.float64(7.0),
    "separation_tolerance_max_deg": 11.0,
    "sigma_num_deg": math.nan,
    "uncertainty_deg": 2.0,
    "verdict": "resolved",
    "inside_training_domain": np.True_,
}
ABOUT = {"config_hash": "0123456789abcdef", "seed": 7}
CARD = {"model": "xgboost", "scores_by_geometry": {"rmse_deg": 1.3}, "domain": {"geometries": []}}


@pytest.fixture(scope="module")
def verified():
    """Two short runs of small cells, a soft and a stiff one."""
    cell, flow, numerics = Cell(radius_um=4.0), Flow(height_um=12.0), Numerics()
    control = RunControl(max_rows=4, release_gap_fractions=[0.5])
    empty = solve_empty_array(GEOMETRY, flow, numerics)
    found = []
    for name, factor in (("1", 1), ("5", 4)):
        stiffness = SOFT.model_copy(update={"ks_uN_per_m": 5.1 * factor})
        recorder = Recorder(2)
        made = simulate_outcome(
            GEOMETRY,
            stiffness,
            cell,
            flow,
            numerics,
            control,
            outcome_id=f"r_s{name}",
            stiffness_set=name,
            empty_flow=empty,
            observe=recorder,
        )
        run = made.runs[0.5]
        found.append(
            Verified(
                {**made.row, "sigma_num_deg": 0.3}, run.trajectory, recorder.shapes(GEOMETRY, run)
            )
        )
    return found


@pytest.fixture(scope="module")
def files(verified, tmp_path_factory):
    return export_design(
        "soft-from-stiff-01",
        DESIGN,
        REQUEST,
        DEVICE,
        tmp_path_factory.mktemp("export"),
        about=ABOUT,
        card=CARD,
        verified=verified,
    )


def predicted(directory, **changed):
    return export_design(
        "d-01", {**DESIGN, **changed}, REQUEST, DEVICE, directory, about=ABOUT, card=CARD
    )


def test_all_files_are_there_and_nothing_else(files):
    assert set(files) == set(FILES)
    folder = files["json"].parent
    assert sorted(p.name for p in folder.iterdir()) == sorted(p.name for p in files.values())
    assert all(p.stat().st_size > 500 for p in files.values())


def test_every_file_opens_and_shows_the_same_array(files):
    [top] = gdstk.read_gds(files["gds"]).top_level()
    pillar = top.get_polygons(layer=DEVICE.layer_pillars, datatype=0)[0].points
    assert np.ptp(pillar, axis=0) / 2 == pytest.approx([5, 5], abs=1e-3)
    block = ezdxf.readfile(files["dxf"]).blocks
    [block] = (b for b in block if b.name.endswith("_PILLAR"))
    assert [c.dxf.radius for c in block] == [5.0]
    for kind in ("cell_1", "cell_2", "pillars"):
        with h5py.File(files[kind]) as content:
            assert content["VTKHDF"].attrs["Type"] == b"PolyData"
    for kind in ("mask_picture", "picture", "animation"):
        with Image.open(files[kind]) as image:
            assert min(image.size) > 100


def test_json_says_what_was_predicted_and_simulated(files, verified):
    record = json.loads(files["json"].read_text())
    assert record["design"]["angle_1_deg"] == 1.0 and record["design"]["rank"] == 1
    assert record["design"]["sigma_num_deg"] is None  # not measured
    assert record["design"]["inside_training_domain"] is True
    for run, source, shown in zip(
        record["verification"], verified, record["device"]["populations"], strict=True
    ):
        assert run["migration_angle_deg"] == source.row["migration_angle_deg"]
        assert run["path_departure_um"] == 0
        assert shown["migration_angle_deg"] == run["migration_angle_deg"]
        assert shown["angle_source"] == f"simulated, {run['status']}"
        assert shown["angle_error_deg"] == 0.3
    assert record["files"] == {kind: path.name for kind, path in files.items()}


def test_json_carries_units_and_provenance(files):
    record = json.loads(files["json"].read_text())
    about = record["provenance"]
    assert about["config_hash"] == ABOUT["config_hash"] and about["seed"] == 7
    assert about["physics_version"] == PHYSICS_VERSION and about["dldsim_version"]
    assert about["surrogate"]["scores_by_geometry"] == {"rmse_deg": 1.3}
    assert "domain" not in about["surrogate"]
    known = {c.name: c.unit for kind in ("runs", "designs") for c in COLUMNS[kind]}
    for name in record["design"]:
        assert record["columns"][name]["unit"] == known[name]


def test_csv_has_a_unit_for_every_length_and_angle(files):
    with files["csv"].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {r["section"] for r in rows} == {
        "provenance",
        "request",
        "design",
        "verification 1",
        "verification 2",
        "device",
        "cell 1",
        "cell 2",
    }
    for row in rows:
        if row["quantity"].endswith("_um"):
            assert row["unit"].endswith("µm")
        if row["quantity"].endswith("_deg"):
            assert row["unit"] == "°"
    values = {(r["section"], r["quantity"]): r["value"] for r in rows}
    assert values["design", "gap_um"] == "12.0" and values["design", "sigma_num_deg"] == ""
    assert values["provenance", "seed"] == "7"
    record = json.loads(files["json"].read_text())
    assert float(values["device", "separation_at_exit_um"]) == pytest.approx(
        record["device"]["separation_at_exit_um"]
    )


@pytest.mark.parametrize(
    ("quantity", "unit"),
    [
        ("wall_time_s", "s"),
        ("mean_velocity_mm_s", "mm/s"),
        ("array_length_mm", "mm"),
        ("t_ms", "ms"),
        ("exit_um", "µm"),
        ("seed", ""),
    ],
)
def test_units_by_name(quantity, unit):
    assert meaning_of(quantity)[0] == unit


def test_without_a_run_the_mask_shows_the_prediction(tmp_path):
    files = predicted(tmp_path)
    assert set(files) == {"json", "csv", "gds", "dxf", "mask_picture"}
    record = json.loads(files["json"].read_text())
    assert record["verification"] == []
    first, second = record["device"]["populations"]
    assert (first["migration_angle_deg"], second["migration_angle_deg"]) == (1.0, 10.0)
    assert first["angle_source"] == "predicted"
    assert first["angle_error_deg"] == pytest.approx(math.sqrt(2))
    length = record["device"]["array_length_um"]
    assert second["exit_um"] - 400 == pytest.approx(length * math.tan(math.radians(10)))


def test_files_of_an_earlier_verification_do_not_stay(tmp_path):
    for ending in FILES.values():
        (tmp_path / f"d-01{ending}").write_text("old")
    new = predicted(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(p.name for p in new.values())
    assert "old" not in {p.read_bytes()[:3].decode("latin1") for p in new.values()}


def test_a_run_without_an_angle_leaves_the_prediction(verified):
    stuck = verified[0]._replace(row={**verified[0].row, "migration_angle_deg": None})
    first, second = make_streams(DESIGN, REQUEST, [stuck, verified[1]])
    assert first.angle_deg == DESIGN["angle_1_deg"]
    assert second.angle_deg == verified[1].row["migration_angle_deg"]


def test_a_run_of_another_array_is_refused(verified, tmp_path):
    for changed in ({"gap_um": 12.002}, {"periodicity": 5}):
        with pytest.raises(DldsimError, match="the verifying r_s1 has"):
            export_design(
                "d-01",
                {**DESIGN, **changed},
                REQUEST,
                DEVICE,
                tmp_path,
                about=ABOUT,
                verified=verified,
            )
    assert not list(tmp_path.iterdir())


def test_the_same_design_gives_the_same_data(tmp_path):
    first = {k: p.read_bytes() for k, p in predicted(tmp_path).items()}
    again = {k: p.read_bytes() for k, p in predicted(tmp_path).items()}
    assert all(first[k] == again[k] for k in ("json", "csv", "gds", "mask_picture"))
