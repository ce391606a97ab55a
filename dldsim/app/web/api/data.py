"""The campaigns that answers come from: the service's own, and those that users brought.

There is no other source. What is missing is an error that says so; no model is ever made up.
"""

import hashlib
import io
import json
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from dldsim import PHYSICS_VERSION, __version__
from dldsim.analysis import surrogate
from dldsim.app import design_jobs
from dldsim.app.design_jobs import MEASURED
from dldsim.app.web.api.models import Provenance
from dldsim.app.web.api.settings import Settings
from dldsim.app.web.api.store import Store
from dldsim.config.provenance import derive_seed
from dldsim.errors import DldsimError
from dldsim.tables.parquet import METADATA_KEY, describe, read_table, write_table
from dldsim.tables.registry import COLUMNS, schema

FILES = ("outcomes.parquet", "calibration.parquet", "flows.parquet", "surrogate.json",
         "surrogate_card.json")  # fmt: skip
NEEDED = tuple(name for name in FILES if name != "flows.parquet")
TABLES = ("outcomes", "calibration", "flows")
"""Kinds of tables that a campaign is kept with; only the first is needed."""
SEED = 1
"""Of the fit of an uploaded campaign."""
CACHED = 4


class Unavailable(DldsimError):
    """The service's own campaign cannot be read."""


class NotFound(DldsimError):
    """No such campaign."""


class NotReady(DldsimError):
    """A campaign whose surrogate is not fitted."""


class Source(NamedTuple):
    """A campaign with its name and provenance."""

    known: design_jobs.Campaign
    provenance: Provenance


class Data:
    """Campaigns by id; the service's own is read again when its files change."""

    def __init__(self, settings: Settings, store: Store):
        self.settings, self.store = settings, store
        self._lock = threading.Lock()
        self._own: tuple[Any, Source] | None = None
        self._uploaded: OrderedDict[str, Source] = OrderedDict()

    def folder(self) -> Path:
        """Folder of the service's own campaign."""
        return self.settings.results or design_jobs.packaged_campaign()

    def _signature(self) -> Any:
        """Which files there are, and their age. Raises Unavailable if one is missing."""
        try:
            folder = self.folder()
        except DldsimError as error:
            raise Unavailable(str(error)) from error
        stats = {name: (folder / name).stat() for name in FILES if (folder / name).is_file()}
        if missing := [name for name in NEEDED if name not in stats]:
            raise Unavailable(
                f"The campaign data are incomplete: {', '.join(missing)} missing. Every answer "
                "comes from them, so there are none. Name the folder of a finished campaign with "
                "--results, or make one with `snakemake -j2 all`."
            )
        return [(name, s.st_size, s.st_mtime_ns) for name, s in stats.items()]

    def own(self) -> Source:
        """The service's own campaign. Raises Unavailable."""
        with self._lock:
            signature = self._signature()
            if self._own is None or self._own[0] != signature:
                try:
                    device, safety, _ = self.settings.campaign()
                    known = design_jobs.read_campaign(self.folder(), device, safety)
                except DldsimError as error:
                    raise Unavailable(f"The campaign data cannot be used: {error}") from error
                name = ("the campaign that comes with dldsim" if self.settings.results is None
                        else "the campaign that this service was started with")
                self._own = signature, Source(known, _provenance(known, None, name, "tracked"))
            return self._own[1]

    def source(self, campaign: str | None) -> Source:
        """A campaign by id, the service's own for None. Raises Unavailable, NotFound, NotReady."""
        if campaign is None:
            return self.own()
        job = self.store.find(campaign, "campaign")
        if job is None:
            raise NotFound(f"campaign {campaign}: there is none of this id, or it was deleted.")
        if job.state != "done":
            why = f": {job.error}" if job.error else ". Ask again when it is ready."
            raise NotReady(f"campaign {campaign} is {job.state}{why}")
        with self._lock:
            if campaign in self._uploaded:
                self._uploaded.move_to_end(campaign)
                return self._uploaded[campaign]
        parts = self.store.parts(campaign)
        tables, control = self._tables(parts)
        model = _load(parts)
        design_jobs.check_model(model, tables["outcomes"], Path(job.spec["name"]))
        found = self._made(tables, parts, model, control, campaign, job.spec)
        with self._lock:
            self._uploaded[campaign] = found
            while len(self._uploaded) > CACHED:
                self._uploaded.popitem(last=False)
        return found

    def fit(self, campaign: str, spec: Mapping) -> tuple[Source, dict[str, bytes]]:
        """Fit the surrogate of an uploaded campaign; its files for the store."""
        parts = self.store.parts(campaign)
        tables, control = self._tables(parts)
        model = surrogate.fit(tables["outcomes"], derive_seed(SEED, "surrogate"))
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / name for name in ("surrogate.json", "surrogate_card.json")]
            model.save(*paths)
            files = {path.name: path.read_bytes() for path in paths}
        return self._made(tables, parts, _load(files), control, campaign, spec), files

    def _tables(self, parts: Mapping[str, bytes]) -> tuple[dict[str, pd.DataFrame], Any]:
        """Tables of stored parts, measurements below the outcomes; and the run control."""
        tables, control = {}, None
        with tempfile.TemporaryDirectory() as folder:
            for kind in TABLES:
                if kind in parts:
                    path = Path(folder) / f"{kind}.parquet"
                    path.write_bytes(parts[kind])
                    tables[kind] = read_table(kind, path)
                    if kind == "outcomes":
                        settings = describe(path)["provenance"].get("settings") or {}
                        control = settings.get("run_control")
        if "measurements" in parts:
            given = json.loads(parts["measurements"])
            tables["outcomes"] = design_jobs.with_measurements(tables["outcomes"], **given)
        return tables, control

    def _made(self, tables, parts, model, control, campaign, spec) -> Source:
        device, safety, _ = self.settings.campaign()
        simulated = tables["outcomes"][tables["outcomes"]["status"] != MEASURED]
        known = design_jobs.make_campaign(tables | {"outcomes": simulated}, model, control, device,
                                          safety)._replace(tables=tables)
        origin = "measurements" if "measurements" in parts else "uploaded"
        return Source(known, _provenance(known, campaign, spec["name"], origin))

    def snapshot(self, campaign: str | None) -> dict[str, bytes]:
        """Tables of a campaign as they are kept for another that is made from it."""
        if campaign is not None:
            self.source(campaign)
            return {k: v for k, v in self.store.parts(campaign).items() if "surrogate" not in k}
        self.own()
        paths = {kind: self.folder() / f"{kind}.parquet" for kind in TABLES}
        return {kind: path.read_bytes() for kind, path in paths.items() if path.is_file()}


def _load(files: Mapping[str, bytes]) -> surrogate.Surrogate:
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("surrogate.json", "surrogate_card.json")]
        for path in paths:
            path.write_bytes(files[path.name])
        return surrogate.load(*paths)


def _provenance(known: design_jobs.Campaign, campaign: str | None, name: str, origin: str
                ) -> Provenance:
    card = known.model.card
    warnings = []
    measured = int((known.tables["outcomes"]["status"] == MEASURED).sum())
    if origin == "uploaded":
        warnings.append("This campaign was uploaded by a user; the service has checked its form, "
                        "not how it was made.")
    if measured:
        warnings.append(f"{measured} angles were measured on fabricated devices and typed in; "
                        "each counts as one outcome.")
    if card["data"]["undecided"]:
        warnings.append(f"{card['data']['undecided']} of the outcomes learnt from had not settled "
                        "when their rows were spent.")
    return Provenance(
        dldsim_version=__version__, physics_version=PHYSICS_VERSION, campaign=campaign,
        campaign_name=name, origin=origin, outcomes=card["data"]["outcomes"],
        used=card["data"]["used"], measured=measured, geometries=card["data"]["geometries"],
        outcomes_sha256=card["data"]["sha256"], model_sha256=card.get("model_sha256", ""),
        fitted_by=card["versions"], scores_by_geometry=card["scores_by_geometry"],
        warnings=warnings,
    )  # fmt: skip


def read_upload(kind: str, content: bytes, rows_max: int) -> bytes:
    """An uploaded table as a checked Parquet file of this package.

    Parquet or CSV, told apart by its first bytes, with all columns of the kind and no others. Of a
    Parquet file that this package wrote, the physics version is checked and the metadata are kept.
    Raises DldsimError.
    """
    where = f"uploaded table {kind}"
    remedy = "Upload the file that a campaign wrote: results/" + kind + ".parquet or its CSV twin."
    about: dict[str, Any] = {}
    try:
        if content[:4] == b"PAR1":
            file = pq.ParquetFile(io.BytesIO(content))
            if file.metadata.num_rows > rows_max:
                raise DldsimError(f"{where}: {file.metadata.num_rows} rows; at most {rows_max}.")
            if file.metadata.num_columns > 2 * len(COLUMNS[kind]):
                raise DldsimError(f"{where}: {file.metadata.num_columns} columns. {remedy}")
            size = sum(file.metadata.row_group(i).total_byte_size
                       for i in range(file.metadata.num_row_groups))
            groups = [file.metadata.row_group(i) for i in range(file.metadata.num_row_groups)]
            values = max((g.column(i).num_values for g in groups for i in range(g.num_columns)),
                         default=0)
            if size > 64 * len(content) + 10**7 or values > 200 * rows_max:
                raise DldsimError(f"{where}: {size} bytes and {values} values in a column when "
                                  f"unpacked. {remedy}")
            about = json.loads((file.schema_arrow.metadata or {}).get(METADATA_KEY, b"{}"))
            table = file.read()
        else:
            types = {c.name: pa.string() if pa.types.is_list(c.type) else c.type
                     for c in COLUMNS[kind]}
            text = {c.name for c in COLUMNS[kind] if c.type == pa.string() and not c.nullable}
            table = pyarrow.csv.read_csv(
                io.BytesIO(content), read_options=pyarrow.csv.ReadOptions(use_threads=False),
                convert_options=pyarrow.csv.ConvertOptions(column_types=types,
                                                           strings_can_be_null=True,
                                                           quoted_strings_can_be_null=False))
            for i, field in enumerate(table.schema):
                if field.name in text:
                    table = table.set_column(i, field.name, table[i].fill_null(""))
            for column in COLUMNS[kind]:
                if pa.types.is_list(column.type) and column.name in table.column_names:
                    values = [json.loads(v) if v else None
                              for v in table[column.name].to_pylist()]
                    i = table.column_names.index(column.name)
                    table = table.set_column(i, column.name, pa.array(values, column.type))
    except DldsimError:
        raise
    except Exception as error:  # whatever a parser says of a file that is none
        reason = " ".join(str(error).split())[:300]
        raise DldsimError(f"{where} is neither a readable Parquet file nor CSV: {reason}. {remedy}"
                          ) from error
    if table.num_rows > rows_max:
        raise DldsimError(f"{where}: {table.num_rows} rows; at most {rows_max}.")
    if not table.num_rows:
        raise DldsimError(f"{where} has no rows.")
    if about.get("kind", kind) != kind:
        raise DldsimError(f"{where}: this is a table of kind {about['kind']}. {remedy}")
    if about.get("physics_version", PHYSICS_VERSION) != PHYSICS_VERSION:
        raise DldsimError(
            f"{where} was made by physics version {about['physics_version']}; this is version "
            f"{PHYSICS_VERSION}, whose trajectories differ. Make the campaign anew."
        )
    doubled = [n for n in set(table.column_names) if table.column_names.count(n) > 1]
    if doubled:
        raise DldsimError(f"{where}: column {doubled[0]} is there more than once.")
    columns = {name: table[name].combine_chunks() for name in table.column_names}
    kept = {k: about[k] for k in ("config_hash", "seed", "settings") if k in about}
    kept["uploaded_sha256"] = hashlib.sha256(content).hexdigest()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{kind}.parquet"
        write_table(kind, columns, path, kept)
        if kind == "outcomes":
            _check_outcomes(read_table(kind, path), where)
        return path.read_bytes()


RANGES = {
    "pillar_radius_um": (0.1, 1000), "gap_um": (0.1, 1000), "periodicity": (2, 100),
    "cell_radius_um": (0.1, 100), "deformation_index": (0, 1), "migration_angle_deg": (-90, 90),
    "mean_velocity_mm_s": (1e-6, 1e4), "height_um": (0, 1e4),
}  # fmt: skip


def _check_outcomes(outcomes: pd.DataFrame, where: str) -> None:
    """Refuse values that no outcome has, and what cannot be learnt from. Raises DldsimError."""
    for name, (low, high) in RANGES.items():
        values = outcomes[name].dropna()
        bad = values[(values < low) | (values > high)]
        if len(bad):
            raise DldsimError(f"{where}, column {name}, row {bad.index[0]}: {bad.iloc[0]:g}; "
                              f"allowed {low:g} to {high:g}.")
    doubled = outcomes["outcome_id"][outcomes["outcome_id"].duplicated()]
    if len(doubled):
        raise DldsimError(f"{where}: outcome_id {doubled.iloc[0][:80]} is there more than once.")
    if (outcomes["status"] == MEASURED).any():
        raise DldsimError(f"{where}: status {MEASURED} is kept for measured angles, which POST "
                          "/measurements takes.")
    try:
        design_jobs.settings_of_outcomes(outcomes)
        surrogate.learnable(outcomes)
    except (KeyError, TypeError, ValueError) as error:
        raise DldsimError(f"{where}: column numerics is not that of an outcome: {error!r:.200}."
                          ) from error


def table_rows(kind: str, frame: pd.DataFrame) -> list[dict]:
    """Rows of a table for an answer; null for what is not there."""
    return json.loads(frame.to_json(orient="records", double_precision=15))


def columns_of(kind: str) -> list[dict]:
    """Names, types, units and meanings of a table's columns."""
    return [{"name": f.name, "type": str(f.type), "nullable": f.nullable,
             "unit": f.metadata[b"unit"].decode(),
             "description": f.metadata[b"description"].decode()} for f in schema(kind)]
