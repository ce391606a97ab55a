"""One process of the pool: takes jobs from the queue, one after the other, and does them.

Started as ``python -m dldsim.app.web.api.worker LANE NAME SETTINGS`` with a pipe as standard
input: a line wakes it up, the end of the pipe ends it, so that no worker outlives the service.
"""

import contextlib
import hashlib
import importlib
import json
import os
import shutil
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dldsim.app import design_answers, outcome_answers
from dldsim.app.web.api import answers, outcome_specs, specs
from dldsim.app.web.api.data import Data, table_rows
from dldsim.app.web.api.devices import answer_of, at_outlets, outcomes_of
from dldsim.app.web.api.settings import Settings
from dldsim.app.web.api.store import VERIFICATION, Job, Store
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY

REPORT_EVERY_S = 0.3
NEEDED = ("optuna", "scipy.stats", "xgboost", "dldsim.report.design_page", "ezdxf", "gdstk")
"""Slow imports of a search and its files."""
IDLE_S = 60.0
"""After so long without work a simulating process ends, and its memory is free."""


class Cancelled(BaseException):
    """The job is no longer this worker's; no DldsimError, which a search might catch."""


class Worker:
    def __init__(self, settings: Settings, lane: str, name: str):
        self.settings, self.lane, self.name = settings, lane, name
        self.store = Store(settings.state)
        self.data = Data(settings, self.store)
        self.woken = threading.Event()

    def run(self) -> None:
        threading.Thread(target=self._listen, daemon=True).start()
        self._warm_up()
        busy = time.monotonic()
        while True:
            job = self.store.claim(self.lane, self.name)
            if job is not None:
                self._do(job)
                busy = time.monotonic()
            elif self.lane == VERIFICATION and time.monotonic() - busy > IDLE_S:
                return
            else:
                self.woken.wait(1.0)
                self.woken.clear()

    def _listen(self) -> None:
        while os.read(0, 4096):
            self.woken.set()
        os._exit(0)

    def _warm_up(self) -> None:
        """Import what a search and its files need and read the campaign, before somebody waits."""
        with contextlib.suppress(DldsimError):  # told with every answer, and by health
            if self.lane != VERIFICATION:
                for name in NEEDED:
                    importlib.import_module(name)
                self.data.own()

    def _do(self, job: Job) -> None:
        work = {
            "design": self._design,
            "optimize": self._design,
            "campaign": self._campaign,
            "verification": self._verification,
            "check": self._check,
        }[job.kind]
        try:
            work(job)
        except Cancelled:
            pass
        except DldsimError as error:
            self.store.finish(job, error=str(error))
        except MemoryError:
            self.store.finish(
                job,
                error="There was not enough memory for it. Ask for fewer "
                "trials, draws or grid steps.",
            )
        except Exception as error:
            sys.stderr.write(traceback.format_exc())
            self.store.finish(
                job,
                error=f"The program failed: {error!r:.300}. This is a defect of "
                "the service; its log has the details.",
            )

    # ------------------------------------------------------------------------------------- kinds

    def _design(self, job: Job) -> None:
        clock = time.perf_counter()
        spec = specs.DesignSpec(**job.spec)
        source = self.data.source(spec.campaign)
        seconds = {"load": time.perf_counter() - clock}
        progress = _Course(self, job, spec)
        clock = time.perf_counter()
        _, _, budget = self.settings.campaign()
        made = design_answers.make_designs(
            spec.request, source.known, spec.seed, budget, progress.trial, spec.measured
        )
        seconds["search"] = time.perf_counter() - clock
        clock = time.perf_counter()
        result = result_of(made, source)
        seconds["result"] = time.perf_counter() - clock
        progress.end(result)
        document = self._document(result, seconds, made, source)
        if not self.store.keep_result(job, document):
            raise Cancelled
        files = []
        if job.kind == "design":
            clock = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                design_answers.write_designs(made, source.known, Path(folder))
                files = files_of(Path(folder), spec.name)
            seconds["files"] = time.perf_counter() - clock
        progress.report("done")
        self.store.finish(job, result=self._document(result, seconds, made, source), files=files)

    @staticmethod
    def _document(result: Mapping, seconds: Mapping, made, source) -> str:
        about = source.provenance.model_copy(
            update={"config_hash": made.about["config_hash"], "seed": made.about["seed"]}
        )
        answer = answers.DesignResult(**result, seconds=dict(seconds))
        return f'{{"result":{answer.model_dump_json()},"provenance":{about.model_dump_json()}}}'

    def _verification(self, job: Job) -> None:
        spec = specs.DesignSpec(**job.spec)
        source = self.data.source(spec.campaign)
        known = source.known
        say = _Sentences(self, job)
        say("searching")
        _, _, budget = self.settings.campaign()
        made = design_answers.make_designs(
            spec.request,
            known,
            spec.seed,
            budget,
            lambda row: say(f"searching, trial {row['trial']}"),
            spec.measured,
        )
        with self._kept(job) as work, tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            verdicts = design_answers.verify_request(
                spec.request,
                made.settings,
                known.chip,
                known.model,
                known.tables,
                work=work,
                files=folder / "files",
                progress=say,
                measured=spec.measured,
            )
            design_answers.write_designs(made, known, folder, verdicts)
            files = files_of(folder, spec.name)
            result = answers.Verdict(
                state="done",
                message="",
                elapsed_s=say.elapsed_s,
                designs=table_rows("verified_designs", verdicts.designs),
                verifications=table_rows("verifications", verdicts.verifications),
            )
            self.store.finish(job, result=result.model_dump_json(), files=files)

    def _check(self, job: Job) -> None:
        spec = outcome_specs.CheckSpec(**job.spec)
        source = self.data.source(spec.campaign)
        asked, designs, found = outcomes_of(spec, source)
        with self._kept(job) as work:
            tables = outcome_answers.check_by_simulation(
                asked,
                designs[0],
                found[0],
                source.known,
                spec.simulate,
                spec.seed,
                work,
                _Sentences(self, job),
                processes=1,  # of the pool, which ends with the service
            )
            result = answers.CheckAnswer(
                **answer_of(asked, designs, found, source),
                **{kind: table_rows(kind, table) for kind, table in tables.items()},
            )
            self.store.finish(job, result=result.model_dump_json())

    @contextlib.contextmanager
    def _kept(self, job: Job) -> Iterator[Path]:
        """Folder of what a job has simulated, kept between its attempts: until it is done or
        cancelled, or cannot be done. Its name is an id of this service."""
        work = self.settings.state / "outcomes" / job.id
        try:
            yield work
        except (DldsimError, Cancelled):
            shutil.rmtree(work, ignore_errors=True)
            raise
        shutil.rmtree(work, ignore_errors=True)

    def _campaign(self, job: Job) -> None:
        source, parts = self.data.fit(job.id, job.spec)
        card = {k: v for k, v in source.known.model.card.items() if k not in ("domain",)}
        about = source.provenance.model_dump_json()
        text = json.dumps(answers.finite(card))
        self.store.finish(job, result=f'{{"card":{text},"provenance":{about}}}', parts=parts)


class _Sentences:
    """Notes what a simulation says in the store, a few times a second."""

    def __init__(self, worker: Worker, job: Job):
        self.worker, self.job = worker, job
        self.start, self.last = time.perf_counter(), 0.0

    @property
    def elapsed_s(self) -> float:
        return time.perf_counter() - self.start

    def __call__(self, sentence: str) -> None:
        if time.perf_counter() - self.last > REPORT_EVERY_S:
            self.last = time.perf_counter()
            said = {"message": sentence, "elapsed_s": self.elapsed_s}
            if not self.worker.store.report(self.job, said):
                raise Cancelled


class _Course:
    """Notes the trials of a search in the store, a few times a second."""

    def __init__(self, worker: Worker, job: Job, spec: specs.DesignSpec):
        self.worker, self.job = worker, job
        self.trials = spec.trials
        if spec.sampler == "grid":
            low, high = spec.periodicity
            self.trials = spec.grid_steps**2 * (high - low + 1)
        self.done, self.best, self.convergence = 0, None, []
        self.start, self.last = time.perf_counter(), 0.0
        self.report("search")

    def trial(self, row: Mapping[str, Any]) -> None:
        from dldsim.analysis.domain import DOMAIN_TOLERANCE

        self.done = row["trial"] + 1
        if row["feasible"] and (self.best is None or row["value"] > self.best["value"]):
            self.best = {
                k: row[k] for k in answers.Best.model_fields if k != "inside_training_domain"
            }
            self.best["inside_training_domain"] = bool(row["outside"] <= DOMAIN_TOLERANCE)
        self.convergence.append(None if self.best is None else self.best["value"])
        if time.perf_counter() - self.last > REPORT_EVERY_S:
            self.report("search")

    def end(self, result: Mapping[str, Any]) -> None:
        """The course of a finished search, which a grid has only then."""
        self.done = self.trials
        self.convergence = result["convergence"]
        if self.best is None:
            self.best = {
                k: v for k, v in result["designs"][0].items() if k in answers.Best.model_fields
            } | {"trial": 0}
            same = [
                t["trial"] for t in result["trials"] if all(t[k] == self.best[k] for k in GEOMETRY)
            ]
            self.best["trial"] = same[0] if same else 0
        self.report("files")

    def report(self, stage: str) -> None:
        self.last = time.perf_counter()
        elapsed = self.last - self.start
        left = elapsed / self.done * (self.trials - self.done) if self.done else None
        known = self.worker.store.report(
            self.job,
            {
                "stage": stage,
                "trial": self.done,
                "trials": self.trials,
                "best": self.best,
                "convergence": self.convergence,
                "elapsed_s": elapsed,
                "left_s": left,
            },
        )
        if not known:
            raise Cancelled


GRID_TRIALS = 2000
"""Trials of a grid that an answer holds, best first; the tables have all."""


def result_of(made: design_answers.Made, source) -> dict[str, Any]:
    """The tables of a search as an answer."""
    from dldsim.report.design_figures import best_so_far

    found, request = made.found, made.request.model_dump()
    for population in made.populations:
        request[f"deformation_index_{population.number}"] = population.deformation_index
        request[f"deformation_index_std_{population.number}"] = population.deformation_index_std
    trials = found.trials
    if len(trials) > GRID_TRIALS:
        trials = trials.nlargest(GRID_TRIALS, "value")
    best = best_so_far(found.trials)["best"]
    return {
        "request": request,
        "populations": table_rows("design_populations", found.populations),
        "designs": table_rows("designs", found.designs),
        "trials": table_rows("design_trials", trials),
        "convergence": answers.finite(best.iloc[:: max(1, len(best) // GRID_TRIALS)].tolist()),
        "tolerances": table_rows("design_tolerances", found.tolerances),
        "importance": table_rows("design_importance", found.importance),
        "slices": table_rows("design_slices", found.slices),
        "at_outlets": at_outlets(made.devices, made.notes),
        "warnings": warnings_of(made, source),
    }


def warnings_of(made: design_answers.Made, source) -> list[str]:
    """What a user must know before the numbers."""
    from dldsim.design.populations import doubt

    found = made.found
    texts = [*filter(None, [doubt(made.populations)]), *source.provenance.warnings]
    first = found.designs.iloc[0]
    if not first["inside_training_domain"]:
        texts.append(
            "The best candidate lies outside the arrays that were simulated: its angles "
            "are extrapolated."
        )
    outside = int((~found.designs["inside_training_domain"]).sum())
    if outside and first["inside_training_domain"]:
        texts.append(
            f"{outside} of {len(found.designs)} candidates lie outside the arrays that "
            "were simulated; they are ranked behind the others."
        )
    if first["separation_deg"] <= first["uncertainty_deg"]:
        texts.append("The best separation is smaller than its uncertainty: it is not resolved.")
    if first["robust_separation_deg"] <= 0:
        texts.append(
            "With spread of the cells, error of the prediction and fabrication tolerance "
            "not even the order of the two cell types is sure."
        )
    return texts


def files_of(folder: Path, name: str) -> list[dict[str, Any]]:
    """Files of a design for the store: of candidates, of simulated designs, and the report."""
    found = []
    for path in sorted([folder / "report.html", *(folder / "files").iterdir()]):
        kind = {
            ".json": "json",
            ".csv": "csv",
            ".gds": "gds",
            ".dxf": "dxf",
            ".html": "report",
        }.get(path.suffix)
        if kind is None:
            continue
        label = path.stem.removeprefix(f"{name}-")
        candidate, verified = None, None
        if kind == "report":
            target = f"{name}-report.html"
        elif label.startswith("candidate-"):
            candidate, target = int(label.removeprefix("candidate-")), path.name
        else:
            verified, target = int(label), path.name
        content = path.read_bytes()
        found.append(
            {
                "name": target,
                "kind": kind,
                "candidate": candidate,
                "verified": verified,
                "sha256": hashlib.sha256(content).hexdigest(),
                "bytes": len(content),
                "content": content,
            }
        )
    return found


if __name__ == "__main__":
    lane, name, text = sys.argv[1:]
    Worker(Settings.model_validate_json(text), lane, name).run()
