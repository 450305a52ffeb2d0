"""Depth measured by a calibrated pair, with errors in all its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from tradestudy.calibration.corners.real_rig import inverse_depth, observe_pair, points_midway
from tradestudy.calibration.corners.view_blocks import (
    RELATIVE_POSE_NAMES,
    ROTATION,
    TRANSLATION,
    cameras_of,
    right_centre,
    shared_names,
)
from tradestudy.calibration.projection import (
    RADIAL_LENS,
    FreeLens,
    coefficient_of,
    intrinsic_names,
    project,
    ray_slopes,
    rotation_matrix,
    rotation_vector,
)
from tradestudy.cameras.calibrated_pair import (
    PINHOLES,
    RADIAL,
    CalibratedPair,
    Lenses,
    PairGeometry,
    common_focal_length,
)
from tradestudy.cameras.depth_measurement import (
    INTERIOR,
    PIXEL_NOISE,
    Environment,
    ErrorParameter,
    Errors,
    ErrorVocabulary,
    Field,
    MeasuredInverseDepth,
    Unit,
    require_known,
    shares_of,
    value_of,
)
from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lens_families import ANGLES
from tradestudy.optics.lens_model import LensModel, slopes
from tradestudy.units import significant, with_deviation
from tradestudy.wording import listed

_NODES: Final = (33, 25)  # nodes across and down
_OUTSIDE: Final = -1.0  # px from the edge, for nodes that show no point or whose point has no image


def shared_area(
    rig: FloatArray,
    lenses: Lenses,
    free: Sequence[str],
    pixels: tuple[int, int],
    distance: FloatArray,
    right_pixels: tuple[int, int] | None = None,
) -> FloatArray:
    """Share of the area of a picture whose points the other camera also sees; the smaller of both pictures' shares.

    Points lie in a plane perpendicular to the left camera's axis. Between nodes in the picture, the distance of a
    point's image from the edge of the other picture is interpolated linearly; the share errs by about 1e-3.

    Parameters
    ----------
    rig : array (P,)
        Parameters in the order of ``view_blocks.shared_names`` [px, 1, rad, m].
    lenses, free
        Lens models, and names of their free coefficients.
    pixels
        Columns and rows of each picture.
    distance : array (D,)
        Z [m] from the left camera.
    right_pixels
        Columns and rows of the right picture, if it has others.

    Returns
    -------
    array (D,)
        ``1 − B/W`` for parallel pinholes whose pictures are W wide at the distance.
    """
    of_left, of_right = cameras_of(rig)
    turn, translation = rotation_matrix(rig[ROTATION]), rig[TRANSLATION]
    sizes = (pixels, right_pixels or pixels)
    left, right = (
        np.stack(np.meshgrid(*(np.linspace(-0.5, n - 0.5, k) for n, k in zip(size, _NODES, strict=True))), axis=-1)
        for size in sizes
    )
    from_left = _directions(of_left, left, lenses[0], free)
    in_right = project(of_right, _on_rays(translation, turn @ from_left, distance[:, None]), lenses[1], free)
    centre, from_right = -turn.T @ translation, turn.T @ _directions(of_right, right, lenses[1], free)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (distance[:, None] - centre[2]) / from_right[2]
    in_left = project(of_left, _on_rays(centre, from_right, np.where(along > 0.0, along, np.nan)), lenses[0], free)
    places = zip((in_right, in_left), sizes[::-1], strict=True)
    shares = [_share_inside(images, size).reshape(distance.shape) for images, size in places]
    return np.minimum(*shares)


def _directions(camera: FloatArray, nodes: FloatArray, lens: LensModel, free: Sequence[str]) -> FloatArray:
    """Directions of the rays through nodes of a camera's picture, shape (3, N)."""
    x, y = ray_slopes(camera, nodes.reshape(-1, 2), lens, free).T
    return np.stack([x, y, np.ones_like(x)])


def _on_rays(start: FloatArray, directions: FloatArray, along: FloatArray) -> FloatArray:
    """Points (D, N, 3) on rays from a start, these multiples (D, N) of directions (3, N) away."""
    return np.moveaxis(start[:, None, None] + along * directions[:, None], 0, -1)


def _share_inside(images: FloatArray, pixels: tuple[int, int]) -> FloatArray:
    """Share of a picture's area, shape (D,), that another picture shows; (D, N, 2) [px] are the nodes' images there."""
    across, down = (size / 2.0 - np.abs(images[..., axis] - (size - 1.0) / 2.0) for axis, size in enumerate(pixels))
    inside = np.asarray(np.minimum(across, down)).reshape(-1, *_NODES[::-1])
    inside[np.isnan(inside)] = _OUTSIDE
    corners = inside[:, :-1, :-1], inside[:, :-1, 1:], inside[:, 1:, :-1], inside[:, 1:, 1:]
    held = np.stack([corner >= 0.0 for corner in corners])
    shares = np.all(held, axis=0).astype(np.float64)
    cut = (shares == 0.0) & np.any(held, axis=0)  # few, on the edge of the other picture
    # Each cell is cut into two triangles, on which the distance from the edge is linear.
    a, b, c, d = (corner[cut] for corner in corners)
    shares[cut] = _positive_part(np.sort([[a, a], [b, c], [d, d]], axis=0)).mean(axis=0)
    return np.asarray(shares.mean(axis=(1, 2)))


def _positive_part(corners: FloatArray) -> FloatArray:
    """Share of triangles in which a linear function is not negative, from ascending values (3, ...)."""
    low, middle, high = corners
    with np.errstate(divide="ignore", invalid="ignore"):
        one_positive = high**2 / ((high - low) * (high - middle))
        two_positive = 1.0 - low**2 / ((middle - low) * (high - low))
    return np.select(
        [low >= 0.0, high <= 0.0, middle <= 0.0], [np.ones_like(low), np.zeros_like(low), one_positive], two_positive
    )


LENGTH_LIMIT = 0.05  # of a declared focal length or baseline
ANGLE_LIMIT = 0.05  # of the field of view
CENTRE_LIMIT = 0.15  # of the sensor, for the principal point
_DEVIATIONS = 5.0
Says = Literal["corners say", "the posterior says"]


class GeometryContradictionError(TradestudyError):
    """The declared geometry of a rig contradicts the one fitted to its corners."""

    exit_status = 2


def check_geometry(
    name: str, rig: PairGeometry, best: FloatArray, draws: FloatArray, *, says: Says, lens: FreeLens = RADIAL_LENS
) -> None:
    """Refuse a declared pair that contradicts the fitted one, listing all contradictions.

    Parameters
    ----------
    name
        Name of the camera in its study.
    rig
        The declared pair.
    best : array (P,)
        Best parameters, in the order of ``view_blocks.shared_names``.
    draws : array (K, P)
        Joint draws, whose spread is the uncertainty of these parameters.
    says
        Subject and verb that introduce the parameters in messages.
    lens
        Lens model of the free coefficients.

    Raises
    ------
    GeometryContradictionError
        The focal length or baseline differs by more than 5 %, the angle between the axes differs by more than 5 % of
        the field of view, or the principal point lies farther from the centre of the sensor than 15 % of its size.
        Where five standard deviations are larger than one of these limits, they replace it.
    """
    if contradictions := tuple(_contradictions(name, rig, best, draws, says, lens)):
        raise GeometryContradictionError("\n".join(contradictions))


def check_inside(name: str, rig: PairGeometry, corners: FloatArray) -> None:
    """Refuse corners (N, 2) [px] outside the declared sensor, which mean that the pictures have another size.

    Raises
    ------
    GeometryContradictionError
        A corner lies outside.
    """
    size = np.array([rig.sensor.columns, rig.sensor.rows])
    if np.all((corners >= -0.5) & (corners <= size - 0.5)):
        return
    low, high = corners.min(axis=0), corners.max(axis=0)
    raise GeometryContradictionError(
        f"declared sensor {size[0]} × {size[1]} px, but corners lie between ({low[0]:.0f}, {low[1]:.0f}) and "
        f"({high[0]:.0f}, {high[1]:.0f}) px; correct cameras.{name}.sensor.pixels or use another corner file"
    )


def _contradictions(
    name: str, rig: PairGeometry, best: FloatArray, draws: FloatArray, says: Says, lens: FreeLens
) -> Iterator[str]:
    """One line for each quantity that differs by more than the limit."""
    focal, baseline, angle = _geometry(best)
    deviation = np.std(np.stack(_geometry(draws)), axis=-1)
    instead = "another corner file" if says == "corners say" else "another posterior"
    # The scale of the image on the axis makes focal lengths of different lens models comparable.
    fitted = np.mean([lens.at(camera[4:]).scale_on_axis for camera in cameras_of(best)])
    focal, deviation[0] = focal * fitted, deviation[0] * fitted
    declared = rig.principal_distance / rig.sensor.pixel_pitch * rig.distortion.scale_on_axis
    rows = (
        ("focal length", "lenses", "px", 1.0, declared, focal, LENGTH_LIMIT * declared),
        ("baseline", "baseline", "mm", 1e3, rig.baseline, baseline, LENGTH_LIMIT * rig.baseline),
        (
            "angle between the axes",
            "convergence_distance",
            "°",
            np.degrees(1.0),
            rig.convergence_angle,
            angle,
            ANGLE_LIMIT * rig.field_of_view,
        ),
    )
    for (what, key, unit, per_unit, said, measured, allowed), spread in zip(rows, deviation, strict=True):
        if abs(said - measured) > max(allowed, _DEVIATIONS * spread):
            label = unit if unit == "°" else f" {unit}"
            yield (
                f"declared {what} {significant(said * per_unit, 4)}{label}, {says} "
                f"{with_deviation(float(measured) * per_unit, float(spread) * per_unit, digits=1)}{label}; "
                f"correct cameras.{name}.{key} or use {instead}"
            )
    size = np.array([rig.sensor.columns, rig.sensor.rows])
    far: dict[str, str] = {}
    for side, intrinsics, drawn in zip(("left", "right"), cameras_of(best), cameras_of(draws), strict=True):
        centre, spread = intrinsics[2:4], drawn[:, 2:4].std(axis=0)
        if np.any(np.abs(centre - (size - 1) / 2.0) > np.maximum(CENTRE_LIMIT * size, _DEVIATIONS * spread)):
            far[side] = f"({centre[0]:.0f}, {centre[1]:.0f})"
    if far:
        axes = "optical axis meets" if len(far) == 1 else "optical axes meet"
        yield (
            f"declared sensor {size[0]} × {size[1]} px, {says} that the {listed(list(far))} {axes} it at "
            f"{listed(list(far.values()))} px; correct cameras.{name}.sensor.pixels or use {instead}"
        )


def _geometry(shared: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Common focal length [px], baseline [m], and angle by which the axes converge [rad], each of shape (...,)."""
    right_axis = rotation_matrix(shared[..., ROTATION])[..., 2, :]  # in the frame of the left camera
    return (
        common_focal_length(*(camera[..., :2].mean(axis=-1) for camera in cameras_of(shared))),
        np.linalg.norm(shared[..., TRANSLATION], axis=-1),
        np.arctan2(-right_axis[..., 0], right_axis[..., 2]),
    )


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
    right_pixels
        Columns and rows of the right picture, if it has others.
    """

    best: FloatArray
    pixels: tuple[int, int]
    pixel_pitch: float
    vocabulary: ErrorVocabulary
    lenses: Lenses = PINHOLES
    free: tuple[str, ...] = RADIAL
    right_pixels: tuple[int, int] | None = None

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
        # Errors that differ from distance to distance describe another rig at each.
        if any(len(shape) == 2 and shape[1] > 1 for shape in rigs):
            return self._at_each(distance, field, errors, environment)
        points = self._points(np.asarray(distance, dtype=np.float64), field)
        images = observe_pair(self._true_rig(errors, environment), points, self.lenses, self.free)
        size = np.array([*self.pixels, *(self.right_pixels or self.pixels)], dtype=np.float64)
        if environment is not None:
            images = (size - 1.0) / 2.0 + (images - (size - 1.0) / 2.0) / environment.scale_factor(errors)[..., None]
        # False for NaN, outside the field of a lens.
        inside = np.all((images >= -0.5) & (images <= size - 0.5), axis=-1)
        left, right = self._noise_shares
        noise = value_of(errors, PIXEL_NOISE)[..., None] / self.pixel_pitch
        # Points that no picture shows are marked below; the middle of the picture stands in for them.
        measured = np.where(inside[..., None], images, size / 2.0) + noise * np.array([left, 0.0, -right, 0.0])
        inverse = inverse_depth(self._calibrated_rigs(errors), measured, self.lenses, self.free)
        return MeasuredInverseDepth(
            inverse_depth=inverse, no_overlap=np.atleast_2d(~inside), out_of_range=inside & np.isnan(inverse)
        )

    @property
    def _noise_shares(self) -> tuple[float, float]:
        """Movements of the left and, reversed, of the right x per noise of the disparity: c/2c_i, or 1/2 if equal.

        With independent errors of both x, u/√2 in pixels of their own camera, the disparity at the
        `common_focal_length` c is wrong by u; these are the mean movements of both x for a given error of disparity.
        """
        left, right = (np.mean(camera[:2]) for camera in cameras_of(self.best))
        c = common_focal_length(left, right)
        return float(c / (2.0 * left)), float(c / (2.0 * right))

    @property
    def pair(self) -> CalibratedPair:
        """The pair that measures depth."""
        return CalibratedPair(parameters=tuple(map(float, self.best)), lenses=self.lenses, free=self.free)

    def cropped(self, columns: int, rows: int) -> RigMeasurement:
        """See `CalibratedMeasurement`; the principal points keep their places in the object's picture.

        If the pictures differ in size, only the left one is cropped.
        """
        best, per_camera = self.best.copy(), (len(self.best) - 6) // 2
        for axis, size in enumerate((columns, rows)):
            best[[2 + axis, per_camera + 2 + axis] if self.right_pixels is None else [2 + axis]] += (
                size - self.pixels[axis]
            ) / 2.0
        return replace(self, best=best, pixels=(columns, rows))

    def disparity_px(self, distance: FloatArray) -> FloatArray:
        """See `CalibratedMeasurement`; infinity is computed as a distance of 10¹² m."""
        images = observe_pair(
            self.best, points_midway(self.best, np.minimum(distance, _FARTHEST)), self.lenses, self.free
        )
        (left, right), (of_left, of_right) = cameras_of(self.best), self._noise_shares
        return np.asarray(2.0 * (of_left * (images[..., 0] - left[2]) - of_right * (images[..., 2] - right[2])))

    def shared_area(self, distance: FloatArray) -> FloatArray:
        """See `CalibratedMeasurement`."""
        return shared_area(self.best, self.lenses, self.free, self.pixels, distance, self.right_pixels)

    def _at_each(
        self, distance: FloatArray, field: Field, errors: Errors, environment: Environment | None
    ) -> MeasuredInverseDepth:
        """Measure one distance at a time, for errors of shape (draws, distances)."""
        measured = []
        for k in range(len(distance)):
            values = {name: value_of(errors, name) for name in errors}
            at_distance = {
                name: error[:, k : k + 1] if error.shape[-1:] == distance.shape else error
                for name, error in values.items()
            }
            measured.append(self(distance[k : k + 1], field, at_distance, environment))
        columns = np.broadcast_arrays(*(part.inverse_depth for part in measured))
        return MeasuredInverseDepth(
            inverse_depth=np.concatenate(columns, axis=-1),
            no_overlap=np.concatenate(
                [np.broadcast_to(part.no_overlap, columns[0].shape) for part in measured], axis=-1
            ),
            out_of_range=np.concatenate(
                [np.broadcast_to(part.out_of_range, columns[0].shape) for part in measured], axis=-1
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
        drawn = np.broadcast_arrays(*(_of_draws(errors, name) for name in names))
        rigs: FloatArray = self.best + np.stack(drawn, axis=-1)
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


def _posed(rigs: FloatArray, errors: Errors) -> FloatArray:
    """Rigs with the right camera moved and rotated by the errors of a stereo rig; see `cameras.stereo.pair`."""
    yaw, pitch, roll, longer, down, along = np.broadcast_arrays(*(_of_draws(errors, name) for name in _POSE))
    zero = np.zeros_like(yaw)
    turned = (
        rotation_matrix(np.stack([zero, -yaw, zero], axis=-1))
        @ rotation_matrix(np.stack([pitch, zero, zero], axis=-1))
        @ rotation_matrix(np.stack([zero, zero, roll], axis=-1))
    )
    centre = right_centre(rigs)
    length = np.linalg.norm(centre, axis=-1, keepdims=True)
    direction = centre / length + np.stack([zero, np.tan(down), np.tan(along)], axis=-1)
    direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    rotation = rotation_matrix(rigs[..., ROTATION]) @ np.swapaxes(turned, -1, -2)
    moved = -(rotation @ (direction * (length + longer[:, None]))[..., None])[..., 0]
    interior = np.broadcast_to(rigs[..., :-6], (*moved.shape[:-1], rigs.shape[-1] - 6))
    return np.concatenate([interior, rotation_vector(rotation), moved], axis=-1)
