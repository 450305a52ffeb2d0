"""A study as Python sees it: loaded from its file, changed, checked, planned and run."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TextIO, cast

from tradestudy import provenance
from tradestudy.errors import OutOfRangeError
from tradestudy.models import DEFAULT_BUDGET
from tradestudy.result import Result
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import DICTIONARY, OF_PYTHON, Document, Value, plain
from tradestudy.study.edits import overridden
from tradestudy.study.loading import checked, read, read_text, read_values, with_questions_checked
from tradestudy.study.plausibility import implausible, warn
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.python_values import new_value, plain_value
from tradestudy.study.schema.root import FORMAT
from tradestudy.study.writing import options, standalone, yaml_of
from tradestudy.wording import counted

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.answers.calibration import Corners
    from tradestudy.camera_object import Camera
    from tradestudy.execution import Checkpoints, Executor
    from tradestudy.execution.steps import Progress
    from tradestudy.models.plan import Plan
    from tradestudy.study.schema.root import StudyFile


def load(
    source: str | Path | TextIO | Mapping[str, Any], overrides: Sequence[str] = (), *, tolerance: str | None = None
) -> Study:
    """Read a study and check it.

    Parameters
    ----------
    source
        Path of the study file, an open text stream, or a dictionary; see `Study.from_dict`. Files that a stream names
        are sought beside the file that it reads, or else in the current folder.
    overrides
        Values that replace those of the study, each as on the command line after ``--set``, such as
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
        If the study, an override or the tolerance contains mistakes. The error lists all of them.
    """
    if isinstance(overrides, str):
        raise OutOfRangeError(
            "overrides", value=repr(overrides), limit="a list of texts", remedy=f"write [{overrides!r}]"
        )
    definition = checked(overridden(_document(source), overrides))
    study = Study(definition if tolerance is None else definition.with_tolerance(tolerance))
    if isinstance(source, Mapping):
        warn(*study._warnings_of_python)
    return study


def _document(source: str | Path | TextIO | Mapping[str, Any]) -> Document:
    """The document of a study that is a file, a text stream or a dictionary."""
    if isinstance(source, Mapping):
        return read_values(cast(Mapping[str, Value], plain_value({**_UNNAMED, **source})))
    if isinstance(source, str) and "\n" in source:
        remedy = "load(io.StringIO(text)) reads text"
        raise OutOfRangeError("a study", value="a text of several lines", limit="the path of a file", remedy=remedy)
    if isinstance(source, str | Path):
        return read(Path(source))
    if not (hasattr(source, "read") and isinstance(text := source.read(), str)):
        expected = "a path, a text stream or a dictionary"
        raise OutOfRangeError("a study", value=type(source).__name__, limit=expected)
    name = getattr(source, "name", None)
    return read_text(text, name if isinstance(name, str) else "text")


def camera(
    kind: str,
    *,
    scene: Mapping[str, Any] | None = None,
    usable_range: Mapping[str, Any] | None = None,
    **values: Any,
) -> Camera:
    """Make a camera without a study.

    Parameters
    ----------
    kind
        Kind of camera: ``"stereo"``, ``"focused-plenoptic"``, ``"unfocused-plenoptic"`` or ``"conventional"``.
    scene
        The key ``scene`` of a study. Default: distances from 0.1 to 10 m, and light of 550 nm. The models of depth
        hold, and `Camera.usable_range` is sought, within these distances.
    usable_range
        The key ``usable_range`` of a study. Default: no limits beyond those of the camera itself.
    **values
        The keys of the camera in a study file, as for `Camera.replace`: numbers in SI, text with units, quantities of
        pint, and dictionaries of these. ``note``, ``title`` and all other optional keys have the same defaults.

    Returns
    -------
    Camera
        The camera; messages call it by its kind.

    Raises
    ------
    StudyError
        If a value is missing or wrong, or no camera can have these values.
    """
    if not isinstance(kind, str):
        raise TypeError(
            f"the kind of a camera is text, not a {type(kind).__name__}; write camera(**values) for a dictionary"
        )
    study = {
        "study": "camera",
        "title": "A single camera",
        "cameras": {kind: {"kind": kind, **values}},
        "scene": _SCENE if scene is None else scene,
        **({} if usable_range is None else {"usable_range": usable_range}),
    }
    return Study.from_dict(study).cameras[kind]


_UNNAMED: Final = {
    "format": FORMAT,
    "study": "study",
    "title": "A study from Python",
    "question": "Which results do these values give?",
}
_SCENE: Final = {"distances": {"from": 0.1, "to": 10.0, "points": 61}, "wavelength": 550e-9}


@dataclass(frozen=True, eq=False)
class Study:
    """A study that has been read and checked; `load` returns it.

    Studies are equal if they ask the same of the same cameras: the same values in SI with the same bases, from the same
    content of data files, wherever they are written. They can be pickled, hashed, and sent to other processes.
    """

    definition: StudyDefinition

    def __post_init__(self) -> None:
        if isinstance(self.definition, Mapping):
            raise TypeError("Study.from_dict and tradestudy.load make a study from a dictionary")

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Study:
        """Make a study from nested dictionaries with the keys of study files.

        Parameters
        ----------
        values
            The content of a study file. Numbers are in SI where a quantity is expected. Quantities of pint and arrays
            of numpy, such as distances, are accepted anywhere. Files are sought in the current folder. Without
            ``format``, the current one is meant; ``study``, ``title`` and ``question`` have defaults.

        Returns
        -------
        Study
            The study, ready to run.

        Raises
        ------
        StudyError
            If it contains mistakes. The error lists all of them, each with its path.
        """
        return load(values)

    @cached_property
    def _content(self) -> tuple[str, str, str]:
        """What equal studies have in common."""
        placed = standalone(self.definition)
        files = {str(path): provenance.file_hash(file) for path, file in placed.data_files.items()}
        return repr(placed.file), repr(sorted(placed.document.annotations.items(), key=repr)), repr(files)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Study) and self._content == other._content)

    def __hash__(self) -> int:
        return hash(self._content)

    def __reduce__(self) -> tuple[type[Study], tuple[StudyDefinition]]:
        return Study, (self.definition,)

    def to_yaml(self) -> str:
        """The text of a study file for an equal study, complete without the files of its cameras.

        Values have their units and bases. The names of data files, such as detected corners, are absolute.
        """
        return yaml_of(standalone(self.definition).under_tolerance.root)

    @cached_property
    def prepared(self) -> PreparedStudy:
        """The study as its computations take it, before any model is chosen."""
        return PreparedStudy(self.definition)

    @property
    def file(self) -> StudyFile:
        """The checked content of the study, in SI units."""
        return self.definition.file

    @property
    def name(self) -> str:
        """Name of the study."""
        return self.file.study

    @cached_property
    def cameras(self) -> Mapping[str, Camera]:
        """The cameras by name, with their properties and their depth errors at any distance."""
        from tradestudy.camera_object import Cameras  # heavy, and commands do not need it

        return Cameras(self.prepared)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about implausible values, each as ``FILE:LINE:COLUMN: path: message``.

        Those about values given outside the file have no place. A value for which the study states a basis causes no
        warning. A study from a dictionary also gives them as `ImplausibleValueWarning`, and so does `with_values` with
        new ones.
        """
        return tuple(warning.message for warning in implausible(self.prepared))

    @cached_property
    def _warnings_of_python(self) -> tuple[str, ...]:
        """Those about values that are in no file."""
        return tuple(warning.message for warning in implausible(self.prepared) if warning.file in OF_PYTHON)

    @property
    def imported(self) -> tuple[str, ...]:
        """What was read from calibration files, one line for each imported camera."""
        return tuple(map(str, self.definition.document.imported))

    @property
    def folder_name(self) -> str:
        """Name of the run's folder, made of the study's name, overrides and tolerance."""
        document, tolerance = self.definition.document, self.definition.tolerance
        settings = sorted(
            f"{'.'.join(map(str, override.path))}={override.text or 'none'}" for override in document.overrides
        )
        settings += [] if tolerance is None else [f"tolerance={tolerance}"]
        folder = "--".join([self.name, *(_folder_text(setting) for setting in settings)])
        if len(folder.encode()) <= _LONGEST_FOLDER:
            return folder
        return f"{self.name}--{provenance.study_hash({'set': settings})[:12]}"

    def __repr__(self) -> str:
        return f"<Study {self.check_summary()}>"

    @property
    def hash(self) -> str:
        """Hash of the study's content, of its overrides and tolerance, and of the data files that it names."""
        document, tolerance = self.definition.document, self.definition.tolerance
        notes = {".".join(map(str, path)): [note.basis, note.note] for path, note in document.annotations.items()}
        notes |= {
            ".".join(map(str, override.path)): ["set for this run", override.text, override.before]
            for override in document.overrides
        }
        files = {name: provenance.file_hash(path) for name, path in self.definition.data_files.items()}
        says = {"says": document.tree, "notes": notes, "files": files}
        return provenance.study_hash(says if tolerance is None else {**says, "tolerance": tolerance})

    def check_summary(self) -> str:
        """Return what the study will compute, in one line, without checking the tolerances."""
        file, case = self.file, self.prepared.case
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
        return f"{self.name}: {words}{'; ' * bool(words)}no mistakes"

    def check(self) -> str:
        """Check that the declared tolerances can be met, with the models that the study prescribes (key `effects`).

        A fit to a few views, in about a second, checks corners.

        Returns
        -------
        str
            The line that `check_summary` returns.

        Raises
        ------
        UnaffordableError
            If even the most complete models exceed a tolerance, or pictures do not fit into the free memory.
        StudyError
            If no rig fits the corners, they contradict the declared one, or too few views show a target; if pictures
            cannot be rendered, or depth cannot be measured in them; or if the study prescribes a model for an effect
            that none of its cameras, lenses or light paths has.
        """
        self._refuse_pictures()
        forced = set(self.file.effects.forced()) - ({"calibration"} if self.prepared.case.cameras else set())
        has_spot = self.file.light_spot is not None  # whose picture depends on the chosen models
        if forced or has_spot or self.definition.under_tolerance.entry("accuracy") is not None:
            from tradestudy.models.choice import choose_models, refuse_chosen_spot

            refuse_chosen_spot(self.prepared, choose_models(self.prepared))
        self._refuse_calibrations("few views")
        return self.check_summary()

    def with_values(self, values: Mapping[str, Any]) -> Study:
        """Return the study with other values.

        Parameters
        ----------
        values : Mapping
            New value for each dotted path, such as ``{"stereo-short.baseline": "50 mm"}``: text as in a study file, a
            number in SI, an array with one, or a value as for `from_dict`.

        Returns
        -------
        Study
            The changed study; this one keeps its values.

        Raises
        ------
        StudyError
            If the changed study contains mistakes.
        TypeError
            If the values are not a mapping.
        """
        if not isinstance(values, Mapping):
            raise TypeError(
                f"values by their paths are expected, such as {{'scene.distances.to': 2.0}}, not {values!r}"
            )
        entry = self.definition.document.entry
        new_values = {
            path: new_value(path, value, plain(old) if isinstance(path, str) and (old := entry(path)) else None)
            for path, value in values.items()
        }
        changed = Study(with_questions_checked(self.definition.with_values(new_values, numbers_in_si=True)))
        if warnings := changed._warnings_of_python:
            warn(*(warning for warning in warnings if warning not in self._warnings_of_python))
        return changed

    def sweep(self, values: Mapping[str, Any], what: str | Sequence[str] = "depth") -> xr.Dataset:
        """Compute depth for every combination of values, and nothing else.

        Parameters
        ----------
        values : Mapping
            A list or an array of values for each dotted path, such as ``{"stereo-short.baseline": [0.02, 0.05]}``, in
            the forms that `with_values` takes. Values of the scene, which all designs share, cannot be swept.
        what
            Variables to compute, of those in the group ``/depth`` of results. ``"uncertainty"``, ``"error radius"``,
            ``"quantiles"`` and ``"usable range"`` stand for ``depth_uncertainty``, ``depth_error_radius``,
            ``depth_quantile`` and the pair of ``usable_near`` and ``usable_far``; ``"depth"`` for the first and third.
            These, except for the usable range, ``"relative_uncertainty"``, ``"failed_fraction"`` and ``"usable"`` are
            fast.

        Returns
        -------
        xarray.Dataset
            The variables over the swept parameters and their own dimensions, the fast ones for all errors together, as
            a run computes them if the study has this sweep and no readings, claims or inverse questions. The dimension
            of a swept parameter is named after the last key of its path, as in results; its coordinate has the values
            in SI, in the given order, and the path in the attribute ``path``.

        Raises
        ------
        StudyError
            If a value is wrong or given twice.
        UnaffordableError
            If there are more than 20 000 combinations, or even the most complete models exceed a tolerance.
        """
        from tradestudy.camera_object import sweep

        if not isinstance(values, Mapping):
            form = "a dictionary of paths and their values"
            remedy = "write {'camera.baseline': [0.05, 0.1]}"
            raise OutOfRangeError("the swept values", value=f"{values!r:.60}", limit=form, remedy=remedy)
        return sweep(self.prepared, values, what)

    def plan(self) -> Plan:
        """Decide which effects a run simulates and which it leaves out, and name its slow steps.

        Returns
        -------
        Plan
            The decisions, and the slow steps by order of magnitude; ``print`` shows them.

        Raises
        ------
        UnaffordableError
            If even the most complete models exceed a tolerance, or the run would take far longer than its
            time limit.
        StudyError
            As for `check`; corners are fitted in all views, which takes some seconds.
        """
        return self._plan("all views")

    def _plan(self, corners: Corners) -> Plan:
        """The plan; a run fits corners itself."""
        from tradestudy.answers.trade_criteria import refuse_words

        refuse_words(self.prepared)
        self._refuse_pictures()
        self._refuse_calibrations(corners)
        return self._chosen

    @cached_property
    def _chosen(self) -> Plan:
        """The plan, chosen once for all who ask."""
        from tradestudy.models.plan import plan_of

        return plan_of(self.prepared)

    def _refuse_calibrations(self, corners: Corners) -> None:
        """Refuse calibrations that a run would refuse; see `refuse_calibrations`."""
        if any(form.posterior_keys for form in (self.definition, *self.definition.readings.values())):
            from tradestudy.answers.calibration import refuse_calibrations  # heavy, and few studies infer calibrations

            refuse_calibrations(self.prepared, corners=corners)

    def _refuse_pictures(self) -> None:
        """Refuse pictures and point spreads that a run would refuse; see `refuse_pictures` and `refuse_picture`."""
        scene, spot = self.file.scene, self.file.light_spot
        if spot is not None and spot.methods:
            from tradestudy.answers.claims import compared_spots
            from tradestudy.models.light_trial import refuse_picture
            from tradestudy.models.spot_images import compared_models

            claimed = compared_spots(self.prepared)
            for part, method in dict.fromkeys([*((spot, method) for method in spot.methods), *claimed]):
                refuse_picture(part, compared_models(part, method), "light_spot.tolerance, for compared pictures")
        if self.file.point_spread is not None:
            from tradestudy.models.point_spreads import refuse_spreads

            refuse_spreads(self.file.point_spread)
        if self.file.fresnel_validity is not None:
            from tradestudy.models.point_spreads import refuse_comparison

            refuse_comparison(self.file.fresnel_validity)
        if self.file.depth_loop is not None or (scene is not None and scene.image is not None):
            from tradestudy.answers.scene import refuse_pictures

            refuse_pictures(self.prepared)

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
            listed in the result. Calibrations that the study declares by calibration boards (targets) or by detected
            corners are fitted first, which takes extra time.
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
        from tradestudy.answers.cost import study_cost
        from tradestudy.execution import Serial, Steps

        steps = Steps(executor=executor or Serial(), checkpoints=checkpoints, progress=progress)
        return study_cost(self._plan("not fitted"), steps, budget=budget)

    def run(
        self,
        progress: Progress = lambda _step, _share: None,
        *,
        executor: Executor | None = None,
        checkpoints: Checkpoints | None = None,
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
        pictures
            Folder in which the pictures of the study's scene are saved. Default: they are not saved.

        Returns
        -------
        Result
            Results and record of the run; `Result.write` writes them to a folder.

        Raises
        ------
        UnaffordableError
            If `plan` raises it, or the run exceeds the study's time limit; finished parts stay in the checkpoints.
        PlaceError
            If ``pictures`` has files in the place of those to be written that this program did not write.
        """
        from tradestudy.answers.runner import compute
        from tradestudy.execution import Serial, Steps
        from tradestudy.execution.steps import within_time
        from tradestudy.models.plan import TIME_REMEDY

        started = datetime.now(UTC)
        begin, begun = time.perf_counter(), time.monotonic()
        seconds: dict[str, float] = {}
        if pictures is not None:
            from tradestudy.answers.scene import files_of_pictures
            from tradestudy.results.storage import refuse_foreign

            refuse_foreign(pictures, files_of_pictures(self.prepared))
        plan = self._plan("not fitted")
        watched = within_time(progress, plan.accuracy.time_limit, TIME_REMEDY, begun)
        steps = Steps(executor=executor or Serial(), checkpoints=checkpoints, progress=watched)
        tree = compute(plan, steps, seconds, pictures)
        seconds["compute"] = time.perf_counter() - begin
        tree.attrs |= {"study_hash": self.hash, "code_hash": provenance.code_hash()}
        file = self.definition.document.locate(()).file
        record = {
            "study": self.name,
            "study_hash": self.hash,
            "code_hash": provenance.code_hash(),
            "seed": self.file.propagation.seed,
            "inputs": provenance.values_by_path(self.definition.under_tolerance.tree),
            "file": "a dictionary" if file == DICTIONARY.file else file,
            "options": list(options(self.definition.document, self.definition.tolerance)),
            "started": started.isoformat(timespec="seconds"),
            "versions": provenance.versions(),
            "machine": provenance.machine(),
            "seconds": {step: round(value, 3) for step, value in seconds.items()},
            "points": steps.counts,
        }
        return Result(data=tree, run_record=record)

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
