"""A stereo rig of two cameras side by side, equal or calibrated as unequal, with parallel or converging axes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, ClassVar, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.camera import Contradiction, DerivedValue, Properties, lens_contradictions
from tradestudy.cameras.depth_camera import DepthCamera, Formula, Limit, Method, UsableCriteria
from tradestudy.cameras.depth_measurement import (
    PIXEL_NOISE,
    Environment,
    Errors,
    ErrorVocabulary,
    Field,
    MeasuredInverseDepth,
    require_field,
    require_known,
    shares_of,
    value_of,
    warmed,
)
from tradestudy.cameras.focus import EveryObjectFocus, SingleLensFocus, require_focus, require_refocusing
from tradestudy.cameras.imported import ImportedRig
from tradestudy.cameras.parts import Lens, Sensor, require_positive
from tradestudy.cameras.picture_geometry import PictureGeometry
from tradestudy.cameras.single_lens import (
    PictureEdges,
    SingleLensExposure,
    edge_angle,
    picture_through_lens,
    place_across,
    properties_of_lens,
    scale_across,
)
from tradestudy.cameras.stereo.contradictions import focus_contradictions, nearest_contradictions
from tradestudy.cameras.stereo.pair import (
    SIDES,
    STEREO_ERRORS,
    Image,
    Pair,
    pair_inverse_depth,
    pair_observation,
    relative_focal_lengths,
    rig_of_calibration,
    rig_of_design,
    shared_view,
    views_of_calibration,
    views_of_design,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.lens_model import IDEAL, LensModel, slopes
from tradestudy.optics.thin_lens import blur_diameter, image_distance
from tradestudy.optics.triangulation import depth_of_inverse, stereo_depth, stereo_disparity
from tradestudy.units import ANGLE, LENGTH, significant

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart


METHOD: Final = Method(
    name="stereo",
    title="Depth from a stereo rig",
    statements=(
        "Two cameras of principal distance *c*, a baseline *B* apart, see a point at distance *Z* with disparity "
        "*d*. A yaw ψ between them changes the disparity by about *c* (1 + *x*²/*c*²) ψ where the point appears a "
        "distance *x* from the middle of the picture.",
        Formula(
            typst="Z = (c B) / d, quad delta Z approx Z^2 / (c B) thin delta d, quad "
            "delta Z approx Z^2 / B (1 + x^2 / c^2) psi",
            alt="Z equals c times B over d. The change of Z is about Z squared over c B times the change of d. A yaw "
            "psi changes Z by about Z squared over B, times one plus x squared over c squared, times psi.",
        ),
        "The last two are linear approximations, which show how the errors scale. The numbers come from the exact "
        "expression, in which depth becomes infinite where the yaw cancels the disparity: on the axis, at *Z* = "
        "*B*/|ψ|. The overlap of the two fields of view limits how near the rig can measure; for parallel axes the "
        "overlap is 1 − *B*/*W*, where *W* = 2 *Z* tan(FOV/2) is the width of each field of view at the distance *Z*.",
        "The principal distance *c* is the distance from the lens to the sensor. By default it equals the focal length "
        "*f*, which is right if *f* comes from a camera calibration that gives the focal length in pixels, and thus "
        "the principal distance. If the study declares `principal_distance: focused`, it is "
        "*f* *a*/(*a*\u00a0−\u00a0*f*), the image distance of a thin lens focused at *a*, and exceeds *f* by the "
        "fraction *f*/(*a*\u00a0−\u00a0*f*).",
    ),
    baseline_note="The reference rig has parallel axes. A rig with converging axes and baseline *B* measures as well "
    "as a parallel one with baseline *B* (1 + *x*²/*c*²)/(1 + *B*²/4*Z*²), where *x* is half the disparity. Where "
    "the axes meet, *x* = 0, this is less than *B*, because the lines of sight are longer than the distance *Z*.",
)


_STEP_PX = 1e-3  # of a numerical derivative by disparity, which is nearly constant over some pixels
PrincipalDistanceRule = Literal["focal_length", "focused"]


@dataclass(frozen=True, kw_only=True)
class StereoRig(DepthCamera):
    """Two cameras at the ends of a baseline.

    Parameters
    ----------
    lens, sensor
        The lens and the sensor of each camera.
    focus_distance
        Distance in focus [m]; infinity is allowed; None if the lenses refocus on every object. As all distances, it
        counts from the centres of projection, the entrance pupils.
    principal_distance_rule
        Distance of the sensor behind the centre of projection. ``focal_length``: the focal length, exact for lenses
        focused at infinity and for a focal length from a calibration in pixels. ``focused``:
        ``c = f Z₀/(Z₀ − F)`` for the focus distance Z₀, with F = f for a thin lens; the lens moves as a whole.
    baseline
        Distance B between the two centres of projection [m].
    convergence_angle
        Angle between the optical axes [rad]; 0: parallel; positive: they meet in front.
    triangulation
        ``disparity`` measures along the baseline in rectified pictures; ``midpoint`` takes the middle of the shortest
        segment between the two lines of sight. They agree unless the rays are skew.
    distortion
        Lens model of both cameras, in normalised image coordinates.
    disparity_error_px
        Standard deviation of one measured disparity [px], or the law that gives it.
    discrimination_step_px
        The disparity step [px] of the depth discrimination.
    disparity_range_px
        The largest disparity [px] that the matcher searches; None for no limit.
    calibrated_pair
        Calibrated geometry with which depth is measured, if known. Its pictures have this geometry too, or that of the
        calibration. Unless the cameras are `unequal`, focus, blur and light are those of two equal ones.
    right_sensor
        The sensor of the right camera of a calibrated pair, if it is another than that of the left one.

    Raises
    ------
    OutOfRangeError
        A length is not positive, the focus distance is within the focal length or so close to it that the lenses would
        magnify more than a thousand times, the axes converge by 180° or more, or the principal distance of lenses that
        refocus on every object is ``focused``.
    """

    family: ClassVar[str] = "stereo"
    lens_count: ClassVar[int] = 2
    error_vocabulary: ClassVar[ErrorVocabulary] = STEREO_ERRORS
    corners_calibrate: ClassVar[bool] = True
    method: ClassVar[Method] = METHOD

    lens: Lens
    focus_distance: float | None
    principal_distance_rule: PrincipalDistanceRule = "focal_length"
    baseline: float
    convergence_angle: float
    triangulation: Literal["disparity", "midpoint"]
    distortion: LensModel = IDEAL
    calibrated_pair: CalibratedPair | None = None
    disparity_range_px: float | None = None
    right_sensor: Sensor | None = None

    def __post_init__(self) -> None:
        require_positive("baseline", self.baseline)
        if self.disparity_range_px is not None:
            require_positive("disparity range", self.disparity_range_px, "px")
        super().__post_init__()
        if not abs(self.convergence_angle) < math.pi:
            raise OutOfRangeError(
                "convergence of the stereo axes",
                value=f"{math.degrees(self.convergence_angle):g}°",
                limit="below 180°",
            )
        if self.focus_distance is None:
            require_refocusing(self.lens)
        else:
            require_focus(self.focus_distance, self.lens, "lenses")
        if self.principal_distance_rule == "focused" and self.focus_distance is None:
            raise OutOfRangeError(
                "the principal distance of lenses that refocus on every object",
                value="focused",
                limit="focal_length, because every focus setting needs its own calibration",
                remedy="give a focus distance, or use the focal length as the principal distance",
            )

    @property
    def principal_distance(self) -> float:
        """Distance c from the centre of projection to the sensor [m], by the declared rule."""
        if self.principal_distance_rule == "focal_length" or self.focus_distance is None:
            return self.lens.focal_length
        return self.lens.principal_distance(self.sensor_distance(self.focus_distance))

    def sensor_distance(self, focus_distance: float) -> float:
        """Distance from the second principal plane to the sensor [m] for lenses focused at a distance [m].

        It is ``f a/(a − f)``, with a the distance from the first principal plane.
        """
        return float(image_distance(focus_distance - self.principal_plane, self.lens.focal_length))

    @property
    def sensors(self) -> tuple[Sensor, Sensor]:
        """The sensors of the left and the right camera."""
        return self.sensor, self.right_sensor or self.sensor

    @property
    def pixel_count(self) -> int:
        """Number of pixels of both cameras."""
        return sum(sensor.columns * sensor.rows for sensor in self.sensors)

    @property
    def right_pixels(self) -> tuple[int, int] | None:
        """Columns and rows of the right picture, if it has others than the left one."""
        return None if self.right_sensor is None else (self.right_sensor.columns, self.right_sensor.rows)

    @cached_property
    def unequal(self) -> tuple[tuple[Lens, Sensor], ...]:
        """Lens and sensor of the left and the right camera of an unequal pair; empty for others."""
        pair = self.measured_pair
        if pair is None or (self.right_sensor is None and not pair.is_unequal):
            return ()
        return tuple(
            (replace(self.lens, focal_length=self.lens.focal_length * relative), sensor)
            for relative, sensor in zip(relative_focal_lengths(pair, self.sensors), self.sensors, strict=True)
        )

    @property
    def coarser(self) -> tuple[Lens, Sensor]:
        """Lens and sensor of the camera with the wider pixels in angle, which limits what both can match."""
        return min(self.unequal, key=lambda own: own[0].focal_length / own[1].pixel_pitch, default=self._design)

    @property
    def _blurred_most(self) -> tuple[Lens, Sensor]:
        """Lens and sensor of the camera with the larger blur [px], which grows as f²/(N p)."""
        return max(self.unequal, key=lambda own: own[0].focal_length ** 2 / own[1].pixel_pitch, default=self._design)

    @property
    def _design(self) -> tuple[Lens, Sensor]:
        return self.lens, self.sensor

    @property
    def focus(self) -> SingleLensFocus | EveryObjectFocus:
        """The focus of one of two equal lenses, or of that with more blur, whose depth of field is that of the rig."""
        lens, sensor = self._blurred_most
        if self.focus_distance is None:
            return EveryObjectFocus(lens=lens, sample_pitch=sensor.pixel_pitch, mechanisms=2)
        return SingleLensFocus(
            lens=lens.thin(self.focus_distance),
            focus_distance=self.focus_distance,
            sample_pitch=sensor.pixel_pitch,
            name="both lenses",
        )

    @property
    def field_of_view(self) -> float:
        """Horizontal field of view of one camera as focused [rad]."""
        return self._edges.fields_of_view[0]

    def edge_angles(self, nearest: float) -> tuple[float, float, float, float]:  # noqa: ARG002 - c stays the same
        """By the lens model, with the principal distance or the own intrinsics of a calibrated pair's left camera."""
        return self._edges.angles

    @property
    def _edges(self) -> PictureEdges:
        """The edges of the left camera's picture."""
        pair, sensor = self.measured_pair, self.sensor
        if pair is None:
            return PictureEdges.of(self.distortion, sensor, (self.principal_distance,) * 2)
        left = pair.cameras[0]
        return PictureEdges.of(left.lens, sensor, *left.on_sensor(sensor))

    @property
    def mapped(self) -> bool:
        """Whether distortion or calibration make depth vary over the picture more than the field angle alone does."""
        return self.distortion != IDEAL or self.calibration.measurement is not None

    @property
    def gathering_lens(self) -> Lens:
        """One of the two equal lenses."""
        return self.lens

    @property
    def separation(self) -> float:
        """The baseline [m]."""
        return self.baseline

    def depth_behind_lens(self, nearest: float) -> float:
        """Distance from the second principal plane to the sensor [m], focused as declared.

        Lenses that refocus are focused on the nearest distance.
        """
        return self.sensor_distance(nearest if self.focus_distance is None else self.focus_distance)

    @property
    def pair(self) -> Pair:
        """The geometry from which both observation and triangulation follow."""
        return Pair(
            baseline=self.baseline,
            principal_distance=self.principal_distance,
            convergence_angle=self.convergence_angle,
            triangulation=self.triangulation,
            distortion=self.distortion,
        )

    @property
    def measured_pair(self) -> CalibratedPair | None:
        """The calibrated pair that takes the pictures and measures depth; None if the design does."""
        measurement = self.calibration.measurement
        return self.calibrated_pair if measurement is None else measurement.pair

    def exported(self, fitted: CalibratedPair | None = None) -> ImportedRig:
        """The fitted pair, else the calibrated one, else that of the design."""
        pair = self.measured_pair if fitted is None else fitted
        if pair is not None:
            return rig_of_calibration(pair, (self.sensor.columns, self.sensor.rows), self.right_pixels)
        return rig_of_design(self.pair, self.sensor)

    def disparity(self, distance: ArrayLike) -> FloatArray:
        """The disparity on the sensor [m]; without distortion, that of `stereo_disparity`.

        That of a calibrated pair follows from its own intrinsics and pose; see `CalibratedMeasurement`.
        """
        if (calibrated := self.calibration.measurement) is not None:
            z = np.asarray(distance, dtype=np.float64)
            return calibrated.disparity_px(z.ravel()).reshape(z.shape) * self.sensor.pixel_pitch
        left, right = self._seen_midway(distance)
        return np.asarray(left[..., 0] - right[..., 0])

    def _seen_midway(self, distance: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Images in both pictures [m], shape (..., 2), of a point midway between the cameras."""
        slope = stereo_disparity(distance, self.baseline, 1.0, convergence_angle=self.convergence_angle) / 2.0
        angle = np.arctan(slope)
        left, right = self.principal_distance * place_across(self.distortion, np.stack([angle, -angle]))
        return left, right

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:
        """``Z = c B / d`` [m] or its converging counterpart; see `stereo_depth`.

        For lenses with distortion, and for a calibrated pair, each picture has half of the disparity's deviation from
        that at the true distance.
        """
        if self.calibration.measurement is not None:
            return depth_of_inverse(self._inverse_of_calibrated(disparity, distance))
        c, d = self.principal_distance, np.asarray(disparity, dtype=np.float64)
        left, right = self._seen_midway(distance)
        half = (d - (left - right)[..., 0]) / 2.0
        tangents = []
        for place, moved in ((left, half), (right, -half)):
            x, _, z = self.distortion.ray((place[..., 0] + moved) / c, place[..., 1] / c)
            tangents.append(np.where(z > 0.0, x / z, np.nan))
        return stereo_depth(tangents[0] - tangents[1], self.baseline, 1.0, convergence_angle=self.convergence_angle)

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the equally precise parallel rig with this principal distance c; B for parallel axes.

        For a calibrated pair, ``1/(c ∂(1/Z)/∂d)`` by a central difference over 0.002 px.
        """
        if self.calibration.measurement is not None:
            step, seen = _STEP_PX * self.sensor.pixel_pitch, self.disparity(distance)
            nearer, farther = (self._inverse_of_calibrated(seen + sign * step, distance) for sign in (1.0, -1.0))
            return np.asarray(2.0 * step / (nearer - farther) / self.principal_distance)
        inverse = 1.0 / np.asarray(distance, dtype=np.float64)
        x = stereo_disparity(distance, self.baseline, 1.0, convergence_angle=self.convergence_angle) / 2.0
        scale = (scale_across(self.distortion, x) + scale_across(self.distortion, -x)) / 2.0
        return np.asarray(self.baseline * scale * (1.0 + x * x) / (1.0 + (self.baseline * inverse / 2.0) ** 2))

    def _inverse_of_calibrated(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:
        """The inverse depth [1/m] that a calibrated pair computes from a disparity [m] near that of a distance [m]."""
        assert self.calibration.measurement is not None  # callers ensure it
        z, moved = np.broadcast_arrays(
            np.asarray(distance, dtype=np.float64), np.asarray(disparity) - self.disparity(distance)
        )
        measured = self.calibration.measurement(z.ravel(), 0.0, {PIXEL_NOISE: moved.reshape(1, -1)}, None)
        return np.where(measured.no_overlap | measured.out_of_range, np.nan, measured.inverse_depth).reshape(z.shape)

    def overlap(self, distance: ArrayLike) -> FloatArray:
        """Share of each picture's width at a distance that the other camera also sees; see `shared_view`.

        If the calibration has its own geometry, it is the share of the picture's area instead.
        """
        if (calibrated := self.calibration.measurement) is not None:
            z = np.asarray(distance, dtype=np.float64)
            return calibrated.shared_area(z.ravel()).reshape(z.shape)
        half = self.sensor.width / 2.0 / self.principal_distance
        return shared_view(distance, self.baseline, half, self.convergence_angle, self.distortion)

    def estimator_blur_px(self, distance: ArrayLike) -> FloatArray:
        """Diameter of the geometric blur circle [px], the larger of both cameras; 0 for lenses that refocus."""
        z = np.asarray(distance, dtype=np.float64)
        if self.focus_distance is None:
            return np.zeros_like(z)
        lens, sensor = self._blurred_most
        f, pupil = lens.thin(self.focus_distance).focal_length, lens.pupil_diameter
        return blur_diameter(z, self.focus_distance, f, pupil) / sensor.pixel_pitch

    def limits_of_kind(self, distance: FloatArray, criteria: UsableCriteria) -> Mapping[str, Limit]:
        """Overlap of the two views, without which there is no depth; it must contain the middle axis of the rig."""
        value, bound = self.overlap(distance), criteria.overlap or 0.0
        met = (value >= bound) & (value > 0.0)
        if self.calibration.measurement is not None:  # of equal parallel cameras, both see the axis if views overlap
            means = {name: np.full((1, 1), mean) for name, mean in self.calibration.means.items()}
            met &= ~self.measured_depth(distance.ravel(), 0.0, means).no_overlap.reshape(distance.shape)
        limits = {"overlap": Limit(value=value, bound=bound, met=met)}
        if (largest := self.disparity_range_px) is not None:
            disparity = (self.disparity(distance) - self.disparity_of_infinity(distance)) / self.sample_pitch
            limits["disparity_range"] = Limit(value=disparity, bound=largest, met=disparity <= largest)
        return limits

    def picture_geometry(self, distance: ArrayLike) -> PictureGeometry:
        """The picture through one lens, equal for both or the coarser; the window may be as large as the sensor."""
        a = np.asarray(distance, dtype=np.float64)
        a = np.where(self.images(a), a, np.nan)
        focus = a if self.focus_distance is None else np.full_like(a, self.focus_distance)
        return picture_through_lens(a, *self.coarser, focus)

    def observe(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Image:
        """Image of a point in a rig that deviates from its design by ``errors``; see `pair_observation`."""
        return pair_observation(self.pair, errors, x, y, z)

    def field_angle(self, field: float) -> float:
        """Field angle seen from midway between the cameras; in each camera it differs by half the convergence angle."""
        require_field(field)
        twice = 2.0 * self.principal_distance
        return edge_angle(self.distortion, field * self.sensor.width / twice, field * self.sensor.height / twice)

    def read(
        self, distance: FloatArray, field: Field, errors: Errors, environment: Environment | None = None
    ) -> MeasuredInverseDepth:
        """Inverse depths of points at field positions as seen from midway between the cameras; see `DepthCamera.read`.

        The principal distance expands with the housing, the baseline with its own part and the pixels with the sensor.
        Pressure, colour and the thermal drift of a thin lens move its focus, but not its principal distance, and
        therefore do not change disparity.
        """
        require_known(errors, STEREO_ERRORS, "a stereo rig")
        z = np.asarray(distance, dtype=np.float64)
        changed = self._changed(errors, environment)
        if environment is not None and changed:
            image, seen = self._imaged(changed, z, field, environment.scale_factor(errors))
        else:
            image, seen = _imaged(self, z.tobytes(), z.shape, field)
        inverse, valid = pair_inverse_depth(self.pair, errors, image)
        return MeasuredInverseDepth(inverse_depth=inverse, no_overlap=~seen, out_of_range=~valid)

    def _imaged(
        self, changed: Errors, distance: FloatArray, field: Field, scale: FloatArray | float = 1.0
    ) -> tuple[Image, BoolArray]:
        """Images of points, placed as seen from midway between the cameras, and whether they lie on both sensors.

        ``scale`` is the factor by which pixels have grown; images are in pixels of the calibration.
        """
        x, y = shares_of(field)
        c, sensor = self.principal_distance, self.sensor
        right, down = slopes(*self.distortion.ray(x * sensor.width / 2.0 / c, y * sensor.height / 2.0 / c))
        left, left_down, on_right, right_down = self.observe(changed, right * distance, down * distance, distance)
        image = left / scale, left_down / scale, on_right / scale, right_down / scale
        left_x, left_y, right_x, right_y = (
            np.abs(place) <= extent / 2.0
            for place, extent in zip(image, (sensor.width, sensor.height) * 2, strict=True)
        )
        return image, left_x & left_y & right_x & right_y

    def _changed(self, errors: Errors, environment: Environment | None) -> dict[str, ArrayLike]:
        """Changes since the calibration due to the surroundings, as errors."""
        if environment is None or "temperature_change" not in errors:
            return {}
        return {
            "baseline": self.baseline * (environment.baseline_factor(errors) - 1.0),
            "focal_length": self.principal_distance * (environment.housing_factor(errors) - 1.0),
        }

    def exposures(
        self, reference_distance: float, errors: Errors, environment: Environment | None, stop_separation: float
    ) -> Sequence[SingleLensExposure]:
        """Both pictures, as calibrated or designed; lenses that refocus are focused at the reference distance.

        Raises
        ------
        OutOfRangeError
            For an error that the rig does not have, or any error of a calibrated pair, whose parameters are others.
        """
        require_known(errors, STEREO_ERRORS, "a stereo rig")
        if (pair := self.measured_pair) is not None:
            if errors:
                raise OutOfRangeError(
                    "pictures of a calibrated pair with errors of a designed one",
                    value=", ".join(errors),
                    limit="none",
                    remedy="render it as designed",
                )
            views = views_of_calibration(pair, self.sensors)
        else:
            changed = self._changed(errors, environment)
            moved = {name: value_of(errors, name) + value_of(changed, name) for name in {**errors, **changed}}
            views = views_of_design(self.pair, moved)
        return [
            SingleLensExposure(
                name=side,
                sensor=warmed(sensor, errors, environment),
                lens=replace(self.lens, focal_length=self.lens.focal_length * view.relative_focal_length),
                focus_distance=self.focus_distance or reference_distance,
                pose=view.pose,
                principal_distances=view.principal_distances,
                principal_point=view.principal_point,
                distortion=view.distortion,
                stop_separation=stop_separation,
            )
            for side, sensor, view in zip(SIDES, self.sensors, views, strict=True)
        ]

    def observe_target(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, ...]:
        """Both coordinates of a corner in both pictures."""
        return self.observe(errors, x, y, z)

    def target_noise_px(self, corner_noise_px: float) -> FloatArray:
        """The same noise for all coordinates."""
        return np.full(4, corner_noise_px)

    def seen_on_sensor(self, observed_px: FloatArray) -> BoolArray:
        """Whether each corner lies on the sensor, for both of its coordinates alike."""
        half = np.array([self.sensor.columns, self.sensor.rows] * 2) / 2.0
        inside = np.abs(observed_px) <= half
        in_pictures = np.stack([np.all(inside[..., :2], axis=-1), np.all(inside[..., 2:], axis=-1)], axis=-1)
        return np.repeat(in_pictures, 2, axis=-1)

    def properties(self) -> Properties:
        """Lens, sensor and baseline; the principal distance and the thin-lens image distance."""
        focus, lens, pair = self.focus_distance, self.lens, self.calibrated_pair
        lenses = [(self.distortion, "lens model")]
        if pair is not None:
            lenses = [(model, f"{side} lens model") for model, side in zip(pair.lenses, SIDES, strict=True)]
        return (
            ("focal length", DerivedValue(lens.focal_length, LENGTH)),
            ("principal distance", DerivedValue(self.principal_distance, LENGTH)),
            (
                "thin-lens image distance at the declared focus",
                "varies with focus" if focus is None else DerivedValue(self.sensor_distance(focus), LENGTH),
            ),
            ("pupil diameter", DerivedValue(lens.pupil_diameter, LENGTH)),
            ("horizontal field of view, from the principal distance", DerivedValue(self.field_of_view, ANGLE)),
            (
                "diagonal field of view, from the principal distance",
                DerivedValue(self._edges.fields_of_view[1], ANGLE),
            ),
            ("baseline", DerivedValue(self.baseline, LENGTH)),
            *self._rows_of_unequal(),
            *(row for lens, what in lenses for row in properties_of_lens(lens, what)),
            *self.lens_places(),
        )

    def _rows_of_unequal(self) -> Properties:
        rows: list[tuple[str, str]] = []
        for side, (lens, sensor) in zip(SIDES, self.unequal, strict=False):
            focal_length = f"{significant(lens.focal_length / sensor.pixel_pitch, 4)} px"
            rows.append((f"{side} camera", f"{sensor.columns} × {sensor.rows} px, focal length {focal_length}"))
        return tuple(rows)

    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:
        """Contradictions of the lens, and between a principal distance of f and the image distance of the focus.

        The two differ by the magnification ``f/(a − f)`` of the focus distance a, and so do disparity and its noise.
        """
        contradictions = lens_contradictions(self.lens, self.sensor, stated, self._edges.fields_of_view, "lenses")
        if stated is not None and stated.nearest_distance is not None and self.disparity_range_px is not None:
            contradictions += nearest_contradictions(
                stated.nearest_distance, self.nearest_distance, self.disparity_range_px
            )
        focus = self.focus_distance
        if self.principal_distance_rule != "focal_length" or focus is None or math.isinf(focus):
            return contradictions
        if self.calibrated_pair is not None:
            return contradictions  # the calibration gives the principal distance itself
        focused = self.lens.principal_distance(self.sensor_distance(focus))
        return contradictions + focus_contradictions(self.lens.focal_length, focused, focus, tolerance)

    @property
    def one_pixel_distance(self) -> float:
        """Distance ``c B/p`` [m] at which the disparity of parallel cameras is one pixel p; NaN for other axes."""
        return math.nan if self.convergence_angle else self.baseline * self.principal_distance / self.sensor.pixel_pitch

    @property
    def nearest_distance(self) -> float:
        """Nearest distance ``c B/d`` [m] of parallel cameras whose matcher searches disparities up to d.

        It is NaN for other axes, or if no limit of the search is declared.
        """
        return self.one_pixel_distance / (self.disparity_range_px or math.nan)


@lru_cache(maxsize=8)
def _imaged(rig: StereoRig, distances: bytes, shape: tuple[int, ...], field: Field) -> tuple[Image, BoolArray]:
    """The images of an unchanged rig, from which depth is computed many times with different calibration errors."""
    return rig._imaged({}, np.frombuffer(distances).reshape(shape), field)
