"""The case of a study: its cameras in SI, with their calibrations and the models chosen for them."""

from __future__ import annotations

import math
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.calibration.sources import calibration_of, impossible_errors
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.declaration import AttributesPart, DepthCameraDeclaration
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.effects import OFF, Models, SlotName
from tradestudy.errors import OutOfRangeError, Problem, StudyError
from tradestudy.imaging.models import PictureModels, closed_form_models
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import StudyDefinition, calibration_folder, camera_of, saved_posterior
from tradestudy.study.document import Document, Entry, Value
from tradestudy.study.schema.questions import PROBLEM, DepthOfFieldPart, RefocusingPart, ReliefPart
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.schema.wave_optics import FresnelValidityPart, LightSpotPart

_JUDGED: Final = 9  # distances of a study at which the draws must converge


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What is chosen or inferred for a study before it is computed; it also holds for its readings and designs.

    Parameters
    ----------
    models
        The model applied for each effect, by camera, lens or light path; the other effects are as declared.
    other_models
        Models that replace these under a reading or for an inverse question, by its name.
    posteriors
        Inferred calibrations, by the keys of `StudyDefinition.posterior_keys`.
    """

    models: Mapping[str, Models] = field(default_factory=dict)
    other_models: Mapping[str, Mapping[str, Models]] = field(default_factory=dict)
    posteriors: Mapping[str, Calibration] = field(default_factory=dict, repr=False)


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
class PreparedStudy:
    """A valid study with what was chosen for it, which together determine its case.

    Parameters
    ----------
    definition
        The valid study.
    choices
        The chosen models and inferred calibrations; none before they are known.
    """

    definition: StudyDefinition
    choices: Choices = field(default_factory=Choices)

    def __reduce__(self) -> tuple[type[PreparedStudy], tuple[StudyDefinition, Choices]]:
        return PreparedStudy, (self.definition, self.choices)

    @property
    def document(self) -> Document:
        """The document with its positions."""
        return self.definition.document

    @property
    def file(self) -> StudyFile:
        """The validated content of the study."""
        return self.definition.file

    @cached_property
    def case(self) -> Case:
        """The inputs of the computations."""
        return case_of(self.definition, self.choices)

    @cached_property
    def readings(self) -> Mapping[str, PreparedStudy]:
        """The study under each of its other readings."""
        readings = self.definition.readings.items()
        return {name: replace(self.under(name), definition=reading) for name, reading in readings}

    def under(self, name: str) -> PreparedStudy:
        """The study with the models for the reading or the inverse question of this name."""
        models = {**self.choices.models, **self.choices.other_models.get(name, {})}
        return replace(self, choices=replace(self.choices, models=models))

    def with_values(self, values: Mapping[str, Value | Entry], *, numbers_in_si: bool = False) -> PreparedStudy:
        """The study with other values, as `StudyDefinition.with_values` checks them."""
        return replace(self, definition=self.definition.with_values(values, numbers_in_si=numbers_in_si))

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
        camera = _with_calibration(self.definition, name, part, design, case.cameras[name].propagation, None)
        # An unchanged calibration was checked with the case.
        if part.calibration != declared.calibration:
            for what in impossible_errors(camera, _some(case.distance, 3)):
                raise OutOfRangeError(what)
        return apply_models(camera, self.choices.models.get(name, {}))


def case_of(definition: StudyDefinition, choices: Choices) -> Case:
    """The inputs of a study's computations: cameras with their calibrations, as far as these are known.

    Raises
    ------
    StudyError
        With every calibration of which one standard deviation leaves no camera, as with a wrong unit in a file.
    """
    file = definition.file
    distance = np.array(() if file.scene is None else file.scene.distance_values(), dtype=np.float64)
    propagation = _propagation(file, distance)
    cameras: dict[str, DepthCamera] = {}
    problems: list[Problem] = []
    for name, design in definition.designs.items():
        if isinstance(design, DepthCamera):
            posterior = choices.posteriors.get(definition.posterior_keys.get(name, ""))
            try:
                cameras[name] = _calibrated(definition, name, design, propagation, posterior, distance)
            except StudyError as error:
                problems += error.problems
    if problems:
        raise StudyError(problems)
    return Case(
        cameras={name: apply_models(camera, choices.models.get(name, {})) for name, camera in cameras.items()},
        all_cameras={**definition.designs, **cameras},
        criteria=file.usable_range.criteria(),
        distance=distance,
        wavelength=_wavelength(file),
        attributes={name: part.attributes for name, part in file.cameras.items()},
        depth_of_field=file.depth_of_field,
        sharp=_sharp(file, choices.models.get(PROBLEM, {})),
        relief=file.relief,
        refocusing=file.refocusing,
        fresnel_validity=file.fresnel_validity,
        light_spot=file.light_spot,
        fields=file.propagation.field_places,
    )


# The calibrated form of each design, with the propagation and the posterior of its calibration, by the identity of the
# design and while it exists: designs that many studies share, as those of a sweep do, are calibrated once.
_CALIBRATED: dict[int, tuple[Propagation, Calibration | None, DepthCamera]] = {}


def _calibrated(
    definition: StudyDefinition,
    name: str,
    design: DepthCamera,
    propagation: Propagation,
    posterior: Calibration | None,
    distance: FloatArray,
) -> DepthCamera:
    """A camera with its calibration; refuses one of which one standard deviation leaves no camera."""
    known = _CALIBRATED.get(id(design))
    if known is not None and known[0] == propagation and known[1] is posterior:
        return known[2]
    part = definition.file.cameras[name]
    assert isinstance(part, DepthCameraDeclaration)
    camera = _with_calibration(definition, name, part, design, propagation, posterior)
    path = ("cameras", name, "calibration")
    if problems := [definition.document.problem(path, what) for what in impossible_errors(camera, _some(distance, 3))]:
        raise StudyError(problems)
    # Otherwise an earlier call has registered the removal.
    if known is None:
        weakref.finalize(design, _CALIBRATED.pop, id(design), None)
    _CALIBRATED[id(design)] = propagation, posterior, camera
    return camera


def _with_calibration(
    definition: StudyDefinition,
    name: str,
    part: DepthCameraDeclaration,
    design: DepthCamera,
    propagation: Propagation,
    posterior: Calibration | None,
) -> DepthCamera:
    """A camera with the calibration of a declaration, or with its inferred posterior."""
    document = definition.document
    if part.calibration.posterior is not None:
        posterior = saved_posterior(document, name, part.calibration.posterior.file, design)
    calibration = calibration_of(
        part.calibration,
        design,
        folder=calibration_folder(document, name),
        wavelength=_wavelength(definition.file),
        posterior=posterior,
    )
    if design.calibrated_pair is not None:
        from tradestudy.calibration.posterior_file import as_calibrated

        calibration = as_calibrated(calibration, design)
    return replace(design, calibration=calibration, propagation=propagation)


def _propagation(file: StudyFile, distance: FloatArray) -> Propagation:
    """How errors are propagated; draws must converge at some distances [m] and at those of all questions."""
    return replace(
        file.propagation.propagation(file.accuracy.asked().tolerances["depth_uncertainty"]),
        judged=tuple(sorted({*_some(distance, _JUDGED).tolist(), *file.depth_distances})),
    )


def _some(distance: FloatArray, count: int) -> FloatArray:
    """At most so many of the distances [m], evenly spread and with both ends."""
    places = np.linspace(0, distance.size - 1, count if distance.size else 0)
    return distance.take(np.unique(places.round().astype(int)))


def _sharp(file: StudyFile, models: Models) -> dict[str, BlurCriterion]:
    """Criteria of sharpness, by name; without a diffraction spot if the models leave diffraction out."""
    if file.depth_of_field is None:
        return {}
    sharp = {name: part.criterion(_wavelength(file)) for name, part in file.depth_of_field.criteria.items()}
    if models.get("main_lens_diffraction") == OFF:
        return {name: replace(criterion, measure="none") for name, criterion in sharp.items()}
    return sharp


def _wavelength(file: StudyFile) -> float:
    """Wavelength of the scene [m]; NaN without a scene."""
    return math.nan if file.scene is None else file.scene.wavelength


def with_models(models: PictureModels, chosen: Models) -> PictureModels:
    """The models of a picture, with the chosen ones in place of those for the same effects."""
    slots = {field.name for field in fields(PictureModels)}
    replaced = {slot: model for slot, model in chosen.items() if slot in slots}
    return replace(models, **replaced)  # type: ignore[arg-type] # chosen models have the names that their effects list


def in_closed_form(chosen: Models) -> dict[SlotName, str]:
    """The same models, but Fresnel's transfer function instead of the almost equal integral of Kirchhoff's."""
    return {slot: "fresnel" if model == "kirchhoff" else model for slot, model in chosen.items()}


def complete_in_closed_form(camera: DepthCamera, law: PictureDisparityError) -> PictureModels:
    """The most complete closed-form models of a picture, even if its law leaves some out: Fresnel diffraction."""
    microlenses = camera.pictured_by_microlenses  # the law may leave out their diffraction
    plain = closed_form_models(law.settings, microlenses=microlenses)
    return replace(plain, main_lens_diffraction="fresnel", microlens_diffraction="fresnel" if microlenses else "off")


def apply_models(camera: DepthCamera, chosen: Models) -> DepthCamera:
    """The camera with the chosen models; effects without a chosen model keep the declared one."""
    law = camera.disparity_error_px
    if isinstance(law, PictureDisparityError):
        applied = with_models(law.models, chosen)
        if not law.settings.spectrum:  # a reading may remove it
            applied = replace(applied, spectrum="off")
        camera = replace(camera, disparity_error_px=replace(law, models=applied))
    match chosen.get("calibration"):
        case "off" | "linear" | "exact" as model:
            return replace(camera, propagation=replace(camera.propagation, model=model))
        case _:
            return camera
