"""The interface of cameras that measure depth, by which a study treats all of them alike."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.calibration import LINEAR, PERFECT, Calibration, Propagation
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.depth_measurement import (
    AGEING,
    SESSION_PARAMETERS,
    Environment,
    ErrorParameter,
    Errors,
    ErrorVocabulary,
    Field,
    FieldPosition,
    MeasuredInverseDepth,
    PicturePlace,
    shares_of,
)
from tradestudy.cameras.imported import ImportedRig
from tradestudy.cameras.parts import require_positive
from tradestudy.cameras.picture_geometry import PictureGeometry
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.uncertainty.sources import ErrorClass


@dataclass(frozen=True, kw_only=True)
class Formula:
    """An equation.

    Parameters
    ----------
    typst
        The equation in typst's mathematics.
    alt
        The equation as one would read it aloud.
    reference
        Publication; empty for equations derived in this program.
    """

    typst: str
    alt: str
    reference: str = ""


@dataclass(frozen=True, kw_only=True)
class Method:
    """The method of a kind of camera.

    Parameters
    ----------
    name
        Anchor of the report's section: short, in letters and hyphens.
    title
        Title of the section.
    statements
        Paragraphs, in the light markup of reports, and equations, in reading order.
    matching
        Paragraphs and equations on the pictures that are compared, where the disparity error is derived from them.
    baseline_note
        Why the equivalent baseline of such a camera can differ from the declared one; empty where it cannot.
    """

    name: str
    title: str
    statements: tuple[str | Formula, ...]
    matching: tuple[str | Formula, ...] = ()
    baseline_note: str = ""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """One condition of the usable range over distances: its value, the bound, and whether it holds."""

    value: FloatArray
    bound: float
    met: BoolArray


@dataclass(frozen=True, kw_only=True)
class UsableCriteria:
    """The bounds of the usable range that a study declares; None omits a condition.

    Parameters
    ----------
    overlap
        Smallest overlap of the two pictures of a stereo rig.
    availability
        Smallest availability: the fraction of points that the estimator's microlenses see.
    virtual_depth
        Smallest absolute virtual depth v; 2 at the total covering plane.
    blur_px
        Largest diameter of the geometric blur [lateral samples]; of several microlens types, that of the least sharp
        one that the estimator needs.
    disparity_step_px
        The disparity [px] by which the distance must at least differ from infinity.
    failed_fraction
        Largest fraction of measurements that end beyond infinity or are false matches.
    relative_uncertainty
        Largest depth uncertainty as a fraction of the distance.
    """

    overlap: float | None = None
    availability: float | None = None
    virtual_depth: float | None = None
    blur_px: float | None = None
    disparity_step_px: float | None = None
    failed_fraction: float | None = None
    relative_uncertainty: float | None = None


class DisparityErrorLaw(Protocol):
    """A disparity error derived from the picture that a camera takes at a distance.

    Every method takes the camera, so that a law stays valid when the camera is changed. ``field`` is the distance from
    the middle of the picture as a fraction of half its diagonal.
    """

    @property
    def false_matches(self) -> float:
        """Fraction of measurements that are false matches, which count as failed."""
        ...

    def error_px(self, camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Standard deviation of the disparity of one measurement [px] at distances [m]; NaN without a picture."""
        ...

    def numerical_error_px(self, camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Estimated numerical error of `error_px` [px]."""
        ...

    def limit(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Whether a matcher can reach the bound from which the error is derived, at distances [m]."""
        ...

    def margin(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:
        """Margin of the tightest condition of `limit`; negative where one is broken, NaN without a picture."""
        ...

    def broken_conditions(self, camera: DepthCamera, distance: float) -> tuple[str, ...]:
        """Conditions of `limit` that do not hold at a distance [m], in words."""

    def saturation(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Electrons in the brightest pixels as a fraction of the saturation capacity; must not exceed 1."""
        ...


DisparityError = float | DisparityErrorLaw


@dataclass(frozen=True, kw_only=True)
class DepthCamera(Camera):
    """A camera that measures depth by triangulation, described along its optical axis.

    Parameters
    ----------
    disparity_error_px
        Standard deviation of the disparity of one measurement [samples], as a number or as a law.
    discrimination_step_px
        The disparity step of the depth discrimination [samples].
    calibration
        The joint distribution of all other uncertain parameters.
    propagation
        How these are propagated to depth.

    Raises
    ------
    OutOfRangeError
        For an error or a step that is not positive.
    """

    method: ClassVar[Method]
    """How depth is measured from its pictures, for readers of a report."""
    error_vocabulary: ClassVar[ErrorVocabulary]
    """Every parameter of its exact model that can be in error, including `PIXEL_NOISE`."""
    known_parameters: ClassVar[tuple[str, ...]] = ()
    """Parameters of `error_vocabulary` whose values, not only their errors, a calibration may state."""
    pictured_by_microlenses: ClassVar[bool] = False
    """Whether microlenses blur the matched picture."""

    disparity_error_px: DisparityError
    discrimination_step_px: float
    calibration: Calibration = PERFECT
    propagation: Propagation = LINEAR

    def __post_init__(self) -> None:
        if isinstance(self.disparity_error_px, float | int):  # a law checks itself
            require_positive("disparity error", self.disparity_error_px, "px")
        require_positive("discrimination step", self.discrimination_step_px, "px")

    @property
    def calibrated_pair(self) -> CalibratedPair | None:
        """The calibrated pair that measures depth; None if the design does."""
        return None

    @property
    def right_pixels(self) -> tuple[int, int] | None:
        """Columns and rows of the right picture, if it has others than the left one."""
        return None

    def exported(self, fitted: CalibratedPair | None = None) -> ImportedRig | None:  # noqa: ARG002 - of a pair
        """The camera, or a fitted pair, in the form of calibration files; None if they cannot describe it."""
        return None

    @property
    def sample_pitch(self) -> float:
        """Distance [m] between neighbouring samples, the unit of disparities: the pixel pitch, unless overridden."""
        return self.sensor.pixel_pitch

    @abstractmethod
    def disparity(self, distance: ArrayLike) -> FloatArray:
        """The signed disparity that the estimator uses [m on the sensor]; it decreases with distance."""

    def disparity_of_infinity(self, distance: ArrayLike) -> FloatArray:
        """The disparity [m] of a point at infinity, with the estimator set up for a distance; by default, for any."""
        return np.broadcast_to(self.disparity(np.inf), np.shape(distance))

    @abstractmethod
    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:
        """The depth [m] that the estimator, set up for a true distance, computes from a disparity [m].

        It decreases with disparity; +infinity at and beyond the disparity of infinity.
        """

    @property
    def mapped(self) -> bool:
        """Whether results contain a map of its depth uncertainty over the picture."""
        return False

    @abstractmethod
    def field_angle(self, field: float) -> float:
        """Angle between the chief ray and the axis [rad], at a fraction of the way from the axis to the corner."""

    @abstractmethod
    def read(
        self, distance: FloatArray, field: Field, errors: Errors, environment: Environment | None = None
    ) -> MeasuredInverseDepth:
        """Inverse depths measured in changed surroundings when ``errors`` are the errors of the calibration.

        Parameters
        ----------
        distance
            True distances [m], shape (distances,).
        field
            Position of the point in the picture; see `Field`.
        errors
            Arrays of shape (draws, 1) by the names of `error_vocabulary` and `SESSION_PARAMETERS`; pixel noise may have
            shape (draws, distances).
        environment
            How the camera responds to its surroundings; None if it does not.

        Raises
        ------
        OutOfRangeError
            For an error that the camera does not have, or a position beyond the sensor.
        """

    @abstractmethod
    def observe_target(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, ...]:
        """Measurements [m on the sensor] of target points by a camera that deviates from its design by ``errors``.

        Returns one array for each component; inference stacks them along the last axis. The points x, y, z are in the
        camera's own frame [m].
        """

    @abstractmethod
    def target_noise_px(self, corner_noise_px: float) -> FloatArray:
        """Noise of each component of `observe_target` [px], for a given noise of one coordinate of a corner [px]."""

    @abstractmethod
    def seen_on_sensor(self, observed_px: FloatArray) -> BoolArray:
        """Whether each component of `observe_target` [px] lies on the sensor, shape (…, components)."""

    @abstractmethod
    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the parallel pair with the same focal length, disparity error and depth uncertainty."""

    def estimator_blur_px(self, distance: ArrayLike) -> FloatArray:
        """Geometric blur [samples] of the least sharp picture that the estimator needs."""
        return self.picture_geometry(distance).blur_px

    @abstractmethod
    def picture_geometry(self, distance: ArrayLike) -> PictureGeometry:
        """How the camera pictures objects at distances [m]: the quantities that blur, noise and window depend on."""

    @cached_property
    def as_pictured(self) -> Self:
        """The camera without calibration, propagation and disparity error, which do not affect its picture."""
        return replace(self, calibration=PERFECT, propagation=LINEAR, disparity_error_px=1.0)

    def cropped(self, columns: int, rows: int) -> Self:
        """The camera with only the middle of its sensor, so many pixels wide and high."""
        return replace(self, sensor=replace(self.sensor, columns=columns, rows=rows))

    def measured_depth(
        self, distance: FloatArray, field: Field, values: Mapping[str, FloatArray]
    ) -> MeasuredInverseDepth:
        """Inverse depths for draws of calibration and noise, by the exact model to which these belong."""
        measure = self.read if self.calibration.measurement is None else self.calibration.measurement
        return measure(distance, field, self.calibration.errors(values), self.calibration.environment)

    def parameter(self, name: str) -> ErrorParameter:
        """Unit, class and part of one drawn parameter."""
        vocabulary = self.error_vocabulary if self.calibration.vocabulary is None else self.calibration.vocabulary
        base = name.removeprefix(AGEING)
        parameter = vocabulary[base] if base in vocabulary else SESSION_PARAMETERS[base]
        return replace(parameter, part="ageing", error_class=ErrorClass.SESSION) if name != base else parameter

    def field_share(self, field: FieldPosition) -> float:
        """Distance of a position from the middle of the picture, as a fraction of half the diagonal."""
        if not isinstance(field, PicturePlace):
            return field
        half = np.array([self.sensor.columns, self.sensor.rows])
        return float(np.hypot(*(half * shares_of(field))) / np.hypot(*half))

    def noise(self, distance: ArrayLike, field: FieldPosition = 0.0) -> FloatArray:
        """Standard deviation of the disparity of one measurement [m on the sensor] at a field position."""
        return disparity_error_at(self, distance, field) * self.sample_pitch

    def modelled_distance(self, distance: ArrayLike) -> FloatArray:
        """Distance [m] at which the design images an object at a true distance [m]; the same unless calibrated."""
        return np.asarray(distance, dtype=np.float64)

    def images(self, distance: ArrayLike) -> BoolArray:
        """Whether an object lies beyond the front focal point, so that a real image of it is formed."""
        return np.asarray(self.modelled_distance(distance) > self.nearest_imaged)

    def disparity_px(self, distance: ArrayLike) -> FloatArray:
        """The signed disparity that the estimator uses [samples]."""
        return self.disparity(distance) / self.sample_pitch

    def depth_discrimination(self, distance: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Change of true depth [m] that changes the disparity by the declared step, towards and away from the camera.

        The estimator stays set up for the distance. The second value is infinite where the step reaches beyond the
        disparity of infinity.
        """
        a = np.asarray(distance, dtype=np.float64)
        d, step = self.disparity(a), self.discrimination_step_px * self.sample_pitch
        return a - self.depth_of_disparity(d + step, a), self.depth_of_disparity(d - step, a) - a

    def virtual_depth(self, distance: ArrayLike) -> FloatArray:
        """Virtual depth a_L/b_L behind microlenses; NaN for cameras without microlenses."""
        return np.full(np.shape(distance), np.nan)

    def limits(self, distance: ArrayLike, criteria: UsableCriteria) -> Mapping[str, Limit]:
        """The geometric conditions of the usable range that the criteria bound, at distances [m]."""
        a = np.asarray(distance, dtype=np.float64)
        imaged = self.modelled_distance(a)
        limits = {"real_image": Limit(value=imaged, bound=self.nearest_imaged, met=self.images(a))}
        limits |= self.limits_of_kind(a, criteria)
        if criteria.blur_px is not None:
            value = self.estimator_blur_px(a)
            limits["focus"] = Limit(value=value, bound=criteria.blur_px, met=value <= criteria.blur_px)
        if criteria.disparity_step_px is not None:
            value = (self.disparity(a) - self.disparity_of_infinity(a)) / self.sample_pitch
            limits["last_disparity_step"] = Limit(
                value=value, bound=criteria.disparity_step_px, met=value > criteria.disparity_step_px
            )
        return limits

    def limits_of_kind(self, distance: FloatArray, criteria: UsableCriteria) -> Mapping[str, Limit]:  # noqa: ARG002 - used only by kinds that have some
        """The conditions that only cameras of this kind have."""
        return {}


def disparity_error_at(camera: DepthCamera, distance: ArrayLike, field: FieldPosition = 0.0) -> FloatArray:
    """Standard deviation of the disparity of one measurement [px] at distances [m] and a field position."""
    error = camera.disparity_error_px
    if isinstance(error, float | int):
        return np.full(np.shape(distance), float(error))
    return error.error_px(camera, distance, camera.field_share(field))


def numerical_error_of_disparity_error(
    camera: DepthCamera, distance: ArrayLike, field: FieldPosition = 0.0
) -> FloatArray:
    """Estimated numerical error of `disparity_error_at` [px]: 0 for a declared error."""
    error = camera.disparity_error_px
    if isinstance(error, float | int):
        return np.zeros(np.shape(distance))
    return error.numerical_error_px(camera, distance, camera.field_share(field))


def false_match_share(camera: DepthCamera, error_source: str = "both") -> float:
    """Fraction of all measurements that are false matches; 0 for a declared disparity error, which excludes them.

    0 for calibration errors alone, which cause no false matches.
    """
    error = camera.disparity_error_px
    return 0.0 if isinstance(error, float | int) or error_source == "calibration" else error.false_matches


def declared_disparity_error(camera: DepthCamera) -> float:
    """The declared disparity error [px] of a camera, for equations in which it cannot depend on distance.

    Raises
    ------
    OutOfRangeError
        If the error is derived from the picture.
    """
    error = camera.disparity_error_px
    if isinstance(error, float | int):
        return float(error)
    raise OutOfRangeError(
        "the disparity error of this camera is derived from its picture and depends on distance",
        remedy="declare disparity_error in pixels",
    )
