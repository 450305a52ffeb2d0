"""A stereo rig of two equal cameras side by side, with parallel or converging axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import (
    DepthErrorPart,
    DisparityError,
    ErrorSource,
    Limit,
    UsableCriteria,
    disparity_error_at,
    require_disparity_error,
    require_expansion,
)
from tradestudy.cameras.focus import EveryObjectFocus, SingleLensFocus
from tradestudy.cameras.parts import Lens, Sensor, require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.thin_lens import blur_diameter, image_distance
from tradestudy.optics.triangulation import midpoint_depth, stereo_depth, stereo_disparity

# Ten times that of the strongest objectives of microscopes: no sensor stands so far behind its lens.
_LARGEST_MAGNIFICATION = 1000.0
NO_ERROR = ErrorSource(standard_deviation=0.0)
PrincipalDistanceRule = Literal["focal_length", "focused"]


@dataclass(frozen=True, kw_only=True)
class StereoCalibration:
    """Calibration errors of the rig, each one draw per rig: what the rig is, less what its calibration says.

    Parameters
    ----------
    yaw, pitch, roll
        Relative rotation of the two cameras about the vertical, the baseline and the optical axis [rad].
    baseline
        Of the distance of the two centres of projection [m].
    focal_length
        Of the common principal distance [m], which is what a calibration's focal length in pixels is. It moves depth by
        ``δZ/Z = δc/c`` wherever the lenses are focused; the focal length of the glass itself enters no line of sight.
    principal_point
        Difference of the two principal points along the baseline [m on the sensor].
    """

    yaw: ErrorSource = NO_ERROR
    pitch: ErrorSource = NO_ERROR
    roll: ErrorSource = NO_ERROR
    baseline: ErrorSource = NO_ERROR
    focal_length: ErrorSource = NO_ERROR
    principal_point: ErrorSource = NO_ERROR


@dataclass(frozen=True, kw_only=True)
class StereoRig:
    """Two cameras at the ends of a baseline.

    Parameters
    ----------
    lens, sensor
        Of each camera.
    focus_distance
        Where both lenses are focused [m]; infinity is allowed. None: the lenses refocus on every object.
    principal_distance_rule
        How far the sensor stands behind the centre of projection. ``focal_length``: the focal length, exact for lenses
        focused at infinity and where the declared focal length is that of a calibration in pixels. ``focused``: where
        the thin lens puts the sharp image of the focus distance a, ``c = f a/(a − f)``, the lens moved as a whole.
    baseline
        Distance of the two centres of projection B [m].
    convergence_angle
        Between the optical axes [rad]; 0 is parallel, positive meets in front.
    triangulation
        ``disparity`` measures along the baseline in rectified pictures; ``midpoint`` takes the middle of the shortest
        segment between the two lines of sight. They agree unless the rays are skew.
    disparity_error_px
        Standard deviation of one measured disparity [px], or the law it follows from.
    discrimination_step_px
        The disparity step [px] of the depth discrimination.
    calibration
        See `StereoCalibration`.
    expansion
        Standard deviation of the relative change of the baseline with temperature since the calibration.

    Raises
    ------
    OutOfRangeError
        For lengths that are not positive, a focus distance inside the focal length or so little beyond it that the
        lenses would magnify more than a thousand times, axes that converge by 180° or more;
        lenses that refocus on every object and have no one focused principal distance.
    """

    lens: Lens
    sensor: Sensor
    focus_distance: float | None
    principal_distance_rule: PrincipalDistanceRule = "focal_length"
    baseline: float
    convergence_angle: float
    triangulation: Literal["disparity", "midpoint"]
    disparity_error_px: DisparityError
    discrimination_step_px: float
    calibration: StereoCalibration = field(default_factory=StereoCalibration)
    expansion: float = 0.0

    family: Literal["stereo"] = field(default="stereo", init=False)

    def __post_init__(self) -> None:
        require_positive("baseline", self.baseline)
        require_disparity_error(self.disparity_error_px)
        require_positive("discrimination step", self.discrimination_step_px, "px")
        require_expansion(self.expansion)
        if not abs(self.convergence_angle) < math.pi:
            raise OutOfRangeError(
                "convergence of the stereo axes",
                value=f"{math.degrees(self.convergence_angle):g}°",
                limit="below 180°",
            )
        if self.focus_distance is not None and not self.focus_distance > self.lens.focal_length:
            raise OutOfRangeError(
                "the lenses cannot focus that close",
                value=f"{self.focus_distance * 1e3:g} mm",
                limit=f"beyond the focal length, {self.lens.focal_length * 1e3:g} mm",
                remedy="increase the focus distance",
            )
        if self.focus_distance is not None and self._magnification > _LARGEST_MAGNIFICATION:
            raise OutOfRangeError(
                f"focused at {self.focus_distance * 1e3:.9g} mm, just beyond the focal length, the lenses magnify",
                value=f"{self._magnification:.3g} times, with the sensors "
                f"{self.sensor_distance(self.focus_distance):.3g} m behind them",
                limit=f"at most {_LARGEST_MAGNIFICATION:g} times",
                remedy="increase the focus distance",
            )
        if self.principal_distance_rule == "focused" and self.focus_distance is None:
            raise OutOfRangeError(
                "the principal distance of lenses that refocus on every object",
                value="focused",
                limit="focal_length: every focus setting has a calibration of its own",
                remedy="give a focus distance, or take the focal length as the principal distance",
            )

    @property
    def _magnification(self) -> float:
        """Image over object at the focus distance a, ``f/(a − f)``."""
        assert self.focus_distance is not None
        return self.lens.focal_length / (self.focus_distance - self.lens.focal_length)

    @property
    def principal_distance(self) -> float:
        """From the centre of projection to the sensor c [m], by the declared rule: what angles are measured with."""
        if self.principal_distance_rule == "focal_length" or self.focus_distance is None:
            return self.lens.focal_length
        return self.sensor_distance(self.focus_distance)

    def sensor_distance(self, focus_distance: float) -> float:
        """From a thin lens to the sensor [m] when it is focused at a distance [m]: ``f a/(a − f)``."""
        return float(image_distance(focus_distance, self.lens.focal_length))

    @property
    def focus(self) -> SingleLensFocus | EveryObjectFocus:
        """What both lenses keep sharp: they are equal and the depth of field of each is that of the rig."""
        if self.focus_distance is None:
            return EveryObjectFocus(lens=self.lens, sample_pitch=self.sensor.pixel_pitch, mechanisms=2)
        return SingleLensFocus(
            lens=self.lens,
            focus_distance=self.focus_distance,
            sample_pitch=self.sensor.pixel_pitch,
            name="both lenses",
        )

    def images(self, distance: ArrayLike) -> BoolArray:
        """Where an object lies beyond the focal length, so that the lenses form a picture of it."""
        return np.asarray(np.asarray(distance, dtype=np.float64) > self.lens.focal_length)

    @property
    def field_of_view(self) -> float:
        """Across, of one camera as it is focused [rad]."""
        return self.view_of(self.sensor.width)

    def view_of(self, extent: float) -> float:
        """Full angle [rad] that an extent [m] of the sensor covers: ``2 atan(extent / 2c)``."""
        return 2.0 * math.atan(extent / (2.0 * self.principal_distance))

    def disparity(self, distance: ArrayLike) -> FloatArray:
        """The disparity on the sensor [m]; see `stereo_disparity`."""
        return stereo_disparity(
            distance, self.baseline, self.principal_distance, convergence_angle=self.convergence_angle
        )

    def disparity_px(self, distance: ArrayLike) -> FloatArray:
        """The disparity [px]."""
        return self.disparity(distance) / self.sensor.pixel_pitch

    def disparity_of_infinity(self, distance: ArrayLike) -> FloatArray:
        """The disparity of infinity [m]: 0 for parallel axes."""
        return np.broadcast_to(self.disparity(np.inf), np.shape(distance))

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:  # noqa: ARG002 - the same at every distance
        """``Z = c B / d`` [m] or its converging counterpart; see `stereo_depth`."""
        return stereo_depth(disparity, self.baseline, self.principal_distance, convergence_angle=self.convergence_angle)

    def depth_discrimination(self, distance: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Change of depth [m] that moves the disparity by one step, nearer and farther (which may be infinite)."""
        z = np.asarray(distance, dtype=np.float64)
        d, step = self.disparity(z), self.discrimination_step_px * self.sensor.pixel_pitch
        return z - self.depth_of_disparity(d + step, z), self.depth_of_disparity(d - step, z) - z

    def depth_error_parts(self, distance: ArrayLike) -> tuple[DepthErrorPart, ...]:
        """Parts of the error as errors of disparity [m], to first order, on the line midway between the cameras.

        With c the principal distance, u = B/2Z and x = d/2: yaw ψ adds ``ψ c (1 + x²/c²)``, an error of c takes away
        ``d δc/c``, one of B ``c δB/Z (1 + x²/c²)/(1 + u²)``. Pitch and roll do not act to first order there.
        """
        c, B = self.principal_distance, self.baseline
        inverse = 1.0 / np.asarray(distance, dtype=np.float64)
        d = self.disparity(distance)
        u2, x2 = (B * inverse / 2.0) ** 2, (d / (2.0 * c)) ** 2
        one, zero = np.ones_like(d), np.zeros_like(d)
        errors = self.calibration
        slopes: dict[str, tuple[ErrorSource, FloatArray]] = {
            "yaw": (errors.yaw, c * (1.0 + x2)),
            "pitch": (errors.pitch, zero),
            "roll": (errors.roll, zero),
            "baseline": (errors.baseline, c * inverse * (1.0 + x2) / (1.0 + u2)),
            "focal_length": (errors.focal_length, np.abs(d) / c),
            "principal_point": (errors.principal_point, one),
            "temperature": (
                ErrorSource(standard_deviation=self.expansion),
                B * c * inverse * (1.0 + x2) / (1.0 + u2),
            ),
        }
        noise = DepthErrorPart(
            name="pixel_noise",
            disparity_error=disparity_error_at(self, distance) * self.sensor.pixel_pitch,
            shape="normal",
            error_class="per measurement",
        )
        return (
            noise,
            *(
                DepthErrorPart(
                    name=name,
                    disparity_error=source.standard_deviation * slope,
                    shape=source.shape,
                    error_class="per rig",
                )
                for name, (source, slope) in slopes.items()
                if source.standard_deviation > 0.0
            ),
        )

    def depth_with_errors(self, distance: ArrayLike, errors: Mapping[str, ArrayLike]) -> FloatArray:
        """The depth [m] that the declared triangulation reports when calibration and pixels are off by ``errors``.

        Parameters
        ----------
        distance
            True distance [m].
        errors
            Named as the parts: ``pixel_noise`` [m of disparity], ``yaw``, ``pitch``, ``roll`` [rad], ``baseline``,
            ``focal_length``, ``principal_point`` [m]; what is missing is 0. They disturb the calibration with which a
            fixed picture is read.

        Returns
        -------
        FloatArray
            Exact, not linearised; +infinity where the lines of sight diverge or do not both look ahead.
        """
        known = {"pixel_noise", "yaw", "pitch", "roll", "baseline", "focal_length", "principal_point"}
        if unknown := set(errors) - known:
            raise OutOfRangeError(
                "a stereo rig has no such error", value=str(sorted(unknown)), limit=str(sorted(known))
            )
        e = {name: np.asarray(errors.get(name, 0.0), dtype=np.float64) for name in known}
        c, B, t = (
            self.principal_distance + e["focal_length"],
            self.baseline + e["baseline"],
            self.convergence_angle / 2.0,
        )
        x = self.disparity(distance) / 2.0
        shift = e["pixel_noise"] + e["principal_point"]
        left = _turned(x + shift / 2.0, c, yaw=-t)
        right = _turned(-(x + shift / 2.0), c, yaw=t)
        right = _rotate(right, yaw=e["yaw"], pitch=e["pitch"], roll=e["roll"])
        if self.triangulation == "midpoint":
            centre = np.stack(np.broadcast_arrays(B / 2.0, 0.0, 0.0), axis=-1)
            return midpoint_depth(left, right, -centre, centre)
        ahead = (left[..., 2] > 0.0) & (right[..., 2] > 0.0)
        slopes = [ray[..., 0] / np.where(ahead, ray[..., 2], 1.0) for ray in (left, right)]
        difference = slopes[0] - slopes[1]
        in_front = ahead & (difference > 0.0)
        return np.asarray(np.where(in_front, B / np.where(in_front, difference, 1.0), np.inf))

    def error_directions(self, distance: ArrayLike) -> Mapping[str, tuple[Mapping[str, ArrayLike], ...]]:
        """One standard deviation of each error, all independent."""
        noise = disparity_error_at(self, distance) * self.sensor.pixel_pitch
        deviations = {f.name: getattr(self.calibration, f.name).standard_deviation for f in fields(self.calibration)}
        expanded = {"temperature": ({"baseline": self.expansion * self.baseline},)} if self.expansion > 0.0 else {}
        return {
            "pixel_noise": ({"pixel_noise": noise},),
            **{name: ({name: deviation},) for name, deviation in deviations.items() if deviation > 0.0},
            **expanded,
        }

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the parallel rig of this principal distance that measures as well; B for parallel axes."""
        inverse = 1.0 / np.asarray(distance, dtype=np.float64)
        x2 = (self.disparity(distance) / (2.0 * self.principal_distance)) ** 2
        return np.asarray(self.baseline * (1.0 + x2) / (1.0 + (self.baseline * inverse / 2.0) ** 2))

    def overlap(self, distance: ArrayLike) -> FloatArray:
        """Share of each picture's width at a distance that the other camera sees too; ``1 − B/W`` for parallel axes.

        W = 2 Z tan(FOV/2). Zero where the views do not meet. Converging axes map a plane unevenly; the share is that of
        the picture, not of the plane.
        """
        z = np.asarray(distance, dtype=np.float64)
        half, t = self.field_of_view / 2.0, self.convergence_angle / 2.0

        def mirrored(edge: float) -> FloatArray:
            """Direction from the left camera to where the right camera's edge of view meets the plane."""
            if abs(edge) >= math.pi / 2.0:  # that edge never meets the plane: the view has no end on this side
                return np.full(z.shape, -math.copysign(math.pi / 2.0, edge))
            return np.arctan(self.baseline / z - math.tan(edge))

        if abs(t) - half >= math.pi / 2.0:
            return np.zeros_like(z)
        low = np.maximum(max(t - half, -math.pi / 2.0), mirrored(t + half))
        high = np.minimum(min(t + half, math.pi / 2.0), mirrored(t - half))
        # From directions to the picture, where a direction beyond the picture's own edges does not occur.
        shared = np.tan(np.clip(high - t, -half, half)) - np.tan(np.clip(low - t, -half, half))
        return np.asarray(np.clip(shared / (2.0 * math.tan(half)), 0.0, 1.0))

    def blur_px(self, distance: ArrayLike) -> FloatArray:
        """Diameter of the geometric blur circle [px]; 0 for lenses that refocus."""
        z = np.asarray(distance, dtype=np.float64)
        if self.focus_distance is None:
            return np.zeros_like(z)
        f, pupil = self.lens.focal_length, self.lens.pupil_diameter
        return blur_diameter(z, self.focus_distance, f, pupil) / self.sensor.pixel_pitch

    def limits(self, distance: ArrayLike, criteria: UsableCriteria) -> Mapping[str, Limit]:
        """Real image, overlap, focus and last disparity step, as far as the criteria ask for them."""
        z, f = np.asarray(distance, dtype=np.float64), self.lens.focal_length
        found = {"real_image": Limit(value=z, bound=f, met=self.images(z))}
        if criteria.overlap is not None:
            value = self.overlap(distance)
            found["overlap"] = Limit(value=value, bound=criteria.overlap, met=value >= criteria.overlap)
        if criteria.blur_px is not None:
            value = self.blur_px(distance)
            found["focus"] = Limit(value=value, bound=criteria.blur_px, met=value <= criteria.blur_px)
        if criteria.disparity_step_px is not None:
            value = (self.disparity(distance) - self.disparity_of_infinity(distance)) / self.sensor.pixel_pitch
            found["last_disparity_step"] = Limit(
                value=value, bound=criteria.disparity_step_px, met=value > criteria.disparity_step_px
            )
        return found


def _turned(x: ArrayLike, c: ArrayLike, *, yaw: float) -> FloatArray:
    """Direction of the ray through image point x, in the frame of the rig, of a camera turned about the vertical.

    The picture is mirrored by the lens; here it is upright, so that a point to the right has x > 0.
    """
    direction = np.stack(np.broadcast_arrays(np.asarray(x, dtype=np.float64), 0.0, c), axis=-1)
    return _rotate(direction, yaw=np.float64(yaw), pitch=np.float64(0.0), roll=np.float64(0.0))


def _rotate(direction: FloatArray, *, yaw: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> FloatArray:
    """Turn directions by roll about z, then pitch about x, then yaw about y; positive yaw turns z towards −x."""
    x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
    c, s = np.cos(roll), np.sin(roll)
    x, y = c * x - s * y, s * x + c * y
    c, s = np.cos(pitch), np.sin(pitch)
    y, z = c * y - s * z, s * y + c * z
    c, s = np.cos(yaw), np.sin(yaw)
    x, z = c * x - s * z, s * x + c * z
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
