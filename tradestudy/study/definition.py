"""A study as read from its file: valid, with its cameras as designed; and the same study with other values."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tradestudy.accuracy import QUANTITIES
from tradestudy.calibration.sources import given_twice, mistakes_of_files
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.declaration import CameraDeclaration, DepthCameraDeclaration
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.declarations.part import MistakeAt
from tradestudy.errors import OutOfRangeError, Problem, StudyError, TradestudyError
from tradestudy.imaging.models import Matcher, closed_form_models
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.document import Document, Entry, MappingEntry, ScalarEntry, Value, dotted, walk
from tradestudy.study.edits import in_si, with_values
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.schema.scene import ScenePart
from tradestudy.study.schema.validation import validate, validate_changes
from tradestudy.study.schema.wave_optics import LOOSEST_PICTURE

if TYPE_CHECKING:  # inference itself loads these
    from tradestudy.calibration.camera_target import TargetToInfer
    from tradestudy.calibration.posteriors import CornersToInfer

# Parts of a camera that affect no posterior: texts, measurement noise, and changes after the calibration.
_NOT_CALIBRATED: Final[dict[str, bool | set[str]]] = {
    "title": True,
    "note": True,
    "stated": True,
    "attributes": True,
    "depth": {"disparity_error", "error_of", "discrimination_step", "matcher"},
    "calibration": {"stability"},
    "sensor": {"quantum_efficiency", "temporal_dark_noise", "saturation_capacity", "system_gain"},
}


@dataclass(frozen=True)
class StudyDefinition:
    """A valid study: the document with its positions, its validated content, and the cameras that it describes.

    Parameters
    ----------
    document
        The document as read, with the place of every value.
    declared
        The document as validated by the schema.
    designs
        The cameras without their calibrations, by name.
    tolerance
        A single tolerance for every quantity, overriding the declared ones; None keeps those.
    """

    document: Document
    declared: StudyFile
    designs: Mapping[str, Camera] = field(repr=False, compare=False)
    tolerance: str | None = None

    def __reduce__(self) -> tuple[Callable[..., StudyDefinition], tuple[Document, str | None]]:
        """Pickle what was read; classes of parts are made while the program runs, so parts are validated again."""
        return StudyDefinition.of, (self.document, self.tolerance)

    @classmethod
    def of(cls, document: Document, tolerance: str | None = None) -> StudyDefinition:
        """Check a document completely: against the schema, and by building its cameras.

        Raises
        ------
        StudyError
            With every mistake found.
        """
        declared = validate(document, StudyFile)
        definition = cls(document, declared, _designs(document, declared, {}), tolerance)
        if problems := list(definition._problems_of_refocusing()):
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
        keys = [key for key in QUANTITIES if self.document.entry(f"accuracy.{key}") is not None]
        # Noise alone is answered only where the study gives its tolerance, so that key must stay.
        replaced = {f"accuracy.{key}": self.tolerance if key == "depth_noise" else None for key in keys}
        document = with_values(self.document, {"accuracy.tolerance": self.tolerance, **replaced})
        spot, accuracy = self.declared.light_spot, validate_changes(document, self.document, self.declared).accuracy
        tolerance = accuracy.asked().tolerances["pixel_intensity"]
        if spot is None or not spot.methods or tolerance <= spot.tolerance:
            return document
        loosened = ScalarEntry.of(f"{100 * min(tolerance, LOOSEST_PICTURE):g} %")
        return with_values(document, {"light_spot.tolerance": loosened})

    def _problems_of_refocusing(self) -> Iterator[Problem]:
        """Shifts, pairs of views and blurs that a camera cannot have."""
        designs, part = self.designs, self.file.refocusing
        if part is None:
            return
        for name in part.asked({key: design.refocuses for key, design in designs.items()}):
            camera = designs[name].refocusing
            checks = {"shifts": camera.require_shifts, "pairs": camera.require_pair, "blur": camera.require_blur}
            for key, check in checks.items():
                try:
                    check(getattr(part, key))
                except OutOfRangeError as error:
                    yield self.document.problem(("refocusing", key), f"{name}: {error}")

    def calibrations_to_infer(self) -> dict[str, TargetToInfer | CornersToInfer]:
        """Calibrations that a run has to infer, by the keys of `posterior_keys`."""
        if not self.posterior_keys:
            return {}
        from tradestudy.calibration.posteriors import to_infer

        requests = {}
        for name, key in self.posterior_keys.items():
            part, camera = self.file.cameras[name], self.designs[name]
            assert isinstance(part, DepthCameraDeclaration)
            assert isinstance(camera, DepthCamera)
            request = to_infer(
                name,
                camera,
                part.calibration,
                folder=calibration_folder(self.document, name),
                seed=self.file.propagation.seed,
            )
            if request is not None:
                requests[key] = request
        return requests

    @cached_property
    def posterior_keys(self) -> Mapping[str, str]:
        """Key of the posterior of every camera whose calibration is inferred from a target or corners.

        All designs and readings of a study that share the camera and its calibration share the key.
        """
        seed = self.file.propagation.seed
        return {
            name: _posterior_key(name, part, seed=seed, folder=calibration_folder(self.document, name))
            for name, part in self.file.cameras.items()
            if isinstance(part, DepthCameraDeclaration) and part.calibration.source in ("target", "corners")
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
        declared, parts = validate_changes(document, self.document, self.declared), self.declared.cameras
        # A camera's disparity error may be derived from the scene, so under another scene every camera is built anew.
        same = {
            name: design
            for name, design in self.designs.items()
            if declared.scene is self.declared.scene and declared.cameras.get(name) is parts[name]
        }
        return replace(self, document=document, declared=declared, designs=_designs(document, declared, same))

    def with_texts(self, texts: Mapping[tuple[str | int, ...], str]) -> StudyDefinition:
        """The same study with other names of its files, which stay those of the study file."""
        document = self.document.with_texts(texts)
        return replace(self, document=document, declared=validate_changes(document, self.document, self.declared))

    @cached_property
    def data_files(self) -> Mapping[str, Path]:
        """Files named by calibrations and the scene, also under readings, by the paths of their names."""
        forms = {"": self} | {f"{name}: ": reading for name, reading in self.readings.items()}
        return {
            f"{before}{dotted(path)}": file
            for before, form in forms.items()
            for path, file in form.named_files().items()
        }

    def named_files(self) -> dict[tuple[str | int, ...], Path]:
        """Files named by calibrations, measurements and the scene as declared, by the paths of their names."""
        return (
            {
                path: calibration_folder(self.document, name) / file
                for name in self.file.cameras
                for path, file in _calibration_files(self.document, name).items()
            }
            | {
                ("scene", "image", *path): self.document.folder_of(("scene", "image")) / file
                for path, file in (self.file.scene.image.files() if self.file.scene and self.file.scene.image else ())
            }
            | {
                ("measurements", name, "file"): self.document.folder_of(("measurements", name, "file")) / part.file
                for name, part in self.file.measurements.items()
            }
        )

    def with_tolerance(self, relative: str) -> StudyDefinition:
        """The same study with one tolerance for every quantity, such as ``"1 %"``, overriding the declared ones.

        Raises
        ------
        StudyError
            If this is not a tolerance; reported at ``--tolerance``.
        """
        definition = replace(self, tolerance=relative)
        try:
            definition.file  # noqa: B018 - validated here so that an invalid tolerance is refused where it is given
        except StudyError as error:
            # Every tolerance of the study reports the same mistake.
            kept = [problem for problem in error.problems if problem.path == "accuracy.tolerance"] or error.problems
            raise StudyError([replace(problem, file="--tolerance") for problem in kept]) from None
        return definition

    def entries_of_reading(self, reading: str) -> dict[str, Entry]:
        """Entries that a reading sets, by path."""
        values = self.document.entry(("readings", reading, "set"))
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
        readings: dict[str, StudyDefinition] = {}
        problems: list[Problem] = []
        for name in self.file.readings:
            try:
                readings[name] = self.with_values(self.entries_of_reading(name), written_at=("readings", name, "set"))
            except StudyError as error:
                problems += [
                    replace(problem, what=f"in reading '{name}': {problem.what}") for problem in error.problems
                ]
        if problems:
            raise StudyError(problems)
        return readings


def _designs(document: Document, file: StudyFile, known: Mapping[str, Camera]) -> dict[str, Camera]:
    """The cameras of a study as designed, of which some are known.

    Raises
    ------
    StudyError
        With every camera that cannot be built or calibrated.
    """
    cameras: dict[str, Camera] = {}
    problems: list[Problem] = []
    for name, part in file.cameras.items():
        if name in known:
            cameras[name] = known[name]
            continue
        try:
            cameras[name] = camera_of(part, file.scene)
            mistakes = _mistakes_of_calibration(document, name, part, cameras[name])
        except MistakeAt as mistake:
            mistakes = [mistake]
        except TradestudyError as error:
            mistakes = [MistakeAt((), str(error))]
        problems += [document.problem(("cameras", name, *mistake.tail), mistake.what) for mistake in mistakes]
    if problems:
        raise StudyError(problems)
    return cameras


def camera_of(part: CameraDeclaration, scene: ScenePart | None, distance: FloatArray | None = None) -> Camera:
    """Build a declared camera, given the study's scene, and its distances [m] if they are known.

    Raises
    ------
    OutOfRangeError
        If no camera can have the declared values.
    MistakeAt
        If its disparity error is to be derived without a picture.
    """
    if not isinstance(part, DepthCameraDeclaration):
        return part.design(None)
    camera = part.design(_picture_law(scene, part))
    if scene is not None:  # refuse distances that it cannot measure
        camera.modelled_distance(scene.distance_values() if distance is None else distance)
    return camera


def _picture_law(scene: ScenePart | None, part: DepthCameraDeclaration) -> PictureDisparityError | None:
    """The law of a derived disparity error; the camera's own matcher and sensor override those of the scene."""
    if part.depth.declared_error_px is not None:
        return None
    if scene is None or scene.picture is None:
        what = "is derived from the picture, but scene.picture (texture, window, light, sensor) is missing"
        raise MistakeAt(("depth", "disparity_error"), what)
    own_matcher, settings = part.depth.matcher, scene.picture.settings(scene.wavelength, part.sensor.sensor())
    matchers = filter(None, (scene.picture.matcher, own_matcher))
    values = {key: value for matcher in matchers for key, value in matcher.given().items()}
    return PictureDisparityError(
        settings=settings,
        models=closed_form_models(settings, microlenses=part.camera.pictured_by_microlenses),
        matcher=Matcher(**values),
    )


def _mistakes_of_calibration(
    document: Document, camera: str, part: CameraDeclaration, design: Camera
) -> list[MistakeAt]:
    """Mistakes in the files that a camera's calibration names."""
    if not (isinstance(part, DepthCameraDeclaration) and isinstance(design, DepthCamera)):
        return []
    mistakes = mistakes_of_files(part.calibration, calibration_folder(document, camera))
    if part.calibration.posterior is not None:
        try:
            saved = saved_posterior(document, camera, part.calibration.posterior.file, design)
            mistakes += given_twice(part.calibration, saved)
        except TradestudyError as error:
            mistakes.append(MistakeAt(("posterior", "file"), str(error)))
    return [MistakeAt(("calibration", *mistake.tail), mistake.what) for mistake in mistakes]


def saved_posterior(document: Document, camera: str, file: str, design: DepthCamera) -> Calibration:
    """The calibration of a camera that an earlier run saved to a file."""
    from tradestudy.calibration.posterior_file import posterior_of_file  # it loads scipy, which `check` seldom needs

    return posterior_of_file(calibration_folder(document, camera) / file, camera, design)


def calibration_folder(document: Document, camera: str) -> Path:
    """Folder of a camera's calibration files: that of the file in which the first of them is named."""
    return document.folder_of(next(iter(_calibration_files(document, camera)), ("cameras", camera, "calibration")))


def _calibration_files(document: Document, camera: str) -> dict[tuple[str | int, ...], str]:
    """Files named by the calibration of a camera, by the paths of their names."""
    above = ("cameras", camera, "calibration")
    calibration = document.entry(above)
    return {
        path: entry.value
        for path, entry in ([] if calibration is None else walk(calibration, above))
        if path[-1] == "file" and isinstance(entry, ScalarEntry) and isinstance(entry.value, str)
    }


def _posterior_key(camera: str, part: DepthCameraDeclaration, *, seed: int, folder: Path) -> str:
    """Key of a camera's posterior, identical for all posteriors inferred from the same inputs in the same way."""
    inputs = (camera, str(seed), str(folder), part.model_dump_json(exclude=_NOT_CALIBRATED))
    return sha256("\n".join(inputs).encode()).hexdigest()
