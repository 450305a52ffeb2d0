"""A study as read from its file, and the same study with other values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tradestudy.accuracy import QUANTITIES
from tradestudy.calibration.sources import calibration_of, given_twice, impossible_errors, mistakes_of_files
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.declaration import AttributesPart, DepthCameraDeclaration
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.declarations.part import MistakeAt
from tradestudy.effects import OFF, Models
from tradestudy.errors import OutOfRangeError, Problem, StudyError, TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.building import apply_models, camera_of, posterior_key
from tradestudy.study.document import Document, Entry, MappingEntry, ScalarEntry, Value, dotted, walk
from tradestudy.study.reader import in_si, with_values
from tradestudy.study.schema.questions import PROBLEM, DepthOfFieldPart, RefocusingPart, ReliefPart
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.schema.validation import validate, validate_changes
from tradestudy.study.schema.wave_optics import LOOSEST_PICTURE, FresnelValidityPart, LightSpotPart

if TYPE_CHECKING:  # inference itself loads these
    from tradestudy.calibration.camera_target import TargetToInfer
    from tradestudy.calibration.posteriors import CornersToInfer

_JUDGED: Final = 9  # distances of a study at which the draws must converge


@dataclass(frozen=True, kw_only=True)
class Case:
    """The inputs of a study's computations: cameras, limits and distances in SI.

    Parameters
    ----------
    cameras
        Cameras that measure depth, with their calibrations.
    all_cameras
        Every camera of the study, in its order.
    criteria, distance, wavelength
        Limits of the usable range, distances [m], and wavelength [m]. Without a scene there are no distances, and the
        wavelength is NaN.
    attributes
        Declared attributes of cameras, such as mass or price.
    depth_of_field, sharp, relief
        The range that must be sharp, the criteria of sharpness under the applied models, and the relief for which
        criteria are derived.
    refocusing
        Which cameras to refocus, and what counts as sharp.
    fresnel_validity, light_spot
        Questions about wave optics.
    fields
        Field positions at which depth is computed, besides the axis.
    """

    cameras: Mapping[str, DepthCamera]
    all_cameras: Mapping[str, Camera]
    criteria: UsableCriteria
    distance: FloatArray
    wavelength: float
    attributes: Mapping[str, AttributesPart] = field(default_factory=dict)
    depth_of_field: DepthOfFieldPart | None = None
    sharp: Mapping[str, BlurCriterion] = field(default_factory=dict)
    relief: ReliefPart | None = None
    refocusing: RefocusingPart | None = None
    fresnel_validity: FresnelValidityPart | None = None
    light_spot: LightSpotPart | None = None
    fields: tuple[float, ...] = ()


@dataclass(frozen=True)
class StudyDefinition:
    """A valid study: the document with its positions, and its validated content.

    Parameters
    ----------
    document
        The document as read, with the place of every value.
    declared
        The document as validated by the schema.
    models
        The model applied for each effect, by camera, lens or light path; the other effects are as declared.
    other_models
        Models that replace these under a reading or for an inverse question, by its name.
    tolerance
        A single tolerance for every quantity, overriding the declared ones; None keeps those.
    posteriors
        Inferred calibrations, by the keys of `posterior_keys`.
    before
        The study from which this one was derived; cameras that both share are built once.
    """

    document: Document
    declared: StudyFile
    models: Mapping[str, Models] = field(default_factory=dict)
    other_models: Mapping[str, Mapping[str, Models]] = field(default_factory=dict)
    tolerance: str | None = None
    posteriors: Mapping[str, Calibration] = field(default_factory=dict, repr=False)
    before: StudyDefinition | None = field(default=None, repr=False, compare=False)
    _folders: dict[str, Path] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __reduce__(self) -> tuple[Callable[..., StudyDefinition], tuple[object, ...]]:
        """Pickle what was read; classes of parts are made while the program runs, so parts are validated again."""
        return _validated, (self.document, self.models, self.other_models, self.tolerance, self.posteriors)

    @classmethod
    def of(cls, document: Document) -> StudyDefinition:
        """Check a document completely: against the schema, and by building its cameras.

        Raises
        ------
        StudyError
            With every mistake found.
        """
        definition = cls(document, validate(document, StudyFile))
        if problems := list(definition._problems_of_refocusing()):  # builds the cameras, which refuses impossible ones
            raise StudyError(problems)
        return definition

    @cached_property
    def file(self) -> StudyFile:
        """The validated content of the study, with the tolerance set from outside."""
        if self.tolerance is None:
            return self.declared
        return validate_changes(self.under_tolerance, self.document, self.declared)

    @cached_property
    def under_tolerance(self) -> Document:
        """The document with the values that the tolerance sets.

        A loose tolerance also loosens that of compared pictures of a light spot, which need not be more accurate.
        """
        if self.tolerance is None:
            return self.document
        own = [name for name in QUANTITIES if self.document.entry(f"accuracy.{name}") is not None]
        # Noise alone is answered only where the study gives its tolerance, so that key must stay.
        replaced = {f"accuracy.{name}": self.tolerance if name == "depth_noise" else None for name in own}
        asked = with_values(self.document, {"accuracy.tolerance": self.tolerance, **replaced})
        spot, accuracy = self.declared.light_spot, validate_changes(asked, self.document, self.declared).accuracy
        tolerance = accuracy.asked().tolerances["pixel_intensity"]
        if spot is None or not spot.methods or tolerance <= spot.tolerance:
            return asked
        loosened = ScalarEntry.of(f"{100 * min(tolerance, LOOSEST_PICTURE):g} %")
        return with_values(asked, {"light_spot.tolerance": loosened})

    @cached_property
    def designs(self) -> Mapping[str, Camera]:
        """The cameras without their calibrations; reports every camera that cannot be built or calibrated."""
        cameras: dict[str, Camera] = {}
        scene = self.file.scene
        what = "is derived from the picture, but scene.picture (texture, window, light, sensor) is missing"
        problems = [
            self.document.problem(("cameras", name, "depth", "disparity_error"), what)
            for name, part in self.file.cameras.items()
            if isinstance(part, DepthCameraDeclaration)
            and part.depth.declared_error_px is None
            and (scene is None or scene.picture is None)
        ]
        if problems:
            raise StudyError(problems)
        known = self._cameras_built_before()
        for name, part in self.file.cameras.items():
            if name in known:
                cameras[name] = known[name]
                continue
            try:
                cameras[name] = camera_of(part, scene)
            except TradestudyError as error:
                path = ("cameras", name)
                problems.append(self.document.problem(path, str(error)))
                continue
            problems += self._problems_of_calibration(name, cameras[name])
        if problems:
            raise StudyError(problems)
        return cameras

    @cached_property
    def case(self) -> Case:
        """The inputs of the computations: cameras with their calibrations, as far as these are known."""
        distance = np.array(() if self.file.scene is None else self.file.scene.distance_values(), dtype=np.float64)
        propagation = self._propagation(distance)
        cameras = {
            name: self._calibrated(name, camera, propagation)
            for name, camera in self.designs.items()
            if isinstance(camera, DepthCamera)
        }
        self._refuse_impossible_errors(cameras, distance)
        return Case(
            cameras={name: apply_models(camera, self.models.get(name, {})) for name, camera in cameras.items()},
            all_cameras={**self.designs, **cameras},
            criteria=self.file.usable_range.criteria(),
            distance=distance,
            wavelength=self._wavelength,
            attributes={name: part.attributes for name, part in self.file.cameras.items()},
            depth_of_field=self.file.depth_of_field,
            sharp=self._sharp(),
            relief=self.file.relief,
            refocusing=self.file.refocusing,
            fresnel_validity=self.file.fresnel_validity,
            light_spot=self.file.light_spot,
            fields=self.file.propagation.field_places,
        )

    def _refuse_impossible_errors(self, cameras: Mapping[str, DepthCamera], distance: FloatArray) -> None:
        """Refuse calibrations of which one standard deviation leaves no camera, as with a wrong unit in a file."""
        some = self._some_distances(distance)
        before = {} if self.before is None else self.before.case.all_cameras
        problems = []
        for name, camera in cameras.items():
            if before.get(name) is camera:
                continue
            path = ("cameras", name, "calibration")
            problems += [self.document.problem(path, one) for one in impossible_errors(camera, some)]
        if problems:
            raise StudyError(problems)

    @staticmethod
    def _some_distances(distance: FloatArray) -> FloatArray:
        """The first, a middle and the last distance [m]."""
        return distance[np.unique(np.linspace(0, distance.size - 1, 3).astype(int))] if distance.size else distance

    def _sharp(self) -> dict[str, BlurCriterion]:
        """Criteria of sharpness, by name; without a diffraction spot if the models leave diffraction out."""
        if self.file.depth_of_field is None:
            return {}
        sharp = {name: one.criterion(self._wavelength) for name, one in self.file.depth_of_field.criteria.items()}
        if self.models.get(PROBLEM, {}).get("main_lens_diffraction") == OFF:
            return {name: replace(criterion, measure="none") for name, criterion in sharp.items()}
        return sharp

    def _propagation(self, distance: FloatArray) -> Propagation:
        """How errors are propagated; draws must converge at some distances [m] and at those that the study names."""
        file = self.file
        some = (
            distance[np.unique(np.linspace(0, distance.size - 1, _JUDGED).round().astype(int))] if distance.size else ()
        )
        asked = {float(one) for one in some} | set(() if file.decision is None else file.decision.at)
        asked |= {end for one in file.requirements.values() if one.needs_usable_range for end in one.over}
        return replace(
            file.propagation.propagation(file.accuracy.asked().tolerances["depth_uncertainty"]),
            judged=tuple(sorted(asked)),
        )

    def _problems_of_calibration(self, name: str, design: Camera) -> Iterator[Problem]:
        """Mistakes in a camera's calibration files."""
        part = self.file.cameras[name]
        if not (isinstance(part, DepthCameraDeclaration) and isinstance(design, DepthCamera)):
            return
        mistakes = mistakes_of_files(part.calibration, self.calibration_folder(name))
        if part.calibration.posterior is not None:
            try:
                mistakes += given_twice(part.calibration, self._saved(name, part.calibration.posterior.file, design))
            except TradestudyError as error:
                mistakes.append(MistakeAt(("posterior", "file"), str(error)))
        for mistake in mistakes:
            path = ("cameras", name, "calibration", *mistake.tail)
            yield self.document.problem(path, mistake.what)

    def _problems_of_refocusing(self) -> Iterator[Problem]:
        """Shifts, pairs of views and blurs that a camera cannot have."""
        designs, part = self.designs, self.file.refocusing
        if part is None:
            return
        for name in part.asked({key: one.refocuses for key, one in designs.items()}):
            camera = designs[name].refocusing
            checks = {"shifts": camera.require_shifts, "pairs": camera.require_pair, "blur": camera.require_blur}
            for key, check in checks.items():
                try:
                    check(getattr(part, key))
                except OutOfRangeError as error:
                    yield self.document.problem(("refocusing", key), f"{name}: {error}")

    def _saved(self, name: str, file: str, design: DepthCamera) -> Calibration:
        from tradestudy.calibration.posterior_file import (
            posterior_of_file,
        )  # it loads scipy, which `check` seldom needs

        return posterior_of_file(self.calibration_folder(name) / file, name, design)

    def _cameras_built_before(self) -> Mapping[str, Camera]:
        """Cameras of the previous study that have the same declaration and the same scene in this one."""
        before = self.before
        if before is None or before.file.scene is not self.file.scene:
            return {}
        parts = self.file.cameras
        return {name: one for name, one in before.designs.items() if before.file.cameras[name] is parts.get(name)}

    def _calibrated(self, name: str, design: DepthCamera, propagation: Propagation) -> DepthCamera:
        """A camera with its calibration, reused if the previous study has the same."""
        before = self.before
        posterior = self.posteriors.get(self.posterior_keys.get(name, ""))
        if before is not None and before.designs.get(name) is design:
            known = before.case.all_cameras[name]
            assert isinstance(known, DepthCamera)
            same = before.posteriors.get(before.posterior_keys.get(name, "")) is posterior
            if same and known.propagation == propagation:
                return known
        part = self.file.cameras[name]
        assert isinstance(part, DepthCameraDeclaration)
        return self._with_calibration(name, part, design, propagation, posterior)

    def _with_calibration(
        self,
        name: str,
        part: DepthCameraDeclaration,
        design: DepthCamera,
        propagation: Propagation,
        posterior: Calibration | None,
    ) -> DepthCamera:
        """A camera with the calibration of a declaration, or with its inferred posterior."""
        if part.calibration.posterior is not None:
            posterior = self._saved(name, part.calibration.posterior.file, design)
        calibration = calibration_of(
            part.calibration,
            design,
            folder=self.calibration_folder(name),
            wavelength=self._wavelength,
            posterior=posterior,
        )
        if design.calibrated_pair is not None:
            from tradestudy.calibration.posterior_file import as_calibrated

            calibration = as_calibrated(calibration, design)
        return replace(design, calibration=calibration, propagation=propagation)

    def with_declaration(self, name: str, part: DepthCameraDeclaration) -> DepthCamera:
        """A camera of the study with other values, whose calibration needs no inference; fast, and reads no file.

        Its declaration must be valid, and name the same files.

        Raises
        ------
        OutOfRangeError
            If no camera can have these values, or one standard deviation of changed errors leaves none.
        """
        case, declared = self.case, self.file.cameras[name]
        design = camera_of(part, self.file.scene, case.distance)
        assert isinstance(design, DepthCamera)
        assert isinstance(declared, DepthCameraDeclaration)
        camera = self._with_calibration(name, part, design, case.cameras[name].propagation, None)
        if part.calibration != declared.calibration:
            for what in impossible_errors(camera, self._some_distances(case.distance)):
                raise OutOfRangeError(what)
        return apply_models(camera, self.models.get(name, {}))

    @property
    def _wavelength(self) -> float:
        """Wavelength of the scene [m]; NaN without a scene."""
        return math.nan if self.file.scene is None else self.file.scene.wavelength

    def calibrations_to_infer(self) -> dict[str, TargetToInfer | CornersToInfer]:
        """Calibrations yet to be inferred, by the keys of `posterior_keys`."""
        if not self.posterior_keys:
            return {}
        from tradestudy.calibration.posteriors import to_infer

        found = {}
        for name, key in self.posterior_keys.items():
            part, camera = self.file.cameras[name], self.designs[name]
            assert isinstance(part, DepthCameraDeclaration)
            assert isinstance(camera, DepthCamera)
            asked = to_infer(
                name,
                camera,
                part.calibration,
                folder=self.calibration_folder(name),
                seed=self.file.propagation.seed,
            )
            if asked is not None and key not in self.posteriors:
                found[key] = asked
        return found

    @cached_property
    def posterior_keys(self) -> Mapping[str, str]:
        """Key of the posterior of every camera whose calibration is inferred from a target or corners.

        All designs and readings of a study that share the camera and its calibration share the key.
        """
        seed = self.file.propagation.seed
        return {
            name: posterior_key(name, part, seed=seed, folder=self.calibration_folder(name))
            for name, part in self.file.cameras.items()
            if isinstance(part, DepthCameraDeclaration) and part.calibration.source in ("target", "corners")
        }

    def with_posteriors(self, posteriors: Mapping[str, Calibration]) -> StudyDefinition:
        """The same study, including its readings and designs, with inferred calibrations by `posterior_keys`."""
        return replace(self, posteriors={**self.posteriors, **posteriors}, before=self)

    def calibration_folder(self, name: str) -> Path:
        """Folder of a camera's calibration files: that of the file in which the first of them is named."""
        if name not in self._folders:
            first = next(iter(self._calibration_files(name)), ("cameras", name, "calibration"))
            self._folders[name] = self.folder_of(first)
        return self._folders[name]

    def _calibration_files(self, name: str) -> dict[tuple[str | int, ...], str]:
        """Files named by the calibration of a camera, by the paths of their names."""
        above = ("cameras", name, "calibration")
        calibration = self.document.entry(above)
        return {
            path: entry.value
            for path, entry in ([] if calibration is None else walk(calibration, above))
            if path[-1] == "file" and isinstance(entry, ScalarEntry) and isinstance(entry.value, str)
        }

    def with_values(
        self,
        values: Mapping[str, Value | Entry],
        *,
        written_at: tuple[str | int, ...] | None = None,
        numbers_in_si: bool = False,
    ) -> StudyDefinition:
        """The same study with other values, by dotted path; None removes a value. The result is fully checked.

        Parameters
        ----------
        values
            New value for each path: text, a number, a list or a mapping, as in a study file, or an entry of this study.
        written_at
            The mapping of this study that contains the values; their mistakes are reported there.
        numbers_in_si
            Whether numbers without a unit, other than those in text, are in SI where a quantity is expected; else they
            are mistakes.
        """
        for path in values:
            if not isinstance(path, str):
                raise TypeError(f"the path of a value is text, such as 'scene.distances.to', not {path!r}")
        places = None if written_at is None else {path: (*written_at, path) for path in values}
        document = with_values(self.document, values, written_at=places)
        if numbers_in_si:
            texts = [document.path_of(path) for path, value in values.items() if isinstance(value, str)]
            document = in_si(document, texts)
        declared = validate_changes(document, self.document, self.declared)
        changed = replace(self, document=document, declared=declared, before=self)
        changed.designs  # noqa: B018 - built here so that an impossible camera is refused, as in a study that is read
        return changed

    def with_texts(self, texts: Mapping[tuple[str | int, ...], str]) -> StudyDefinition:
        """The same study with other texts of existing single values, which stay those of the study file."""
        document = self.document.with_texts(texts)
        declared = validate_changes(document, self.document, self.declared)
        return replace(self, document=document, declared=declared, before=self)

    @cached_property
    def data_files(self) -> Mapping[str, Path]:
        """Files named by calibrations and the scene, also under readings, by the paths of their names."""
        found = self._own_files()
        for name, reading in self.readings.items():
            found |= {f"{name}: {path}": file for path, file in reading._own_files().items()}
        return found

    def _own_files(self) -> dict[str, Path]:
        return {dotted(path): file for path, file in self.named_files().items()}

    def named_files(self) -> dict[tuple[str | int, ...], Path]:
        """Files named by calibrations, measurements and the scene as declared, by the paths of their names."""
        return (
            {
                path: self.calibration_folder(name) / file
                for name in self.file.cameras
                for path, file in self._calibration_files(name).items()
            }
            | {
                ("scene", "image", *path): self.folder_of(("scene", "image")) / file
                for path, file in (self.file.scene.image.files() if self.file.scene and self.file.scene.image else ())
            }
            | {
                path: self.folder_of(path) / part.file
                for path, part in (
                    (("measurements", name, "file"), one) for name, one in self.file.measurements.items()
                )
            }
        )

    def folder_of(self, path: tuple[str | int, ...]) -> Path:
        """Folder of the files named in a part of the study: that of the file that contains the part."""
        file, _, _ = self.document.locate(path)
        root, _, _ = self.document.locate(())
        return Path(file if Path(file).is_file() else root).parent

    def with_tolerance(self, relative: str) -> StudyDefinition:
        """The same study with one tolerance for every quantity, such as ``"1 %"``, overriding the declared ones.

        Raises
        ------
        StudyError
            If this is not a tolerance; reported at ``--tolerance``.
        """
        asked = replace(self, tolerance=relative, before=self)
        try:
            asked.file  # noqa: B018 - validated here so that an invalid tolerance is refused where it is given
        except StudyError as error:
            # Every tolerance of the study reports the same mistake.
            own = [one for one in error.problems if one.path == "accuracy.tolerance"] or error.problems
            raise StudyError([replace(one, file="--tolerance") for one in own]) from None
        return asked

    def with_models(
        self, models: Mapping[str, Models], other_models: Mapping[str, Mapping[str, Models]] | None = None
    ) -> StudyDefinition:
        """The same study, including its readings and designs, with the given models applied.

        Parameters
        ----------
        models
            Models by camera, lens or light path, then by effect.
        other_models
            Models that replace these under a reading or for an inverse question, first by its name.
        """
        return replace(self, models=models, other_models=other_models or {}, before=self)

    def under(self, name: str) -> StudyDefinition:
        """The study with the models for the reading or the inverse question of this name."""
        return replace(self, models={**self.models, **self.other_models.get(name, {})}, before=self)

    def entries_of_reading(self, name: str) -> dict[str, Entry]:
        """Entries that a reading sets, by path."""
        values = self.document.entry(("readings", name, "set"))
        assert isinstance(values, MappingEntry)  # as validated
        return {path: member.entry for path, member in values.members.items()}

    @cached_property
    def readings(self) -> Mapping[str, StudyDefinition]:
        """The study under each of its other readings.

        Raises
        ------
        StudyError
            With every mistake of every reading.
        """
        found: dict[str, StudyDefinition] = {}
        problems: list[Problem] = []
        for name in self.file.readings:
            try:
                changed = self.with_values(self.entries_of_reading(name), written_at=("readings", name, "set"))
                found[name] = changed.under(name)
            except StudyError as error:
                problems += [
                    replace(problem, what=f"in reading '{name}': {problem.what}") for problem in error.problems
                ]
        if problems:
            raise StudyError(problems)
        return found


def _validated(document: Document, *given: Any) -> StudyDefinition:
    """A definition from its pickled form, with models, tolerance and posteriors as `given`."""
    return StudyDefinition(document, validate(document, StudyFile), *given)
