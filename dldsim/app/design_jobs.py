"""Jobs and commands that make designs: tables and requests in, tables and files out."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim import PHYSICS_VERSION
from dldsim.analysis import surrogate
from dldsim.analysis.calibration import join_deformation_index
from dldsim.analysis.regressors import INPUTS
from dldsim.app.jobs import Progress, provenance
from dldsim.config.configuration import Sweep
from dldsim.config.design_sections import DesignRequest, Device, Verification
from dldsim.config.provenance import derive_seed
from dldsim.config.sections import CellShape, Flow, Numerics, RunControl, Stiffness
from dldsim.design.export import export_design
from dldsim.design.search import Chip, Each, Found, Resistance, regret, search
from dldsim.design.verification import (
    Scene,
    Simulator,
    Verdicts,
    conditions,
    export,
    make_populations,
    plain,
    verify,
)
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.tables.parquet import (
    atomic_path,
    describe,
    read_many,
    read_table,
    write_csv,
    write_table,
)
from dldsim.tables.registry import COLUMNS

SEARCH = (
    "designs", "design_trials", "design_tolerances", "design_importance", "design_slices",
)  # fmt: skip
"""Kinds of tables of a search, in the order of `Found`."""


CAMPAIGN_DATA = Path(__file__).parents[1] / "data" / "campaign"
"""Tables and surrogate of the campaign that comes with the package."""
KEPT = ("outcomes", "runs", "calibration", "flows")


def by_deformation_index(request: DesignRequest, calibration: pd.DataFrame | None) -> DesignRequest:
    """The request with its stiffness sets replaced by their calibrated index and its scatter."""
    names = [n for n in (request.stiffness_set_1, request.stiffness_set_2) if n is not None]
    index, spread = {}, {}
    if names:
        keys = [f"stiffness_set_{i}" for i in "12" if getattr(request, f"stiffness_set_{i}")]
        if calibration is None:
            raise DldsimError(
                f"design request {request.name}: stiffness sets need a calibration.", key=keys,
                value=names, allowed="deformation_index_1 and deformation_index_2",
                remedy="Name the cell types by these, or add the table calibration.",
            )  # fmt: skip
        known = sorted({str(n) for n in calibration["stiffness_set"].dropna() if n})
        for key in keys:
            if (name := getattr(request, key)) not in known:
                raise DldsimError(
                    f"{key}: no constriction group calibrates stiffness set {name} (calibrated: "
                    f"{', '.join(known) or 'none'}).", key=key, value=name,
                    allowed=", ".join(known), remedy="Name a calibrated one, or add a group with "
                    "that stiffness_set to constriction_groups.",
                )  # fmt: skip
        joined = join_deformation_index(pd.DataFrame({"stiffness_set": names}), calibration)
        for name, mean, std in joined[
            ["stiffness_set", "deformation_index", "deformation_index_std"]].to_numpy():
            index |= {} if np.isnan(mean) else {name: float(mean)}
            spread[name] = 0.0 if np.isnan(std) else float(std)
    return request.with_deformation_indices(index, spread)


class Inputs(NamedTuple):
    """What every job about designs needs."""

    requests: list[DesignRequest]
    chip: Chip
    model: surrogate.Surrogate
    calibration: pd.DataFrame


def _inputs(settings: Mapping, model: Path, card: Path, calibration: Path, flows: Path) -> Inputs:
    table = read_table("flows", flows)
    chip = make_chip(settings, None if table["drag_over_mu_U"].isna().all() else table)
    return Inputs([DesignRequest(**r) for r in settings["design_requests"]], chip,
                  surrogate.load(model, card), read_table("calibration", calibration))


def make_chip(settings: Mapping, flows: pd.DataFrame | None) -> Chip:
    """Chip of the sections `flow` and `device`, `safety_distance_um`, and a table of flows."""
    resistance = None if flows is None else Resistance(flows)
    return Chip(Flow(**settings["flow"]), Device(**settings["device"]),
                settings["safety_distance_um"], resistance)


def search_all(inputs: Inputs, seed: int) -> Found:
    """Tables of the searches of all requests."""
    found = [
        search(inputs.model, by_deformation_index(request, inputs.calibration), inputs.chip,
               derive_seed(seed, f"design/{request.name}"))
        for request in inputs.requests
    ]  # fmt: skip
    return Found(*(pd.concat(tables, ignore_index=True) for tables in zip(*found, strict=True)))


def design_job(settings: Mapping, *, tables: Mapping[str, Path], **paths: Path) -> None:
    """Search for all requests; the tables of SEARCH with CSV twins."""
    inputs = _inputs(settings, **paths)
    found = search_all(inputs, settings["seed"]) if inputs.requests else map(_empty, SEARCH)
    for kind, table in zip(SEARCH, found, strict=True):
        write_table(kind, table, tables[kind], provenance(settings, settings["seed"]))
        write_csv(kind, tables[kind])


def regret_job(settings: Mapping, *, table: Path, **paths: Path) -> None:
    """Regret of TPE, random and exhaustive search on the surrogate, with a CSV twin."""
    inputs = _inputs(settings, **paths)
    found = [
        regret(inputs.model, by_deformation_index(request, inputs.calibration), inputs.chip,
               derive_seed(settings["seed"], f"regret/{request.name}"))
        for request in inputs.requests
    ]  # fmt: skip
    kind = "search_regret"
    rows = pd.concat(found, ignore_index=True) if found else _empty(kind)
    write_table(kind, rows, table, provenance(settings, settings["seed"]))
    write_csv(kind, table)


def scene_of(settings: Mapping) -> Scene:
    """The campaign's cell, flow, numerics and run control."""
    return Scene(CellShape(**settings["cell"]), Flow(**settings["flow"]),
                 Numerics(**settings["numerics"]), RunControl(**settings["run_control"]))


def verify_request(
    request: DesignRequest, settings: Mapping, chip: Chip, model: surrogate.Surrogate,
    tables: Mapping[str, pd.DataFrame], *, work: Path, files: Path, progress: Progress | None,
) -> Verdicts:
    """Verify the designs of one request by simulation and write their files.

    ``settings``: sections of the configuration, `seed` and `verification` among them; ``tables``:
    `outcomes` and `calibration`; ``work``: where finished ones are kept; ``files``: folder of the
    designs' files.
    """
    scene = scene_of(settings)
    conditions(tables["outcomes"], scene)
    resolved = by_deformation_index(request, tables["calibration"])
    sets = {name: Stiffness(**values) for name, values in settings["stiffness_sets"].items()}
    populations = make_populations(request, resolved, tables["calibration"], sets)
    budget = Verification(**settings["verification"])
    simulator = Simulator(work, scene, progress)
    verdicts = verify(
        model, tables["outcomes"], resolved, chip, budget, populations, simulator,
        derive_seed(settings["seed"], f"verify/{request.name}"),
        resistance=simulator.resistance, progress=progress,
    )  # fmt: skip
    Path(files).mkdir(parents=True, exist_ok=True)
    export(verdicts, resolved, chip, simulator, budget.exports, files,
           provenance(settings, settings["seed"]), model.card)
    return verdicts


def verify_job(
    name: str, settings: Mapping, *, outcomes: Path, verifications: Path, designs: Path,
    added: Path, files: Path, work: Path, progress: Progress, **paths: Path,
) -> None:
    """Verification of one request: rows of `verifications`, `verified_designs` and `outcomes`."""
    inputs = _inputs(settings, **paths)
    [request] = [r for r in inputs.requests if r.name == name]
    tables = {"outcomes": read_table("outcomes", outcomes), "calibration": inputs.calibration}
    verdicts = verify_request(request, settings, inputs.chip, inputs.model, tables, work=work,
                              files=files, progress=progress)
    about = provenance(settings, settings["seed"])
    measured = [row for row in verdicts.rows.values() if row["status"] != "failed"]
    for kind, table, path in (
        ("verifications", plain(verdicts.verifications), verifications),
        ("verified_designs", plain(verdicts.designs), designs),
        ("outcomes", measured or _empty("outcomes"), added),
    ):  # fmt: skip
        write_table(kind, table or _empty(kind), path, about)


def gather_verified(
    settings: Mapping, *, verifications: Iterable[Path], designs: Iterable[Path],
    added: Iterable[Path], outcomes: Path, tables: Mapping[str, Path], model: Path, card: Path,
) -> None:
    """Tables of all requests, and the surrogate refitted to all outcomes, the verifying ones too.

    ``tables``: paths of `verifications`, `verified_designs` and `outcomes`.
    """
    about = provenance(settings, settings["seed"])
    learnt = read_many("outcomes", [outcomes, *added])
    for kind, table in (
        ("verifications", read_many("verifications", verifications)),
        ("verified_designs", read_many("verified_designs", designs)), ("outcomes", learnt),
    ):  # fmt: skip
        write_table(kind, table, tables[kind], about)
        write_csv(kind, tables[kind])
    seed = derive_seed(settings["seed"], "surrogate")
    surrogate.fit(learnt, seed).save(model, card)


class Campaign(NamedTuple):
    """A finished campaign that designs are made from: settings as its tables tell them."""

    settings: dict[str, Any]
    tables: dict[str, pd.DataFrame]
    chip: Chip
    model: surrogate.Surrogate


def read_campaign(directory: Path, device: Device, safety_distance_um: float) -> Campaign:
    """Outcomes, calibration and surrogate in a folder, and flows if they are there.

    Raises DldsimError if a file is missing, damaged or of another physics version, or if the
    surrogate was learnt from others than these outcomes.
    """
    directory = Path(directory)
    tables = {kind: read_table(kind, directory / f"{kind}.parquet")
              for kind in ("outcomes", "calibration")}
    flows = directory / "flows.parquet"
    if flows.exists():
        tables["flows"] = read_table("flows", flows)
    model = surrogate.load(directory / "surrogate.json", directory / "surrogate_card.json")
    check_model(model, tables["outcomes"], directory)
    about = describe(directory / "outcomes.parquet")["provenance"]["settings"]
    return make_campaign(tables, model, about.get("run_control"), device, safety_distance_um)


def make_campaign(
    tables: dict[str, pd.DataFrame], model: surrogate.Surrogate, run_control: Mapping | None,
    device: Device, safety_distance_um: float,
) -> Campaign:
    """A campaign of tables in memory: `outcomes`, and `calibration` and `flows` if there are any.

    Raises DldsimError for outcomes of several conditions.
    """
    settings = settings_of_outcomes(tables["outcomes"], tables.get("flows"))
    settings["run_control"] = dict(run_control or RunControl().model_dump())
    settings |= {"device": device.model_dump(), "safety_distance_um": safety_distance_um}
    return Campaign(settings, tables, make_chip(settings, tables.get("flows")), model)


MEASURED = "measured"
"""Status of a row that was measured on a fabricated device."""


def with_measurements(
    outcomes: pd.DataFrame, measurements: Sequence[Mapping[str, Any]], *, height_um: float,
    mean_velocity_mm_s: float,
) -> pd.DataFrame:
    """The table of outcomes with measured angles below, to be learnt from like outcomes.

    A measurement has the keys of INPUTS and `migration_angle_deg`; of a measured row all other
    columns but the conditions are null. A measured array counts as an array of its own in the
    surrogate's intervals if its size differs from those simulated.

    Raises DldsimError for another height or velocity than the outcomes', which the surrogate does
    not know, and for angles that no array of that periodicity can cause.
    """
    conditions_ = {"height_um": height_um, "mean_velocity_mm_s": mean_velocity_mm_s}
    for name, value in conditions_.items():
        known = outcomes[name].unique()
        if len(known) != 1 or not np.isclose(known[0], value, rtol=1e-3):
            allowed = ", ".join(f"{v:g}" for v in known)
            raise DldsimError(
                f"Measurements: {name} = {value:g}, the outcomes have {allowed}. The surrogate "
                "knows no other.", key=name, value=value, allowed=allowed,
                remedy="Measure there, or simulate a campaign at this value.",
            )  # fmt: skip
    rows = []
    for i, given in enumerate(measurements, start=1):
        bump = float(np.degrees(np.arctan(1 / given["periodicity"])))
        angle = given["migration_angle_deg"]
        if not -bump / 2 <= angle <= 1.5 * bump:
            allowed = f"{-bump / 2:.3g} to {1.5 * bump:.3g}"
            raise DldsimError(
                f"Measurement {i}: migration_angle_deg = {angle:g} with periodicity "
                f"{given['periodicity']}: allowed {allowed}. Full bump motion has {bump:.3g}°.",
                key=f"measurements.{i - 1}.migration_angle_deg", value=angle, allowed=allowed,
                remedy="Look at the sign, the unit and the row shift.",
            )
        rows.append({
            **{key: given[key] for key in (*INPUTS, "migration_angle_deg")},
            "outcome_id": f"measured-{i:04d}", "stiffness_set": MEASURED, "status": MEASURED,
            "stop_reason": "", "mode": mode_of(angle, 1 / given["periodicity"]),
            "pitch_um": 2 * given["pillar_radius_um"] + given["gap_um"],
            "row_shift_fraction": 1 / given["periodicity"], "bump_angle_deg": bump,
            **{n: outcomes[n].iloc[0] for n in ("cell_shape", *conditions_)},
            "sigma_num_basis": "measured",
        })  # fmt: skip
    return pd.concat([outcomes, pd.DataFrame(rows, columns=outcomes.columns).astype(
        {name: kind for name, kind in outcomes.dtypes.items() if kind.kind == "f"})],
        ignore_index=True)  # fmt: skip


def packaged_campaign() -> Path:
    """Folder of the campaign that comes with the package.

    Raises DldsimError if none does, or if it is of another physics version.
    """
    remedy = "Name the folder of a finished campaign with --results, such as results/."
    if not CAMPAIGN_DATA.exists():
        raise DldsimError(f"No campaign comes with this installation. {remedy}")
    version = describe(CAMPAIGN_DATA / "calibration.parquet")["provenance"]["physics_version"]
    if version != PHYSICS_VERSION:
        raise DldsimError(
            f"The campaign that comes with this installation is of physics version {version}, "
            f"this is version {PHYSICS_VERSION}, whose angles differ. {remedy}"
        )
    return CAMPAIGN_DATA


def keep_campaign(results: Path, directory: Path = CAMPAIGN_DATA) -> None:
    """Make the tables and the surrogate of a results folder those that come with the package.

    Raises DldsimError like `read_campaign`, and without flows, from which pressures follow.
    """
    read_campaign(results, Device(), Sweep.model_fields["safety_distance_um"].default)
    for kind in KEPT:
        path = Path(results) / f"{kind}.parquet"
        about = describe(path)["provenance"]
        write_table(kind, read_table(kind, path), Path(directory) / path.name, about)
    for name in ("surrogate.json", "surrogate_card.json"):
        with atomic_path(Path(directory) / name) as part:
            part.write_bytes((Path(results) / name).read_bytes())


def check_model(model: surrogate.Surrogate, outcomes: pd.DataFrame, place: Path) -> None:
    """Refuse a surrogate that was learnt from other outcomes. Raises DldsimError."""
    if surrogate._data_hash(surrogate.learnable(outcomes)) != model.card["data"]["sha256"]:
        raise DldsimError(
            f"{place}: the surrogate was learnt from other outcomes than those of outcomes.parquet "
            "there. Fit it anew: `snakemake -j2 surrogate`."
        )


def settings_of_outcomes(
    outcomes: pd.DataFrame, flows: pd.DataFrame | None = None
) -> dict[str, Any]:
    """Sections cell, flow, numerics and stiffness_sets as a table of outcomes tells them.

    The viscosity is that of the capillary number Ca = μU/k_s. Raises DldsimError for mixed ones.
    """
    for name in ("cell_shape", "cell_radius_um", "height_um", "mean_velocity_mm_s", "numerics",
                 "release_axis"):
        if outcomes[name].nunique() != 1:
            raise DldsimError(f"The table of outcomes mixes several values of {name}: designs are "
                              "made from outcomes of one cell, channel and velocity.")
    done = outcomes[outcomes["capillary_number"].notna()]
    if done.empty:
        raise DldsimError("The table of outcomes has no run that was simulated.")
    first = done.iloc[0]
    asked = json.loads(first["numerics"])
    velocity = float(first["mean_velocity_mm_s"])
    viscosity = float(first["capillary_number"] * first["ks_uN_per_m"] / velocity)
    drive = flows["drive"].iloc[0] if flows is not None and len(flows) else "no-lateral-flux"
    names = list(Stiffness.model_fields)
    sets = done.drop_duplicates("stiffness_set").set_index("stiffness_set")[names]
    return {
        "cell": CellShape(
            shape=first["cell_shape"], radius_um=float(first["cell_radius_um"]),
            axis=first["release_axis"],
        ).model_dump(),
        "flow": Flow(
            mean_velocity_mm_s=velocity, viscosity_mPa_s=round(viscosity, 9),
            height_um=float(first["height_um"]), drive=drive,
        ).model_dump(),
        "numerics": Numerics(**{key: asked[key] for key in Numerics.model_fields}).model_dump(),
        "stiffness_sets": {str(k): {n: float(v) for n, v in row.items()}
                           for k, row in sets.iterrows()},
    }  # fmt: skip


class Made(NamedTuple):
    """The answer to one request: as asked, by deformation indices, settings and tables."""

    request: DesignRequest
    resolved: DesignRequest
    settings: dict[str, Any]
    found: Found

    @property
    def about(self) -> dict[str, Any]:
        """Provenance of everything that is written of it."""
        return provenance(self.settings, self.settings["seed"])


def make_designs(
    request: DesignRequest, known: Campaign, seed: int, budget: Verification,
    each: Each | None = None,
) -> Made:
    """Search for one request; ``budget`` is that of a verification later, ``each`` as in `search`.

    Raises DldsimError as `search` does.
    """
    resolved = by_deformation_index(request, known.tables.get("calibration"))
    found = search(known.model, resolved, known.chip,
                   derive_seed(seed, f"design/{request.name}"), each)
    settings = {
        **known.settings, "seed": seed, "verification": budget.model_dump(),
        "design_requests": [request.model_dump()],
        "surrogate": {k: known.model.card[k] for k in ("data", "scores_by_geometry", "versions")},
    }
    return Made(request, resolved, settings, found)


def write_designs(
    made: Made, known: Campaign, directory: Path, verdicts: Verdicts | None = None
) -> list[Path]:
    """Tables with CSV twins, `files/NAME-candidate-K.*` of every candidate, and `report.html`.

    Of the first candidate's mask there is a picture, too.
    ``verdicts``: of `verify_request`, which writes the files of the simulated designs itself.
    Returns what was written, CSV twins left out.
    """
    directory = Path(directory)
    written = write_tables(made.found, verdicts, directory, made.about)
    for _, design in made.found.designs.iterrows():
        name = f"{made.request.name}-candidate-{design['design']}"
        files = export_design(name, design.to_dict(), made.resolved, known.chip.device,
                              directory / "files", about=made.about, card=known.model.card,
                              picture=design["design"] == 1)
        written += files.values()
    from dldsim.report.design_page import write_report

    write_report(directory, directory / "report.html")
    return [*written, directory / "report.html"]


def write_tables(found: Found, verdicts: Verdicts | None, directory: Path, about: Mapping[str, Any]
                 ) -> list[Path]:
    """Tables of a search, and of its verification, with CSV twins; returns the Parquet files."""
    tables = dict(zip(SEARCH, found, strict=True))
    if verdicts is not None:
        tables |= {"verifications": plain(verdicts.verifications),
                   "verified_designs": plain(verdicts.designs)}
    paths = []
    for kind, table in tables.items():
        path = Path(directory) / f"{kind}.parquet"
        write_table(kind, table, path, about)
        write_csv(kind, path)
        paths.append(path)
    return paths


def _empty(kind: str) -> dict:
    return {column.name: [] for column in COLUMNS[kind]}


if __name__ == "__main__":
    import sys

    keep_campaign(Path(sys.argv[1]))
