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
import pyarrow.parquet as pq

from dldsim import PHYSICS_VERSION, __version__
from dldsim.analysis import surrogate
from dldsim.analysis.calibration import join_deformation_index
from dldsim.analysis.learning import SURVEY
from dldsim.app.web.api.answers import Provenance
from dldsim.app.web.api.settings import Settings
from dldsim.app.web.api.store import Store
from dldsim.config.provenance import derive_seed
from dldsim.design import finished_campaign
from dldsim.design.measured_devices import MEASURED, with_measurements
from dldsim.errors import DldsimError
from dldsim.tables.parquet import describe, read_table, write_table
from dldsim.tables.registry import COLUMNS, schema
from dldsim.tables.user_table import read_user_table
from dldsim.tables.user_values import PLAUSIBLE, as_columns, check_plausible

FILES = (
    "outcomes.parquet",
    "calibration.parquet",
    "flows.parquet",
    "surrogate.json",
    "surrogate_card.json",
)
NEEDED = tuple(name for name in FILES if name != "flows.parquet")
TABLES = ("outcomes", "calibration", "flows", finished_campaign.LIBRARY)
"""Kinds of tables that a campaign is kept with; only the first is needed."""
KEPT = {kind: kind for kind in TABLES} | {"survey": "outcomes"}
"""Kind of each table that is kept: where the service's own campaign has learnt from the survey, so
do those that are made from it."""
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

    known: finished_campaign.Campaign
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
        return self.settings.results or finished_campaign.packaged_campaign()

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
                    known = finished_campaign.read_campaign(self.folder(), device, safety)
                    finished_campaign.check_settings(self.settings.configuration(), known)
                except DldsimError as error:
                    raise Unavailable(f"The campaign data cannot be used: {error}") from error
                name = (
                    "the campaign that comes with dldsim"
                    if self.settings.results is None
                    else "the campaign that this service was started with"
                )
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
        finished_campaign.check_model(model, tables, Path(job.spec["name"]))
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
        seed = derive_seed(SEED, "surrogate")
        model = surrogate.fit(tables["outcomes"], seed, tables.get("survey"))
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / name for name in ("surrogate.json", "surrogate_card.json")]
            model.save(*paths)
            files = {path.name: path.read_bytes() for path in paths}
        return self._made(tables, parts, _load(files), control, campaign, spec), files

    def _tables(self, parts: Mapping[str, bytes]) -> tuple[dict[str, pd.DataFrame], Any]:
        """Tables of stored parts, measurements below the outcomes; and the run control."""
        tables, control = {}, None
        with tempfile.TemporaryDirectory() as folder:
            for name, kind in KEPT.items():
                if name in parts:
                    path = Path(folder) / f"{name}.parquet"
                    path.write_bytes(parts[name])
                    tables[name] = read_table(kind, path)
                    if name == "outcomes":
                        settings = describe(path)["provenance"].get("settings") or {}
                        control = settings.get("run_control")
        if "measurements" in parts:
            tables["outcomes"] = with_measurements(
                tables["outcomes"],
                json.loads(parts["measurements"]),
                finished_campaign.calibration_of(tables),
            )
        return tables, control

    def _made(self, tables, parts, model, control, campaign, spec) -> Source:
        device, safety, _ = self.settings.campaign()
        simulated = tables["outcomes"][tables["outcomes"]["status"] != MEASURED]
        known = finished_campaign.make_campaign(
            tables | {"outcomes": simulated}, model, control, device, safety
        )._replace(tables=tables)
        origin = "measurements" if "measurements" in parts else "uploaded"
        return Source(known, _provenance(known, campaign, spec["name"], origin))

    def snapshot(self, campaign: str | None) -> dict[str, bytes]:
        """Tables of a campaign as they are kept for another that is made from it."""
        if campaign is not None:
            self.source(campaign)
            return {k: v for k, v in self.store.parts(campaign).items() if "surrogate" not in k}
        paths = {kind: self.folder() / f"{kind}.parquet" for kind in TABLES}
        if "survey" in self.own().known.tables:
            paths["survey"] = SURVEY
        return {kind: path.read_bytes() for kind, path in paths.items() if path.is_file()}


def _load(files: Mapping[str, bytes]) -> surrogate.Surrogate:
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("surrogate.json", "surrogate_card.json")]
        for path in paths:
            path.write_bytes(files[path.name])
        return surrogate.load(*paths)


def _provenance(
    known: finished_campaign.Campaign, campaign: str | None, name: str, origin: str
) -> Provenance:
    card = known.model.card
    warnings = []
    measured = int((known.tables["outcomes"]["status"] == MEASURED).sum())
    if origin == "uploaded":
        warnings.append(
            "This campaign was uploaded by a user; the service has checked its form, "
            "not how it was made."
        )
    if measured:
        warnings.append(
            f"{measured} angles were measured on fabricated devices and typed in; "
            "each counts as one outcome."
        )
    if card["data"]["undecided"]:
        warnings.append(
            f"{card['data']['undecided']} of the outcomes learnt from had not settled "
            "when their rows were spent."
        )
    return Provenance(
        dldsim_version=__version__,
        physics_version=PHYSICS_VERSION,
        campaign=campaign,
        campaign_name=name,
        origin=origin,
        outcomes=card["data"]["outcomes"],
        used=card["data"]["used"],
        measured=measured,
        geometries=card["data"]["geometries"],
        outcomes_sha256=card["data"]["sha256"],
        model_sha256=card.get("model_sha256", ""),
        fitted_by=card["versions"],
        holds_for=known.model.holds_for,
        scores_by_geometry=card["scores_by_geometry"],
        warnings=warnings,
    )


class Upload(NamedTuple):
    """A checked table as a Parquet file of this package, and what was found in reading it."""

    content: bytes
    rows: int
    found: list[str]


def read_upload(kind: str, content: bytes, rows_max: int) -> Upload:
    """An uploaded table, Parquet or CSV, with all columns of the kind and no others.

    Of a Parquet file that this package wrote, the physics version is checked and the metadata are
    kept. Raises DldsimError.
    """
    where = f"uploaded table {kind}"
    remedy = "Upload the file that a campaign wrote: results/" + kind + ".parquet or its CSV twin."
    if content[:4] == b"PAR1":
        _check_size(content, where, remedy, len(COLUMNS[kind]), rows_max)
    frame, found, about = read_user_table(content, where)
    if len(frame) > rows_max:
        raise DldsimError(f"{where}: {len(frame)} rows; at most {rows_max}.")
    if frame.empty:
        raise DldsimError(f"{where} has no rows. {remedy}")
    if about.get("kind", kind) != kind:
        raise DldsimError(f"{where}: this is a table of kind {about['kind']}. {remedy}")
    columns = as_columns(kind, frame, where)
    for name in PLAUSIBLE:
        if name in columns:
            check_plausible(columns[name].astype(float), where)
    kept = {k: about[k] for k in ("config_hash", "seed", "settings") if k in about}
    kept["uploaded_sha256"] = hashlib.sha256(content).hexdigest()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{kind}.parquet"
        try:
            write_table(kind, columns, path, kept)
        except DldsimError as error:
            raise DldsimError(f"{where}: {error}") from error
        if kind == "outcomes":
            _check_outcomes(read_table(kind, path), where)
        return Upload(path.read_bytes(), len(frame), found)


def _check_size(content: bytes, where: str, remedy: str, columns: int, rows_max: int) -> None:
    """Refuse a Parquet file that would become too large when unpacked. Raises DldsimError."""
    try:
        about = pq.ParquetFile(io.BytesIO(content)).metadata
    except (pa.ArrowException, OSError):
        return  # the reader tells why
    if about.num_rows > rows_max:
        raise DldsimError(f"{where}: {about.num_rows} rows; at most {rows_max}.")
    if about.num_columns > 2 * columns:
        raise DldsimError(f"{where}: {about.num_columns} columns. {remedy}")
    groups = [about.row_group(i) for i in range(about.num_row_groups)]
    size = sum(g.total_byte_size for g in groups)
    values = max((g.column(i).num_values for g in groups for i in range(g.num_columns)), default=0)
    if size > 64 * len(content) + 10**7 or values > 200 * rows_max:
        raise DldsimError(
            f"{where}: {size} bytes and {values} values in a column when unpacked. {remedy}"
        )


def check_sets(parts: Mapping[str, bytes]) -> None:
    """Refuse outcomes of a stiffness set that the calibration beside them does not know."""
    if "calibration" in parts:
        outcomes, calibration = (
            pq.read_table(io.BytesIO(parts[kind])).to_pandas()
            for kind in ("outcomes", "calibration")
        )
        try:
            join_deformation_index(outcomes, calibration)
        except DldsimError as error:
            raise DldsimError(f"uploaded table calibration: {error}", key="calibration") from error


def _check_outcomes(outcomes: pd.DataFrame, where: str) -> None:
    """Refuse what cannot be learnt from. Raises DldsimError."""
    doubled = outcomes["outcome_id"][outcomes["outcome_id"].duplicated()]
    if len(doubled):
        raise DldsimError(f"{where}: outcome_id {doubled.iloc[0][:80]} is there more than once.")
    if (outcomes["status"] == MEASURED).any():
        raise DldsimError(
            f"{where}: status {MEASURED} is kept for measured angles, which POST "
            "/measurements takes."
        )
    finished_campaign.settings_of_outcomes(outcomes)
    surrogate.learnable(outcomes)


def table_rows(kind: str, frame: pd.DataFrame) -> list[dict]:
    """Rows of a table for an answer; null for what is not there."""
    return json.loads(frame.to_json(orient="records", double_precision=15))


def columns_of(kind: str) -> list[dict]:
    """Names, types, units and meanings of a table's columns."""
    return [
        {
            "name": f.name,
            "type": str(f.type),
            "nullable": f.nullable,
            "unit": f.metadata[b"unit"].decode(),
            "description": f.metadata[b"description"].decode(),
        }
        for f in schema(kind)
    ]
