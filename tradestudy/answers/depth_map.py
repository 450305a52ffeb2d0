"""Depth uncertainty over the picture of a rig, by linearising its exact model at every place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_camera import DepthCamera, false_match_share
from tradestudy.cameras.depth_measurement import (
    Field,
    FieldPosition,
    MeasuredInverseDepth,
    PicturePlaces,
    towards_corners,
)
from tradestudy.depth.evaluation import model_error
from tradestudy.depth.linear import has_covariance, linear_distribution, noise_distribution
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset, distances_without_decision
from tradestudy.study.prepared import PreparedStudy

ACROSS: Final = 25
DOWN: Final = 15
"""Places across and down; odd, so that the middle of the picture is one of them."""
_RADII: Final = 6  # number of radii at which a derived disparity error is evaluated
_MODEL_PLACES: Final[tuple[FieldPosition, ...]] = (0.0, *towards_corners(0.5), *towards_corners(1.0))
"""Where the linear model is compared with the exact model."""


@dataclass(frozen=True, kw_only=True, eq=False)
class UncertaintyMap:
    """Depth uncertainty over the picture.

    Parameters
    ----------
    uncertainty : array (D, DOWN, ACROSS)
        Half the central 68.27 % interval of one measured depth [m], with noise exact and calibration linear in inverse
        depth; NaN where only one camera sees the point, or neither; infinite where the interval has no far end.
    error : array (D,)
        Largest measured error of the linear model, as a share of the uncertainty [1]; NaN where none is measured.
    radius, radius_error : arrays (D, DOWN, ACROSS), (D,)
        The same for the radius about the true depth that contains 68.27 % of all measurements, failed ones and declared
        false matches counted as infinitely wrong; infinite where too many fail.
    """

    uncertainty: FloatArray
    error: FloatArray
    radius: FloatArray
    radius_error: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _AtPlaces:
    """A camera evaluated at places in its picture instead of one field position."""

    camera: DepthCamera
    places: PicturePlaces

    @property
    def calibration(self) -> Calibration:
        return self.camera.calibration

    @property
    def propagation(self) -> Propagation:
        return self.camera.propagation

    @property
    def sample_pitch(self) -> float:
        return self.camera.sample_pitch

    def noise(self, distance: ArrayLike, field: FieldPosition = 0.0) -> FloatArray:  # noqa: ARG002 - the places replace it
        """Interpolated between radii; a declared error is the same everywhere."""
        z = np.asarray(distance, dtype=np.float64)
        if isinstance(self.camera.disparity_error_px, float | int):
            return self.camera.noise(z)
        sensor = self.camera.sensor
        half = np.array([sensor.columns, sensor.rows])
        radius = np.hypot(self.places.across * half[0], self.places.down * half[1]) / np.hypot(*half)
        # At each distance, noise depends on the radius alone, so a few radii give it at every place.
        radii, noise = np.linspace(0.0, 1.0, _RADII), np.empty_like(z)
        for plane in np.unique(z):
            at_radii = [float(self.camera.noise(np.array([plane]), float(share))[0]) for share in radii]
            noise[z == plane] = np.interp(radius[z == plane], radii, at_radii)
        return noise

    def measured_depth(
        self,
        distance: FloatArray,
        field: Field,  # noqa: ARG002 - the places replace it
        values: Mapping[str, FloatArray],
    ) -> MeasuredInverseDepth:
        """See `DepthCamera.measured_depth`."""
        return self.camera.measured_depth(distance, self.places, values)


def map_places() -> tuple[FloatArray, FloatArray]:
    """Shares of half the sensor across (ACROSS,) and down (DOWN,): the middles of equal cells."""
    across, down = ((2.0 * np.arange(count) + 1.0) / count - 1.0 for count in (ACROSS, DOWN))
    return across, down


def depth_map(camera: DepthCamera, distance: FloatArray) -> UncertaintyMap | None:
    """Map the depth uncertainty of a camera at distances [m], shape (D,).

    None for a camera whose `mapped` is false, or one of whose uncertain parameters has no variance.
    """
    if not camera.mapped or not has_covariance(camera):
        return None
    across, down = map_places()
    z, y, x = (grid.ravel() for grid in np.meshgrid(distance, down, across, indexing="ij"))
    at_places = _AtPlaces(camera=camera, places=PicturePlaces(across=x, down=y))
    with_calibration = bool(camera.calibration.groups)
    false_matches = false_match_share(camera, "both")
    predicted = (
        linear_distribution(at_places, z, 0.0, "both", false_matches)
        if with_calibration
        else noise_distribution(at_places, z, 0.0, false_matches)
    )
    # The map is linear whichever model the study propagates errors by, so the error to state is that of the linear one.
    linear = replace(camera, propagation=replace(camera.propagation, model="linear"))
    missed = [model_error(linear, distance, "both", field) for field in _MODEL_PLACES]
    shape = len(distance), DOWN, ACROSS
    return UncertaintyMap(
        uncertainty=predicted.half_width.reshape(shape),
        error=np.fmax.reduce([error.half_width for error in missed]),
        radius=predicted.error_radius.reshape(shape),
        radius_error=np.fmax.reduce([error.radius for error in missed]),
    )


def depth_map_group(study: PreparedStudy) -> xr.Dataset | None:
    """Maps of all cameras that have one, as declared; None if no camera has one."""
    distance = distances_without_decision(study.case.distance)
    by_camera = {name: depth_map(camera, distance) for name, camera in study.case.cameras.items()}
    maps = {name: mapped for name, mapped in by_camera.items() if mapped is not None}
    if not maps:
        return None
    across, down = map_places()
    with np.errstate(invalid="ignore"):  # the error of an unbounded uncertainty is unknown
        errors = np.stack([mapped.uncertainty * mapped.error[:, None, None] for mapped in maps.values()])
        radius_errors = np.stack([mapped.radius * mapped.radius_error[:, None, None] for mapped in maps.values()])
    uncertainty = np.stack([mapped.uncertainty for mapped in maps.values()])
    values = {
        "depth_uncertainty": uncertainty,
        "depth_uncertainty_error": errors,
        "relative_uncertainty": uncertainty / distance[:, None, None],
        "depth_error_radius": np.stack([mapped.radius for mapped in maps.values()]),
        "depth_error_radius_error": radius_errors,
    }
    return dataset("depth_map", values, {"camera": list(maps), "distance": distance, "down": down, "across": across})
