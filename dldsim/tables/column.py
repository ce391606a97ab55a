"""One column of a table, one table, and columns that several tables share."""

from typing import Any, Literal, NamedTuple, get_args, get_origin

import pyarrow as pa
from pydantic.fields import FieldInfo

from dldsim.config.sections import Numerics
from dldsim.tables.numerics import COLUMN_OF


class Column(NamedTuple):
    """One column of a table. A nullable one may hold null, "not measured"."""

    name: str
    type: pa.DataType
    unit: str
    description: str
    nullable: bool = False


TEXT, INT, FLOAT, BOOL = pa.string(), pa.int64(), pa.float64(), pa.bool_()


def text(name: str, description: str, nullable: bool = False) -> Column:
    return Column(name, TEXT, "", description, nullable)


def count(name: str, description: str, nullable: bool = False) -> Column:
    return Column(name, INT, "1", description, nullable)


def flag(name: str, description: str, nullable: bool = False) -> Column:
    return Column(name, BOOL, "", description, nullable)


def real(name: str, unit: str, description: str, nullable: bool = False) -> Column:
    return Column(name, FLOAT, unit, description, nullable)


def optional(*columns: Column) -> tuple[Column, ...]:
    return tuple(column._replace(nullable=True) for column in columns)


class Table(NamedTuple):
    """One kind of table: its columns, the file in results/ and the rule that makes it.

    Without file and rule it is a part of other tables only.
    """

    columns: tuple[Column, ...]
    file: str | None
    rule: str | None

    @property
    def names(self) -> list[str]:
        return [column.name for column in self.columns]


def table(file: str | None, rule: str | None, *columns: Column) -> Table:
    """A Table by its columns."""
    return Table(columns, file, rule)


RUN_ID = text("run_id", "identifier of the run")
GEOMETRY = (
    real("pillar_radius_um", "µm", "pillar radius P_r"),
    real("gap_um", "µm", "gap P_g between pillar surfaces"),
    count("periodicity", "rows N_p after which the array repeats"),
)
SPRINGS = (
    real("ks_uN_per_m", "µN/m", "edge spring constant k_s"),
    real("kb_pN_um", "pN·µm", "dihedral bending constant k_b"),
    real("kal_uN_per_m", "µN/m", "local area constant k_α"),
)
OUTCOME_ID = text("outcome_id", "identifier of array and cell")
ARRAY_AND_CELL = (
    *GEOMETRY[:2],
    real("pitch_um", "µm", "centre-to-centre distance λ = 2 P_r + P_g"),
    GEOMETRY[2],
    real("row_shift_fraction", "1", "row shift / pitch, ε = 1/N_p"),
    text("stiffness_set", "name of the membrane"),
    text("cell_shape", "rest shape"),
    real("cell_radius_um", "µm", "largest radius of the rest shape"),
    real("height_um", "µm", "channel height; 0: two-dimensional limit"),
    *SPRINGS,
    real("kag_uN_per_m", "µN/m", "global area constant k_ag"),
    real("kv_Pa", "Pa", "volume constant k_v"),
    real("kvisc_nN_s_per_m", "nN·s/m", "edge dashpot k_visc"),
    real("mean_velocity_mm_s", "mm/s", "mean velocity over the unit cell"),
)
DRIVE = text("drive", "no-lateral-flux, or axial: body force along x only")
CELL_AND_DRIVE = (
    *optional(real("aspect_ratio", "1", "of an ellipsoid: half axis along its symmetry axis / R")),
    text("release_axis", "direction of the symmetry axis at release"),
    DRIVE,
)
INTERVAL = (
    real("angle_low_deg", "°", "lower end of its 95 % interval"),
    real("angle_high_deg", "°", "upper end of its 95 % interval"),
)
TRANSITION = real(
    "transition_distance",
    "1",
    "largest lateral step of the row map / row shift, less one: above 0 there is a bump lane",
)
CAPILLARY = real("capillary_number", "1", "μU/k_s, with the spring constant; null for k_s = 0")
CONFINEMENT = real("confinement", "1", "2R/P_g")
LAG = real(
    "lag_number",
    "1",
    "relaxation time of the fluid / time in which the cell moves by "
    "its radius, twice: U·2R/ν where the cell is the largest length",
)
LEFT_OUT = text("left_out", "what the scene did without")
_TYPES: dict[Any, pa.DataType] = {float: FLOAT, int: INT, bool: BOOL, str: TEXT}
_UNITS = {"_um": "µm", "_nN_s_per_m": "nN·s/m"}


def _setting(name: str, field: FieldInfo) -> Column:
    """The column of a setting of `Numerics`, by its annotation, the end of its name, and its
    description."""
    kind: Any = field.annotation
    kind = type(get_args(kind)[0]) if get_origin(kind) is Literal else kind
    number = next((unit for end, unit in _UNITS.items() if name.endswith(end)), "1")
    unit = number if kind in (float, int) else ""
    return Column(COLUMN_OF[name], _TYPES[kind], unit, str(field.description))


NUMERICS = tuple(_setting(name, field) for name, field in Numerics.model_fields.items())
MARGINS = optional(
    real("margin_elastic", "1", "ω² of the stiffest elastic mode / safe ω²"),
    real("margin_mass", "1", "vertex mass asked for by springs / by friction"),
    real("margin_lag", "1", "delay of the dashpots / largest allowed"),
    real("margin_speed", "1", "fluid speed at release / largest allowed"),
)
INVERTED = real("inverted_faces_max", "1", "largest share of inverted faces", nullable=True)
STATUS = (text("status", "how the run ended"), text("stop_reason", "why it ended so"))
COST = optional(
    count("steps", "lattice-Boltzmann steps"),
    real("wall_time_s", "s", "time of the calculation"),
    real("mlups", "1e6/s", "lattice node updates a second"),
)
PROCESSOR = real(
    "processor_time_s", "s", "processor time of the time steps, whatever else runs", nullable=True
)
DRIFT = optional(
    real("volume_drift_max", "1", "largest relative deviation of the cell volume from rest"),
    real("area_drift_max", "1", "largest relative deviation of the membrane area from rest"),
)
POSITION = (
    RUN_ID,
    count("step", "lattice-Boltzmann step"),
    real("t_ms", "ms", "physical time since release"),
    real("x_um", "µm", "centre of mass along the flow, unwrapped"),
    real("y_um", "µm", "centre of mass across the flow, unwrapped"),
    real("z_um", "µm", "centre of mass above mid-height"),
)
RATIOS = (
    real("volume_ratio", "1", "cell volume / volume at rest"),
    real("area_ratio", "1", "membrane area / area at rest"),
)
