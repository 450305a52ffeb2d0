"""Depth measured by a calibrated pair, with errors in all its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tradestudy.calibration.corners.real_rig import inverse_depth, observe_pair, points_midway
from tradestudy.calibration.corners.shared_area import shared_area
from tradestudy.calibration.corners.view_blocks import (
    RELATIVE_POSE_NAMES,
    ROTATION,
    TRANSLATION,
    cameras_of,
    shared_names,
)
from tradestudy.calibration.projection import (
    FreeLens,
    coefficient_of,
    intrinsic_names,
    rotation_matrix,
    rotation_vector,
)
from tradestudy.cameras.calibrated_pair import PINHOLES, RADIAL, CalibratedPair, Lenses
from tradestudy.cameras.depth_measurement import Errors, Field, MeasuredInverseDepth, require_known, shares_of, value_of
from tradestudy.cameras.environment import Environment
from tradestudy.cameras.error_vocabulary import INTERIOR, PIXEL_NOISE, ErrorParameter, ErrorVocabulary, Unit
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_models.families import ANGLES
from tradestudy.optics.lens_models.lens_model import slopes

SIDES: Final = ("left", "right")
_FARTHEST: Final = 1e12  # m; disparity there differs from that of infinity by less than rounding
_BOTH: Final = {"left": -0.5, "right": 0.5}
_POSE: Final = ("yaw", "pitch", "roll", "baseline", "baseline_direction_y", "baseline_direction_z")


def _unit_of(name: str) -> Unit:
    if name.endswith("_px"):
        return "px"
    if (coefficient := coefficient_of(name)) is not None:
        return "rad" if coefficient in ANGLES else "1"
    return "rad" if "rotation" in name else "m"


def rig_parameters(free: Sequence[str]) -> ErrorVocabulary:
    """The parameters of a pair with these coefficients that corners determine, in the order of ``shared_names``."""
    return {
        **{
            f"{side}_{name}": ErrorParameter(
                unit=_unit_of(name),
                part=INTERIOR,
                meaning=f"The {side} camera's {name.replace('_', ' ')}, from the fit.",
            )
            for side in SIDES
            for name in intrinsic_names(free)
        },
        **{
            name: ErrorParameter(
                unit=_unit_of(name),
                part="relative rotation" if "rotation" in name else "relative position",
                meaning=f"The right camera's {name.replace('_', ' ')} relative to the left one, from the fit.",
            )
            for name in RELATIVE_POSE_NAMES
        },
    }


def pair_found(best: FloatArray, lens: FreeLens) -> CalibratedPair:
    """The fitted pair."""
    left, right = (lens.at(camera[4:]) for camera in cameras_of(best))
    return CalibratedPair(parameters=tuple(best), lenses=(left, right), free=lens.free)


@dataclass(frozen=True, kw_only=True, eq=False)
class RigMeasurement:
    """The exact model of a pair calibrated from corners or by a calibration file, for a `Calibration`.

    Parameters
    ----------
    best : array (P,)
        Best parameters, in the order of ``shared_names`` [px, 1, rad, m].
    pixels
        Columns and rows of each picture.
    pixel_pitch
        Pixel pitch [m], which converts errors on the sensor into pixels.
    vocabulary
        All parameters that can be in error: `rig_parameters`, and the errors of a stereo rig, which include ageing.
    lenses, free
        Lens models, and names of their free coefficients.
    """

    best: FloatArray
    pixels: tuple[int, int]
    pixel_pitch: float
    vocabulary: ErrorVocabulary
    lenses: Lenses = PINHOLES
    free: tuple[str, ...] = RADIAL

    def __call__(
        self, distance: FloatArray, field: Field, errors: Errors, environment: Environment | None = None
    ) -> MeasuredInverseDepth:
        """Inverse depths from disparity in the frame of the left camera; for the arguments, see `DepthCamera.read`.

        The axis starts in the middle of the baseline and bisects the two optical axes. Field positions lie between it
        and the corner of the left picture, as imaged by its lens model. Principal distances expand with the
        housing, the baseline with its own part and the pixels, about the middle of the picture, with the sensor;
        pressure, colour and the thermal drift of a lens move its focus, but not its principal distance.
        """
        require_known(errors, self.vocabulary, "a rig calibrated from corners")
        rigs = [np.shape(error) for name, error in errors.items() if name != PIXEL_NOISE]
        if any(len(shape) == 2 and shape[1] > 1 for shape in rigs):
            return self._at_each(distance, field, errors, environment)
        points = self._points(np.asarray(distance, dtype=np.float64), field)
        seen = observe_pair(self._true_rig(errors, environment), points, self.lenses, self.free)
        size = np.array([*self.pixels, *self.pixels], dtype=np.float64)
        if environment is not None:
            seen = (size - 1.0) / 2.0 + (seen - (size - 1.0) / 2.0) / environment.scale_factor(errors)[..., None]
        inside = np.all((seen >= -0.5) & (seen <= size - 0.5), axis=-1)  # False for NaN, outside the field of a lens
        half = value_of(errors, PIXEL_NOISE)[..., None] / (2.0 * self.pixel_pitch)
        measured = np.where(inside[..., None], seen, size / 2.0) + half * np.array([1.0, 0.0, -1.0, 0.0])
        inverse = inverse_depth(self._calibrated_rigs(errors), measured, self.lenses, self.free)
        return MeasuredInverseDepth(
            inverse_depth=inverse, no_overlap=np.atleast_2d(~inside), out_of_range=inside & np.isnan(inverse)
        )

    @property
    def pair(self) -> CalibratedPair:
        """The pair that measures depth."""
        return CalibratedPair(parameters=tuple(map(float, self.best)), lenses=self.lenses, free=self.free)

    def cropped(self, columns: int, rows: int) -> RigMeasurement:
        """See `CalibratedMeasurement`; the principal points keep their places in the object's picture."""
        best, own = self.best.copy(), (len(self.best) - 6) // 2
        for axis, size in enumerate((columns, rows)):
            best[[2 + axis, own + 2 + axis]] += (size - self.pixels[axis]) / 2.0
        return replace(self, best=best, pixels=(columns, rows))

    def disparity_px(self, distance: FloatArray) -> FloatArray:
        """See `CalibratedMeasurement`; infinity is computed as a distance of 10¹² m."""
        seen = observe_pair(
            self.best, points_midway(self.best, np.minimum(distance, _FARTHEST)), self.lenses, self.free
        )
        left, right = cameras_of(self.best)
        return np.asarray((seen[..., 0] - left[2]) - (seen[..., 2] - right[2]))

    def shared_area(self, distance: FloatArray) -> FloatArray:
        """See `CalibratedMeasurement`."""
        return shared_area(self.best, self.lenses, self.free, self.pixels, distance)

    def _at_each(
        self, distance: FloatArray, field: Field, errors: Errors, environment: Environment | None
    ) -> MeasuredInverseDepth:
        """Measure one distance at a time, for errors of shape (draws, distances)."""
        found = []
        for k in range(len(distance)):
            values = {name: value_of(errors, name) for name in errors}
            here = {
                name: one[:, k : k + 1] if one.shape[-1:] == distance.shape else one for name, one in values.items()
            }
            found.append(self(distance[k : k + 1], field, here, environment))
        columns = np.broadcast_arrays(*(one.inverse_depth for one in found))
        return MeasuredInverseDepth(
            inverse_depth=np.concatenate(columns, axis=-1),
            no_overlap=np.concatenate([np.broadcast_to(one.no_overlap, columns[0].shape) for one in found], axis=-1),
            out_of_range=np.concatenate(
                [np.broadcast_to(one.out_of_range, columns[0].shape) for one in found], axis=-1
            ),
        )

    def _points(self, z: FloatArray, field: Field) -> FloatArray:
        """Points at distances z [m] in the left camera's frame, shape (distances, 3)."""
        across, down = (
            share * self.pixels[axis] / 2.0 / self.best[axis] for axis, share in enumerate(shares_of(field))
        )
        points = points_midway(self.best, z)
        points[:, :2] += z[:, None] * np.stack(slopes(*self.lenses[0].ray(across, down)), axis=-1)
        return points

    def _true_rig(self, errors: Errors, environment: Environment | None) -> FloatArray:
        """The true rig at the current temperature, shape (P,) or (draws, P)."""
        if environment is None or "temperature_change" not in errors:
            return self.best
        names = shared_names(self.free)
        grown = np.where(
            ["focal_length" in name for name in names], environment.housing_factor(errors).reshape(-1, 1), 1.0
        )
        apart = np.where(
            ["translation" in name for name in names], environment.baseline_factor(errors).reshape(-1, 1), 1.0
        )
        return np.asarray(self.best * grown * apart)

    def _calibrated_rigs(self, errors: Errors) -> FloatArray:
        """The rigs that calibrations with errors describe, shape (draws, P)."""
        names = shared_names(self.free)
        own = np.broadcast_arrays(*(_of_draws(errors, name) for name in names))
        rigs: FloatArray = self.best + np.stack(own, axis=-1)
        if aged := {name for name in errors if name not in names and name in self.vocabulary} - {PIXEL_NOISE}:
            rigs = rigs + self._interior(errors)
        return _posed(rigs, errors) if aged & set(_POSE) else rigs

    def _interior(self, errors: Errors) -> FloatArray:
        """Errors of the cameras by the names of a stereo rig, shape (draws, P)."""
        pitch, columns = self.pixel_pitch, []
        for side in SIDES:
            focal = (_of_draws(errors, "focal_length") + _of_draws(errors, f"{side}_focal_length")) / pitch
            apart = _BOTH[side] * _of_draws(errors, "principal_point")
            columns += [
                focal,
                focal,
                (apart + _of_draws(errors, f"{side}_principal_point_x")) / pitch,
                _of_draws(errors, f"{side}_principal_point_y") / pitch,
                *(_of_draws(errors, f"{side}_distortion_{name}") for name in self.free),
            ]
        return np.stack(np.broadcast_arrays(*columns, *[np.zeros(1)] * len(RELATIVE_POSE_NAMES)), axis=-1)


def _of_draws(errors: Errors, name: str) -> FloatArray:
    """One of the errors, shape (draws,) or (1,)."""
    return value_of(errors, name).reshape(-1)


def _right_centre(rigs: FloatArray) -> FloatArray:
    """Centre of the right camera in the left camera's frame, −Rᵀ t [m], shape (..., 3)."""
    centre: FloatArray = -(rotation_matrix(rigs[..., ROTATION]).swapaxes(-1, -2) @ rigs[..., TRANSLATION, None])[..., 0]
    return centre


def _posed(rigs: FloatArray, errors: Errors) -> FloatArray:
    """Rigs with the right camera moved and rotated by the errors of a stereo rig; see `cameras.stereo.pair`."""
    yaw, pitch, roll, longer, down, along = np.broadcast_arrays(*(_of_draws(errors, name) for name in _POSE))
    zero = np.zeros_like(yaw)
    turned = (
        rotation_matrix(np.stack([zero, -yaw, zero], axis=-1))
        @ rotation_matrix(np.stack([pitch, zero, zero], axis=-1))
        @ rotation_matrix(np.stack([zero, zero, roll], axis=-1))
    )
    centre = _right_centre(rigs)
    length = np.linalg.norm(centre, axis=-1, keepdims=True)
    direction = centre / length + np.stack([zero, np.tan(down), np.tan(along)], axis=-1)
    direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    rotation = rotation_matrix(rigs[..., ROTATION]) @ np.swapaxes(turned, -1, -2)
    moved = -(rotation @ (direction * (length + longer[:, None]))[..., None])[..., 0]
    interior = np.broadcast_to(rigs[..., :-6], (*moved.shape[:-1], rigs.shape[-1] - 6))
    return np.concatenate([interior, rotation_vector(rotation), moved], axis=-1)
