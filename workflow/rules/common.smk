# The configuration, and what each job reads of it. Snakemake sees neither edits of the package nor
# the configuration itself: a job is made anew when its parameters change, so these functions hand
# out exactly the settings that a job depends on, and the physics version.

import hashlib
import os
import sys
from functools import partial
from pathlib import Path

from snakemake.cli import get_argument_parser
from snakemake.exceptions import WorkflowError
from snakemake.io import apply_wildcards

from dldsim import PHYSICS_VERSION
from dldsim.analysis import uncertainty
from dldsim.analysis.learning import survey_hash
from dldsim.app import freshness
from dldsim.config import assays, campaign, identifiers, limits
from dldsim.config.provenance import check_stamp, settings_hash, write_stamp
from dldsim.evidence import accuracy, critical_gaps, reference_study, spot_check
from dldsim.config.presets import origins, read_layer, resolve
from dldsim.config.sections import CELL_NUMERICS
from dldsim.errors import DldsimError
from dldsim.evidence.stability_sweep import FAMILIES
from dldsim.evidence.validation import CASES

campaign.import_from(Path(workflow.basedir))
campaign.quote_interpreter()

RESULTS = "results"
CRASHES = f"{RESULTS}/crashes"


def refuse(check, folder, option):
    """Stop where a check of a folder fails, unless Snakemake was given this option."""
    try:
        check(Path(folder))
    except DldsimError:  # only now, since the options are not parsed for us
        if not vars(get_argument_parser().parse_known_args(sys.argv[1:])[0])[option]:
            raise


def configurations():
    """What we ship, the files that the user names, the command line: by name, later ones win. Files
    are read once more, because Snakemake drops keys that stand twice and reads 010 as eight."""
    given = workflow.config_settings
    layers = {}
    if not given.replace_workflow_config:
        layers["config.yaml"] = read_layer(Path(workflow.basedir) / "config.yaml")
    layers |= {os.path.relpath(path): read_layer(path) for path in given.configfiles}
    return layers | {"the command line": dict(given.config)}


try:
    LAYERS = configurations()
    *FILES, COMMAND_LINE = LAYERS.values()
    CONFIG = resolve({}, COMMAND_LINE, FILES)
    limits.enforce(CONFIG.limits)
    if workflow.is_main_process:
        logger.info(origins(LAYERS))
    if workflow.is_main_process:
        for folder in filter(os.path.exists, (".", RESULTS)):
            refuse(campaign.check_writable, folder, option="dryrun")
        refuse(check_stamp, RESULTS, option="forceall")
    GEOMETRIES = [identifiers.geometry_id(g) for g in campaign.geometries(CONFIG)]
    OUTCOMES = [identifiers.outcome_id(pair) for pair in campaign.outcomes(CONFIG)]
    VARIANTS = [accuracy.variant_id(v) for v in accuracy.variants(CONFIG)]
    PAIRS = reference_study.pairs(CONFIG)
    SEARCHES = [critical_gaps.search_id(s) for s in critical_gaps.searches(CONFIG)]
except DldsimError as error:
    raise WorkflowError(str(error)) from None

POINTS, LIBRARY, STUDIED = (
    [identifiers.point_id(point) for point in points(CONFIG)]
    for points in (assays.points, assays.points_of_library, assays.study_points)
)
SURVEY = CONFIG.survey.members()
SURVEY_POINTS = [f"{number:04d}" for number in range(len(SURVEY))]
SPOT_CHECKED = spot_check.sample(OUTCOMES, CONFIG.seed)
REQUESTS = [request.name for request in CONFIG.design_requests]


wildcard_constraints:
    geometry=identifiers.GEOMETRY_PATTERN,
    outcome=identifiers.OUTCOME_PATTERN,
    point=identifiers.POINT_PATTERN,
    variant=r"[A-Za-z0-9._-]+--[a-z_]+--\d+--\d+",
    case=r"[a-z-]+",
    request=r"[A-Za-z0-9-]+",
    family=r"[a-z0-9-]+",
    numerics="campaign|domain|reference|finest",
    search=critical_gaps.SEARCH_PATTERN,
    number=r"\d+",
    round=r"\d+",


def watch(made_by):
    """Make what the files of a rule say of their settings count, whatever Snakemake has recorded."""
    if "settings" in made_by.params.keys() and workflow.is_main_process:
        made_by.set_input(partial(remake_if_stale, made_by=made_by))


SAID = set()


def remake_if_stale(wildcards, made_by):
    """No input, but the job is forced if a file of it was made with other settings; say which."""
    settings = made_by.params.settings
    settings = settings(wildcards) if callable(settings) else settings
    files = [apply_wildcards(file, dict(wildcards.items())) for file in made_by.output]
    for difference in filter(None, (freshness.difference(file, settings) for file in files)):
        workflow.dag.forcefiles.update(files)
        if (made_by.name, difference) not in SAID:
            logger.info(f"{made_by.name}: files made with {difference}. They are made anew.")
        SAID.add((made_by.name, difference))
    return []


def settings_of(*sections):
    """Named sections of the configuration as plain values, and the physics version."""
    values = CONFIG.model_dump(mode="json", include=set(sections))
    return {**values, "physics_version": PHYSICS_VERSION}


def gathered(parts, *sections):
    """The same for a table of parts: which parts they are belongs to it."""
    return {**settings_of(*sections), "parts": f"{len(parts)} ({settings_hash(parts)})"}


def seeded(*sections):
    """The same, and the campaign's seed."""
    return settings_of("seed", *sections)


def learning_settings(wildcards):
    """What the surrogate learns from, by content what comes with the package; that it is not there,
    or of other numerics, is told before anything is run."""
    learns, made = CONFIG.surrogate.survey, (CONFIG.numerics, CONFIG.cell, CONFIG.flow)
    try:
        survey = survey_hash(*made) if learns else None
    except DldsimError as error:
        raise WorkflowError(str(error)) from None
    return {**seeded("surrogate"), "survey": survey}


def verified_settings(wildcards):
    return {**gathered(REQUESTS), **learning_settings(wildcards)}


def flow_settings(wildcards):
    numerics = CONFIG.numerics.model_dump(mode="json", exclude=CELL_NUMERICS)
    return {**settings_of("flow"), "numerics": numerics}


def outcome_settings(wildcards):
    stiffness = CONFIG.stiffness_sets[identifiers.parse_outcome(wildcards.outcome).stiffness_set]
    return {
        **settings_of("cell", "flow", "numerics", "run_control"),
        "stiffness": stiffness.model_dump(mode="json"),
    }


def accuracy_settings(wildcards):
    settings = accuracy.settings_for(accuracy.parse_variant(wildcards.variant), CONFIG)
    return {**settings, "physics_version": PHYSICS_VERSION}


def reference_settings(wildcards):
    settings = reference_study.pair_settings(wildcards.outcome, wildcards.numerics, CONFIG)
    return {**settings, "physics_version": PHYSICS_VERSION}


def search_settings(wildcards):
    search = critical_gaps.parse_search(wildcards.search)
    settings = critical_gaps.search_settings(search, CONFIG)
    return {**settings, "physics_version": PHYSICS_VERSION}


def pair_row(outcome, numerics):
    return f"{RESULTS}/reference/pairs/{outcome}--{numerics}.outcome.parquet"


def coarser_cells(wildcards):
    """The settled cells that a pair goes on with at finer numerics."""
    coarser = reference_study.COARSER.get(wildcards.numerics)
    path = f"{RESULTS}/reference/pairs/{wildcards.outcome}--{coarser}.cells.npz"
    return {"coarser": path} if coarser else {}


def search_point(search, number):
    return f"{RESULTS}/reference/searches/{search}--{number}.parquet"


def last_point(search):
    return search_point(search, critical_gaps.POINTS - 1)


def points_before(wildcards):
    """The points so far, and those of the search at the campaign's numerics where it is another."""
    files = {}
    if number := int(wildcards.number):
        files["before"] = search_point(wildcards.search, number - 1)
    search = critical_gaps.parse_search(wildcards.search)
    if search != search.at_campaign:
        files["start"] = last_point(critical_gaps.search_id(search.at_campaign))
    return files


def reference_check_settings(wildcards):
    """By content, not by time stamp, what comes with the package; its absence is told before
    anything is run."""
    shape = CONFIG.cell.shape
    path = uncertainty.STUDIES / shape / "reference_outcomes.parquet"
    if not path.exists():
        raise WorkflowError(
            f"The package holds no reference for cells of shape {shape}. {reference_study.REMEDY}"
        )
    return {
        **gathered(CONFIG.reference.pairs),
        "reference": hashlib.sha256(path.read_bytes()).hexdigest()[:16],
        "sigma_num_model": uncertainty.models_hash(),
    }


def spot_check_release_settings(wildcards):
    settings = outcome_settings(wildcards)
    return {**settings, **spot_check.release_sections(settings)}


def spot_check_settings(wildcards):
    settings = outcome_settings(wildcards)
    return {**settings, **spot_check.check_sections(settings)}


def spot_check_releases(wildcards):
    return spot_check.other_releases(CONFIG.run_control.release_gap_fractions)


def survey_plan_settings(wildcards):
    """What the points of a round depend on; those of the first not on what later ones are."""
    settings = seeded("cell", "flow", "numerics", "stiffness_sets")
    shapes = CONFIG.survey.model_dump(mode="json")["shapes"]
    if wildcards.round == "0":
        shapes = {shape: {**drawn, "round_points": 0} for shape, drawn in shapes.items()}
    flow = {key: settings["flow"][key] for key in FLOW_OF_SURVEY}
    survey = {"rounds": int(wildcards.round), "shapes": shapes}
    return {**settings, "flow": flow, "survey": survey}


def survey_point_settings(wildcards):
    """Shape, velocity and height are the plan's."""
    settings = settings_of("cell", "flow", "numerics", "run_control")
    cell = {key: value for key, value in settings["cell"].items() if key != "shape"}
    flow = {key: settings["flow"][key] for key in FLOW_OF_SURVEY}
    return {**settings, "cell": cell, "flow": flow}


FLOW_OF_SURVEY = ("viscosity_mPa_s", "drive")
SURVEY_CRASHES = f"{RESULTS}/survey/crashes"


def survey_crash_count(wildcards):
    return campaign.count_crashes(Path(SURVEY_CRASHES), wildcards.number)


def survey_before(wildcards):
    """Outcomes of the points of all earlier rounds."""
    return [
        f"{RESULTS}/survey/points/{number}.outcome.parquet"
        for number, member in zip(SURVEY_POINTS, SURVEY, strict=True)
        if member.round < int(wildcards.round)
    ]


def plan_of_point(wildcards):
    """Plan of the round of a point; a number beyond the survey has none."""
    number = int(wildcards.number)
    if number >= len(SURVEY):
        raise WorkflowError(f"The survey has {len(SURVEY)} points, none of number {number}.")
    return f"{RESULTS}/survey/plans/{SURVEY[number].round}.parquet"


def point_settings(wildcards):
    settings = assays.settings_of_point(identifiers.parse_point(wildcards.point), CONFIG)
    return {**settings, "physics_version": PHYSICS_VERSION}


def rows_of(points):
    return expand(f"{RESULTS}/assays/{{point}}.runs.parquet", point=points)


def calibration_settings(points=()):
    """Which assay is the default one, and the published pairs with the stiffness sets they name."""
    settings = settings_of("default_assay", "stiffness_sets")
    tables = {n: a for n, a in CONFIG.assays.items() if a.kind == "table"}
    parts = gathered(points) if points else {}
    pairs = {} if points else {n: a.model_dump(mode="json") for n, a in tables.items()}
    return {**settings, **parts, "published": pairs}


def design_settings(requests, *sections):
    return {
        **seeded("flow", "device", "stiffness_sets", *sections),
        "design_requests": [request.model_dump(mode="json") for request in requests],
        "safety_distance_um": CONFIG.sweep.safety_distance_um,
    }


def candidate_settings(wildcards):
    return {**learning_settings(wildcards), **design_settings(CONFIG.design_requests)}


def verification_settings(wildcards):
    requests = [r for r in CONFIG.design_requests if r.name == wildcards.request]
    sections = ("cell", "numerics", "run_control", "verification")
    return {
        **learning_settings(wildcards),
        **design_settings(requests, *sections),
        "sigma_num_model": uncertainty.models_hash(),
    }


def crash_count(wildcards):
    """How often this job has crashed: one more than last time makes Snakemake try again."""
    [identifier] = wildcards
    return campaign.count_crashes(Path(CRASHES), identifier)


def made(path):
    """The file as an input if it exists; what nobody has asked for is not made."""
    return [path] if Path(path).exists() else []


def flow_of_outcome(wildcards):
    geometry = identifiers.geometry_id(identifiers.parse_outcome(wildcards.outcome).geometry)
    return {
        "flow": f"{RESULTS}/flow/{geometry}.npz",
        "flow_row": f"{RESULTS}/flow/{geometry}.flow.parquet",
    }
