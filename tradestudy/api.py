"""The Python interface: load a study, run it, look at its results, write its report.

>>> import tradestudy
>>> result = tradestudy.load("studies/plenoptic_vs_stereo.yaml").run()
>>> result.data["depth"]
>>> result.figure("whole_range")
"""

from __future__ import annotations

import errno
import os
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tradestudy import provenance
from tradestudy.cost import DEFAULT_BUDGET
from tradestudy.execution.steps import Progress
from tradestudy.result import Result, open_result, shown
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Value
from tradestudy.study.loading import load_definition
from tradestudy.study.options import options
from tradestudy.wording import counted

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.comparison import Comparison
    from tradestudy.execution import Checkpoints, Executor
    from tradestudy.figures.drawn import Drawer
    from tradestudy.imaging.estimation.score import DepthScore
    from tradestudy.plan.plan import Plan
    from tradestudy.study.schema.root import StudyFile


def load(path: str | Path, overrides: Sequence[str] = (), *, tolerance: str | None = None) -> Study:
    """Read a study file and check it.

    Parameters
    ----------
    path
        Path of the study file.
    overrides
        Values that replace those in the file, each as on the command line after ``--set``, such as
        ``"stereo-short.baseline=50 mm"``.
    tolerance
        One tolerance for every quantity, such as ``"1 %"``. Default: the tolerances that the study declares.

    Returns
    -------
    Study
        The study, ready to run.

    Raises
    ------
    StudyError
        If the file, an override or the tolerance contains mistakes. The error lists all of them.
    """
    definition = load_definition(Path(path), tuple(overrides))
    return Study(definition if tolerance is None else definition.with_tolerance(tolerance))


@dataclass(frozen=True)
class Study:
    """A study that has been read and checked; `load` returns it."""

    definition: StudyDefinition

    @property
    def file(self) -> StudyFile:
        """The checked content of the study, in SI units."""
        return self.definition.file

    @property
    def name(self) -> str:
        """Name of the study."""
        return self.file.study

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about implausible values, each as ``FILE:LINE:COLUMN: path: message``.

        A value for which the study states a basis causes no warning.
        """
        from tradestudy.study.plausibility import implausible

        return tuple(map(str, implausible(self.definition)))

    @property
    def imported(self) -> tuple[str, ...]:
        """What was read from calibration files, one line for each imported camera."""
        return self.definition.document.imported

    @property
    def folder_name(self) -> str:
        """Name of the run's folder, made of the study's name, overrides and tolerance."""
        document, tolerance = self.definition.document, self.definition.tolerance
        said = sorted(f"{'.'.join(map(str, one.path))}={one.text or 'none'}" for one in document.overrides)
        said += [] if tolerance is None else [f"tolerance={tolerance}"]
        found = "--".join([self.name, *(_folder_text(one) for one in said)])
        if len(found.encode()) <= _LONGEST_FOLDER:
            return found
        return f"{self.name}--{provenance.study_hash({'set': said})[:12]}"

    def __repr__(self) -> str:
        return f"<Study {self.check_summary()}>"

    @property
    def hash(self) -> str:
        """Hash of the study's content, of its overrides and tolerance, and of the data files that it names."""
        document, tolerance = self.definition.document, self.definition.tolerance
        notes = {".".join(map(str, path)): [note.basis, note.note] for path, note in document.annotations.items()}
        notes |= {
            ".".join(map(str, one.path)): ["set for this run", one.text, one.before] for one in document.overrides
        }
        files = {name: provenance.file_hash(path) for name, path in self.definition.data_files.items()}
        says = {"says": document.tree, "notes": notes, "files": files}
        return provenance.study_hash(says if tolerance is None else {**says, "tolerance": tolerance})

    def check_summary(self) -> str:
        """What the study will compute, in one line."""
        file, case = self.file, self.definition.case
        ends = f" from {case.distance[0]:g} to {case.distance[-1]:g} m" if case.distance.size else ""
        sizes = [
            (len(file.cameras), "camera"),
            (len(case.distance), "distance"),
            (len(file.readings), "reading"),
            (len(file.claims), "claim"),
            (len(file.requirements), "requirement"),
            (0 if file.light_spot is None else 1, "light spot"),
        ]
        words = ", ".join(counted(count, word) + ends * (word == "distance") for count, word in sizes if count)
        return f"{self.name}: {words or 'no mistakes'}"

    def check(self) -> str:
        """Check that the declared tolerances can be met, with any models that the study forces.

        The time of the run is not predicted.

        Returns
        -------
        str
            What the study will compute, in one line.

        Raises
        ------
        UnaffordableError
            If even the most complete models exceed a tolerance.
        StudyError
            If the study forces a model of an effect that occurs in none of its cameras, lenses and light paths.
        """
        forced = set(self.file.effects.forced()) - ({"calibration"} if self.definition.case.cameras else set())
        if forced or self.definition.under_tolerance.entry("accuracy") is not None:
            from tradestudy.plan.choice import choose_models

            choose_models(self.definition)
        return self.check_summary()

    def with_values(self, values: Mapping[str, Value]) -> Study:
        """Return the study with other values.

        Parameters
        ----------
        values : Mapping
            New value, as in a study file, for each dotted path, such as ``{"stereo-short.baseline": "50 mm"}``.

        Returns
        -------
        Study
            The changed study; this one keeps its values.

        Raises
        ------
        StudyError
            If the changed study contains mistakes.
        """
        return Study(self.definition.with_values(values))

    def plan(self) -> Plan:
        """Decide which effects a run simulates and which it leaves out, and predict the time of the run.

        Returns
        -------
        Plan
            The decisions and the time; ``print`` shows them.

        Raises
        ------
        UnaffordableError
            If even the most complete models exceed a tolerance, or the predicted time exceeds the study's time limit.
        """
        from tradestudy.plan.plan import plan_of

        return plan_of(self.definition)

    def cost(
        self,
        progress: Progress = lambda _step, _share: None,
        *,
        budget: float = DEFAULT_BUDGET,
        executor: Executor | None = None,
        checkpoints: Checkpoints | None = None,
    ) -> xr.Dataset:
        """Measure the error and the computing time of each set of models for each camera and light path.

        Parameters
        ----------
        progress
            Function called with the name of the current step and the fraction of it that is done, from 0 to 1.
        budget
            Wall time for all measurements [s]; by default 120. Measurements that would exceed it are left out and
            listed in the result. Calibrations from targets or corners are fitted first, which takes extra time.
        executor
            Executor from `tradestudy.execution`, for the calibrations that are fitted first. Default: this
            process.
        checkpoints
            Where finished parts of these calibrations are stored, so that an interrupted computation can resume.
            Default: nowhere.

        Returns
        -------
        xarray.Dataset
            Group ``cost`` of the results, for `Result.with_cost`.

        Raises
        ------
        OutOfRangeError
            If the budget is not positive and finite, or the study leaves no choice of models.
        UnaffordableError
            If `plan` raises it.
        """
        from tradestudy.cost.study_cost import study_cost
        from tradestudy.execution import Serial, Steps

        steps = Steps(executor=executor or Serial(), checkpoints=checkpoints, progress=progress)
        return study_cost(self.plan(), steps, budget=budget)

    def run(
        self,
        progress: Progress = lambda _step, _share: None,
        *,
        executor: Executor | None = None,
        checkpoints: Checkpoints | None = None,
        planned: Callable[[Plan], None] = lambda _plan: None,
        pictures: Path | None = None,
    ) -> Result:
        """Compute the study.

        Parameters
        ----------
        progress
            Function called with the name of the current step and the fraction of it that is done, from 0 to 1.
        executor
            Executor from `tradestudy.execution`, which computes independent parts of the study on threads, processes or
            a cluster. Default: this process. Every executor gives the same results, to the last bit.
        checkpoints
            Where finished parts are stored, so that an interrupted run can resume. Default: nowhere.
        planned
            Function called with the plan before the computation starts.
        pictures
            Folder in which the pictures of the study's scene are saved. Default: they are not saved.

        Returns
        -------
        Result
            Results and record of the run; `Result.write` writes them to a folder.

        Raises
        ------
        UnaffordableError
            If `plan` raises it.
        """
        from tradestudy.execution import Serial, Steps
        from tradestudy.run.runner import compute

        started = datetime.now(UTC)
        begin = time.perf_counter()
        seconds: dict[str, float] = {}
        steps = Steps(executor=executor or Serial(), checkpoints=checkpoints, progress=progress)
        plan = self.plan()
        planned(plan)
        tree = compute(plan, steps, seconds, pictures)
        seconds["compute"] = time.perf_counter() - begin
        tree.attrs |= {"study_hash": self.hash, "code_hash": provenance.code_hash()}
        record = {
            **self._record(started, seconds),
            "predicted_seconds": round(plan.seconds, 1),
            "points": steps.counts,
        }
        return Result(data=tree, run_record=record)

    def _record(self, started: datetime, seconds: Mapping[str, float]) -> dict[str, Any]:
        return {
            "study": self.name,
            "study_hash": self.hash,
            "code_hash": provenance.code_hash(),
            "seed": self.file.propagation.seed,
            "inputs": provenance.values_by_path(self.definition.under_tolerance.tree),
            "file": self.definition.document.locate(()).file,
            "options": list(options(self.definition)),
            "started": started.isoformat(timespec="seconds"),
            "versions": provenance.versions(),
            "machine": provenance.machine(),
            "seconds": {step: round(value, 3) for step, value in seconds.items()},
        }

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{escape(part.title)}</td><td>{escape(part.kind)}</td></tr>"
            for name, part in self.file.cameras.items()
        )
        return (
            f"<h3>{escape(self.file.title)}</h3><p>{escape(self.file.question)}</p>"
            f"<table><tr><th>camera</th><th>title</th><th>kind</th></tr>{rows}</table>"
        )


_LONGEST_SETTING, _LONGEST_FOLDER = 60, 150


_QUANTITY = re.compile(r"([^=]*=[+-]?[\d.]+(?:e[+-]?\d+)?) (\w+|%)")


def _folder_text(text: str) -> str:
    """A setting as a unique part of a folder's name; one that does not fit completely is identified by its hash."""
    whole = _QUANTITY.sub(r"\1\2", text) if _QUANTITY.fullmatch(text) else text  # "50 mm" and "50mm" are one setting
    plain = re.sub(r"[^\w.+=%-]+|-{2,}", "-", whole).strip("-.")
    if len(plain.encode()) <= _LONGEST_SETTING and plain == whole:
        return plain
    cut = plain.encode()[:_LONGEST_SETTING].decode(errors="ignore")
    return f"{cut}-{provenance.study_hash({'set': text})[:8]}"


def _refuse_file(directory: Path) -> None:
    """Refuse an output folder at the path of a file."""
    nearest = next((one for one in (directory, *directory.absolute().parents) if one.exists()), directory)
    if nearest.exists() and not nearest.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(nearest))


def run(
    study: Study,
    directory: Path,
    *,
    fresh: bool = False,
    pdf: bool = True,
    with_cost: bool = False,
    progress: Progress = lambda _s, _p: None,
    executor: Executor | None = None,
    planned: Callable[[Plan], None] = lambda _plan: None,
) -> Result:
    """Run a study into a folder, reusing what a finished or interrupted run left there.

    Unless ``fresh``, results of the same study and code are not computed again, nor are finished points of an
    interrupted run; the report is always written. The cost of accuracy is measured only ``with_cost``.
    """
    from tradestudy import report as renderer
    from tradestudy.execution import Checkpoints
    from tradestudy.results import storage

    _refuse_file(directory)  # before anything is computed
    result = None if fresh else _finished(study, directory)
    measuring = with_cost and (result is None or "cost" not in result.data.children)
    if measuring:
        from tradestudy.cost.study_cost import require_prices

        require_prices(study.definition)  # before anything is computed
    with closing(Checkpoints(directory, fresh=fresh)) as checkpoints:
        if result is None or measuring:
            with _background_drawer() as drawer:
                if result is None:
                    result = study.run(
                        progress,
                        executor=executor,
                        checkpoints=checkpoints,
                        planned=planned,
                        pictures=directory / "pictures",
                    )
                if measuring:
                    result = result.with_cost(study.cost(progress, executor=executor, checkpoints=checkpoints))
                progress("report", 0.0)
                result.write(directory, pdf=pdf, drawer=drawer)
        else:
            progress("report", 0.0)
            storage.remove_abandoned(directory)
            renderer.write(result.data, result.run_record, directory, pdf=pdf)
        checkpoints.remove()
    progress("report", 1.0)
    return result


@dataclass(frozen=True, kw_only=True)
class RenderedScene:
    """What `render` has written.

    Parameters
    ----------
    pictures
        Files of the pictures; beside each is its true depth, and for each camera ``camera.json`` and its depth map.
    depths
        Comparison of each camera's depth map with the true depth; empty unless depth was requested.
    """

    pictures: Sequence[Path]
    depths: Mapping[str, DepthScore]


def render(
    study: Study,
    directory: Path,
    *,
    depth: bool = False,
    fresh: bool = False,
    progress: Progress = lambda _s, _p: None,
    executor: Executor | None = None,
) -> RenderedScene:
    """Write only the pictures of the study's scene, with the true depth and a description of each camera.

    Unless ``fresh``, an interrupted rendering resumes.

    Parameters
    ----------
    study, directory
        The study, and the output folder.
    depth
        Whether to measure depth in the pictures, too, and write the depth maps beside them.
    fresh
        Whether to discard what an interrupted rendering has left.
    progress, executor
        As for `Study.run`.

    Raises
    ------
    StudyError
        If the study has no ``scene.image``.
    UnaffordableError
        If the pictures do not fit into the free memory.
    OutOfRangeError
        If a camera cannot measure depth in its pictures, or a matcher is not installed.
    """
    from tradestudy.analysis.scene_pictures import declared_image
    from tradestudy.execution import Checkpoints, Serial, Steps
    from tradestudy.run.inference import infer_calibrations
    from tradestudy.run.scene_pictures import take_scene

    declared_image(study.definition)  # before calibrations are inferred
    folder = directory / "pictures"
    with closing(Checkpoints(folder, fresh=fresh)) as checkpoints:
        steps = Steps(executor=executor or Serial(), checkpoints=checkpoints, progress=progress)
        definition, _ = infer_calibrations(study.definition, steps)
        taken = take_scene(definition, folder, steps, depth=depth)
        checkpoints.remove()
    return RenderedScene(pictures=taken.written, depths={one.camera: one.score for one in taken.depths})


def export(
    study: Study, camera: str, directory: Path, *, formats: Sequence[str] = (), lossy: bool = False
) -> tuple[list[Path], tuple[str, ...]]:
    """Write a declared or fitted camera as calibration files of other programs and as a posterior.

    Parameters
    ----------
    study
        The study.
    camera
        Name of the camera.
    directory
        Output folder.
    formats
        Any of opencv, ros, kalibr, mrcal and posterior; empty means all.
    lossy
        Whether to leave out what a format cannot represent, instead of refusing.

    Returns
    -------
    list of Path, tuple of str
        The files, and what they leave out, in words.

    Raises
    ------
    TradestudyError
        If there is no such camera, a format cannot represent it, or its calibration cannot be fitted.
    """
    from tradestudy.run.export import export, write_export

    found = export(study.definition, camera, formats, lossy=lossy)
    return write_export(found, directory, camera), found.left_out


def _background_drawer() -> AbstractContextManager[Drawer | None]:
    """A process that draws figures on another core, if there is one; it loads libraries while results are computed."""
    from tradestudy.figures.drawn import drawer

    return drawer() if provenance.cores() > 1 and sys.executable else nullcontext()


def _finished(study: Study, directory: Path) -> Result | None:
    """Results of an earlier run in a folder, if they are complete and from this study and this code."""
    from tradestudy.errors import ResultsError

    try:
        result = open_result(directory)
    except ResultsError:
        return None
    of = result.data.attrs
    same = of.get("study_hash") == study.hash and of.get("code_hash") == provenance.code_hash()
    return result if same else None


def report(directory: str | Path, *, pdf: bool = True) -> None:
    """Write the report of a finished run again, with identical bytes.

    Raises
    ------
    ResultsError
        If the folder contains no readable run, or one of another version that lacks data.
    """
    from tradestudy import report as renderer

    with _background_drawer() as drawer:
        result = open_result(directory)
        drawing = None if drawer is None else drawer.begin(result.data)
        with shown({str(directory): result}):
            renderer.write(result.data, result.run_record, Path(directory), pdf=pdf, drawing=drawing)


def cost(
    study: Study, directory: Path, *, budget: float = DEFAULT_BUDGET, progress: Progress = lambda _s, _p: None
) -> list[str]:
    """Measure what accuracy costs and write ``cost.json`` and ``cost.svg``, which are not part of a run.

    Returns
    -------
    list of str
        A sentence for each camera and picture of the study, and the path of the figure.
    """
    from xarray import DataTree

    from tradestudy import figures
    from tradestudy.cost.study_cost import cost_json
    from tradestudy.report.document import plain_text
    from tradestudy.report.sections.cost import answers
    from tradestudy.results.storage import replace_file

    found = study.cost(progress, budget=budget)
    drawings = figures.build(DataTree.from_dict({"/cost": found}))
    written = {"cost.json": cost_json(study.name, found).encode()}
    written |= {f"{name}.svg": drawing.draw().svg() for name, drawing in drawings.items()}
    for name, content in written.items():
        replace_file(directory / name, content)
    return [*(plain_text(answer) for answer in answers(found)), str(directory / list(written)[-1])]


def compare(directories: Sequence[str | Path]) -> Comparison:
    """Find conclusions and inputs that differ between finished runs, and results that differ by more than their errors.

    Parameters
    ----------
    directories
        Folders of the runs, at least two.

    Returns
    -------
    Comparison
        The differences. ``print`` shows them as text, ``html()`` returns them as a page, and ``overlay`` is a figure of
        the curves that differ, or None.

    Raises
    ------
    OutOfRangeError
        If there are fewer than two folders.
    ResultsError
        If a folder contains no readable run, or the run lacks data because another version of the program wrote it.
    """
    from tradestudy.comparison import compare_runs

    results = [open_result(directory) for directory in directories]
    names = [str(directory) for directory in directories]
    with shown(dict(zip(names, results, strict=True))):
        return compare_runs(names, [result.run_record for result in results], [result.data for result in results])


def schema() -> dict[str, Any]:
    """Return the JSON Schema of study files.

    Returns
    -------
    dict
        The schema, for editors and validators.
    """
    from tradestudy.study.schema.editor import editor_schema
    from tradestudy.study.schema.root import StudyFile

    return editor_schema(StudyFile)
