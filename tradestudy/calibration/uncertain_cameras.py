"""The uncertain cameras of a study, their calibrations inferred where the study asks for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tradestudy.calibration.declaration import (
    BodyPart,
    CalibrationStudyPart,
    SurroundingsPart,
)
from tradestudy.calibration.posteriors import (
    CornersToInfer,
    InferredCalibration,
    RealRig,
    TargetToInfer,
    infer,
)
from tradestudy.calibration.sources import SEPARATOR, declared_groups, group_of_file, replaced, session_groups
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.environment import Environment
from tradestudy.cameras.exact_model import ExactModel
from tradestudy.cameras.reading import SESSION_CHANGES, Errors, InverseDepthReading
from tradestudy.execution import Steps
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.evaluation import Model, Outcome
from tradestudy.uncertainty.sources import Group, Sources

Reading = Callable[[FloatArray, float, Errors], InverseDepthReading]
"""Inverse depths that a camera reads at true distances [m], at a place in the field, under given errors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class UncertainCamera:
    """One camera of the study with its errors.

    Parameters
    ----------
    name
        Its key in the study.
    reading
        Its exact model.
    groups
        Its own errors, under the names of its model.
    surroundings
        Errors that it shares with the other cameras.
    """

    name: str
    reading: Reading
    groups: tuple[Group, ...]
    surroundings: tuple[Group, ...]

    @property
    def sources(self) -> Sources:
        """Everything uncertain about it, its own errors with its name before theirs."""
        return sources_of(self)

    def model(self, distance: FloatArray, field: float, scaled: Mapping[str, float] | None = None) -> Model:
        """The engine's model at distances [m]; ``scaled`` multiplies the draws of some of its errors."""
        own = tuple(name for group in self.groups for name in group.parameters)
        factors = scaled or {}

        def evaluate(values: Mapping[str, FloatArray]) -> Outcome:
            errors = {name: values[self.name + SEPARATOR + name] * factors.get(name, 1.0) for name in own}
            errors |= {name: values[name] for name in SESSION_CHANGES if name in values}
            found = self.reading(distance, field, errors)
            shape = (len(next(iter(values.values()))), distance.size)
            return Outcome(
                values=np.broadcast_to(found.inverse_depth, shape),
                no_overlap=found.no_overlap,
                out_of_range=found.out_of_range,
            )

        return evaluate


def sources_of(*cameras: UncertainCamera) -> Sources:
    """The errors of several cameras together; what they share stands once."""
    shared = {group.name: group for camera in cameras for group in camera.surroundings}
    own = tuple(group.under(camera.name + SEPARATOR) for camera in cameras for group in camera.groups)
    return Sources(groups=(*own, *shared.values()))


def short_name(name: str) -> str:
    """The name of a group or parameter without its camera."""
    return name.rpartition(SEPARATOR)[2]


@dataclass(frozen=True, kw_only=True, eq=False)
class UncertainCameras:
    """The cameras to be propagated, and the calibrations that were inferred for some of them."""

    cameras: Mapping[str, UncertainCamera]
    calibrations: Mapping[str, InferredCalibration]
    rigs: Mapping[str, RealRig]


def uncertain_cameras(
    part: CalibrationStudyPart,
    cameras: Mapping[str, DepthCamera],
    steps: Steps,
    *,
    folder: Path,
    wavelength: float,
) -> UncertainCameras:
    """Assemble errors and models of every camera of the calibration part, inferring calibrations on the way.

    Parameters
    ----------
    part
        The calibration part of the study.
    cameras
        The cameras of the study, by name.
    steps
        Where calibrations are inferred.
    folder
        Where the files that the part names are.
    wavelength
        Of the scene [m].

    Raises
    ------
    TradestudyError
        Errors that contradict each other, a calibration that cannot be read or inferred.
    """
    uncertain: dict[str, UncertainCamera] = {}
    designs: dict[str, ExactModel] = {}
    groups_of: dict[str, tuple[Group, ...]] = {}
    asked: dict[str, TargetToInfer | CornersToInfer] = {}
    for name, of_camera in part.cameras.items():
        camera = cameras[name]
        assert isinstance(camera, ExactModel)  # the schema lets no other kind in
        designs[name] = camera
        if of_camera.corners is not None:
            asked[name] = CornersToInfer.of(name, camera, of_camera.corners, folder, seed=part.seed)
            continue
        groups_of[name] = declared_groups(camera, of_camera, folder)
        if of_camera.target is not None:
            asked[name] = TargetToInfer(
                name=name, camera=camera, groups=groups_of[name], part=of_camera.target, seed=part.seed
            )
    inferred = dict(zip(asked, steps.map("calibration", infer, list(asked.values()), list(asked)), strict=True))
    rigs = {name: found for name, found in inferred.items() if isinstance(found, RealRig)}
    calibrations = {
        name: found.calibration if isinstance(found, RealRig) else found for name, found in inferred.items()
    }
    for name, of_camera in part.cameras.items():
        camera = designs[name]
        if name in rigs:
            rig = rigs[name]
            uncertain[name] = UncertainCamera(
                name=name, reading=rig.reading, groups=(rig.calibration.group, *rig.noise), surroundings=()
            )
            continue
        groups = groups_of[name]
        if name in calibrations:
            groups = replaced(groups, calibrations[name].group)
        if of_camera.file is not None:
            groups = replaced(groups, group_of_file(folder / of_camera.file, camera.error_units))
        body = of_camera.body
        uncertain[name] = UncertainCamera(
            name=name,
            reading=partial(camera.read, environment=_environment(body, part.surroundings, wavelength)),
            groups=groups,
            surroundings=session_groups(part.surroundings, folder) if body is not None else (),
        )
    return UncertainCameras(cameras=uncertain, calibrations=calibrations, rigs=rigs)


def _environment(body: BodyPart | None, surroundings: SurroundingsPart | None, wavelength: float) -> Environment | None:
    if body is None or surroundings is None:
        return None
    return Environment(
        housing_expansion=body.housing_expansion,
        focal_length_expansion=body.focal_length_expansion,
        glass_index=body.glass_index,
        wavelength=wavelength,
        temperature=surroundings.calibrated_at_temperature,
        pressure=surroundings.calibrated_at_pressure,
    )
