"""What every camera that measures depth can tell, so that a study treats all of them alike."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.calibration import LINEAR, PERFECT, Calibration, Propagation
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.environment import Environment
from tradestudy.cameras.error_vocabulary import AGEING, SESSION_PARAMETERS, ErrorParameter, ErrorVocabulary
from tradestudy.cameras.imported import ImportedRig
from tradestudy.cameras.method import Method
from tradestudy.cameras.parts import require_positive
from tradestudy.cameras.picture_geometry import PictureGeometry
from tradestudy.cameras.reading import Errors, InverseDepthReading
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.uncertainty.error_class import ErrorClass


@dataclass(frozen=True, kw_only=True)
class Limit:
    """One condition of the usable range over distances: its value, the bound, and whether it holds."""

    value: FloatArray
    bound: float
    met: BoolArray


@dataclass(frozen=True, kw_only=True)
class UsableCriteria:
    """The bounds of the usable range that a study declares; None leaves a condition out.

    Parameters
    ----------
    overlap
        Least share of each stereo image that the other sees too.
    availability
        Least share of points for which the estimator's microlenses exist.
    virtual_depth
        Least the absolute v: 2 is the total covering plane.
    blur_px
        Largest blur on the sensor [px], of the sharpest microlens type or of the stereo lenses.
    disparity_step_px
        The disparity step [px] that must still separate the distance from infinity.
    failed_fraction
        Largest share of measurements that end beyond infinity or are false matches.
    relative_uncertainty
        Largest depth uncertainty over distance.
    """

    overlap: float | None = None
    availability: float | None = None
    virtual_depth: float | None = None
    blur_px: float | None = None
    disparity_step_px: float | None = None
    failed_fraction: float | None = None
    relative_uncertainty: float | None = None


class DisparityErrorLaw(Protocol):
    """A disparity error that follows from the picture that a camera takes at a distance.

    It is given the camera with every question, so that it stays true when the camera is changed. Places in the field
    are as of `DepthCamera.read`.
    """

    @property
    def false_matches(self) -> float:
        """Share of all measurements that are false and count as failed."""
        ...

    def error_px(self, camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Standard deviation of the disparity of one measurement [px] at distances [m]; NaN without a picture."""
        ...

    def numerical_error_px(self, camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Estimated numerical error of `error_px` [px]."""
        ...

    def limit(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Where a matcher can reach the bound that it follows from."""
        ...

    def margin(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:
        """By how much the nearest condition of `limit` holds; negative where one is broken, NaN without a picture."""
        ...

    def broken_conditions(self, camera: DepthCamera, distance: float) -> tuple[str, ...]:
        """Conditions of `limit` that do not hold at a distance [m], in words."""

    def saturation(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Electrons of the brightest pixels over what a pixel holds: at most 1."""
        ...


DisparityError = float | DisparityErrorLaw


@dataclass(frozen=True, kw_only=True)
class DepthCamera(Camera):
    """A camera that measures depth by triangulation, described along its optical axis.

    Parameters
    ----------
    disparity_error_px
        Standard deviation of the disparity of one measurement [samples], the same everywhere or by a law.
    discrimination_step_px
        The disparity step of the depth discrimination [samples].
    calibration
        The joint distribution of everything else that is uncertain about it.
    propagation
        How that is propagated to depth.

    Raises
    ------
    OutOfRangeError
        For an error or a step that is not positive.
    """

    method: ClassVar[Method]
    """How depth follows from its pictures, for readers of a report."""
    error_vocabulary: ClassVar[ErrorVocabulary]
    """Every parameter of its exact model that can be in error, `PIXEL_NOISE` among them."""
    pictured_by_microlenses: ClassVar[bool] = False
    """Whether microlenses blur the picture that is matched."""

    disparity_error_px: DisparityError
    discrimination_step_px: float
    calibration: Calibration = PERFECT
    propagation: Propagation = LINEAR

    def __post_init__(self) -> None:
        require_disparity_error(self.disparity_error_px)
        require_positive("discrimination step", self.discrimination_step_px, "px")

    @property
    def calibrated_pair(self) -> CalibratedPair | None:
        """The calibrated pair that depth is read with; None: the design."""
        return None

    def exported(self, fitted: CalibratedPair | None = None) -> ImportedRig | None:  # noqa: ARG002 - of a pair
        """The camera as calibration files state cameras, or what a fit found of it; None where they have no form."""
        return None

    @property
    def sample_pitch(self) -> float:
        """Distance of neighbouring samples that disparities count in [m]: the pixel pitch unless the kind differs."""
        return self.sensor.pixel_pitch

    @abstractmethod
    def disparity(self, distance: ArrayLike) -> FloatArray:
        """The disparity that the estimator uses [m on the sensor], signed; it falls with distance."""

    @abstractmethod
    def disparity_of_infinity(self, distance: ArrayLike) -> FloatArray:
        """What the disparity [m] of the estimator, as it is set up at a distance, would be for a point at infinity."""

    @abstractmethod
    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:
        """The depth [m] that the estimator, as it is set up at a true distance, reads from a disparity [m].

        It falls with disparity; +infinity at and beyond the disparity of infinity.
        """

    @property
    def mapped(self) -> bool:
        """Whether depth uncertainty is mapped over the picture: `read` then takes `PicturePlaces` too."""
        return False

    @abstractmethod
    def field_angle(self, field: float) -> float:
        """Of the chief ray against the axis [rad], at a place in the field as of `read`."""

    @abstractmethod
    def read(
        self, distance: FloatArray, field: float, errors: Errors, environment: Environment | None = None
    ) -> InverseDepthReading:
        """Inverse depths read in changed surroundings with a calibration that is off by ``errors``.

        Parameters
        ----------
        distance
            True distances [m], shape (distances,).
        field
            Where the point lies: 0 on the axis, 1 in the corner of the sensor.
        errors
            By the names of `error_vocabulary` and `SESSION_PARAMETERS`, arrays of shape (draws, 1); the pixel noise
            may be (draws, distances).
        environment
            How the camera, as designed at calibration, answers to its surroundings; None: not at all.

        Raises
        ------
        OutOfRangeError
            For an error that the camera does not have, or a place beyond the sensor.
        """

    @abstractmethod
    def observe_target(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, ...]:
        """What a camera that deviates from its design by ``errors`` measures of points of a target [m on the sensor].

        The components come last in what inference takes of them; x, y, z as of the camera's own frame [m].
        """

    @abstractmethod
    def target_noise_px(self, corner_noise_px: float) -> FloatArray:
        """Noise of each component of `observe_target`, where one coordinate of a corner has the given one."""

    @abstractmethod
    def seen_on_sensor(self, observed_px: FloatArray) -> BoolArray:
        """Which components of `observe_target` [px] lie on the sensor, in the same shape (…, components)."""

    @abstractmethod
    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the parallel pair of the same focal length and disparity error that measures as well."""

    @abstractmethod
    def estimator_blur_px(self, distance: FloatArray) -> FloatArray:
        """Geometric blur [samples] of the least sharp picture that the estimator needs."""

    @abstractmethod
    def picture_geometry(self, distance: ArrayLike) -> PictureGeometry:
        """Where and how large it pictures objects at distances [m]: what blur, noise and window depend on."""

    def as_pictured(self) -> Self:
        """The camera without what its picture does not know of: its calibration, and how its errors are found."""
        return replace(self, calibration=PERFECT, propagation=LINEAR, disparity_error_px=1.0)

    def reading(self, distance: FloatArray, field: float, values: Mapping[str, FloatArray]) -> InverseDepthReading:
        """Inverse depths read under draws of its calibration and noise, by the exact model that these belong to."""
        read = self.read if self.calibration.reading is None else self.calibration.reading
        return read(distance, field, self.calibration.errors(values), self.calibration.environment)

    def parameter(self, name: str) -> ErrorParameter:
        """What is known of one drawn parameter: its unit, class and part."""
        known = self.error_vocabulary if self.calibration.vocabulary is None else self.calibration.vocabulary
        base = name.removeprefix(AGEING)
        found = known[base] if base in known else SESSION_PARAMETERS[base]
        return replace(found, part="ageing", error_class=ErrorClass.SESSION) if name != base else found

    def noise(self, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Standard deviation of the disparity of one measurement [m on the sensor] at a place in the field."""
        return disparity_error_at(self, distance, field) * self.sample_pitch

    def images(self, distance: ArrayLike) -> BoolArray:
        """Where an object lies beyond the focal length, so that a real image of it is formed."""
        return np.asarray(np.asarray(distance, dtype=np.float64) > self.gathering_lens.focal_length)

    def disparity_px(self, distance: ArrayLike) -> FloatArray:
        """The disparity that the estimator uses [samples], signed."""
        return self.disparity(distance) / self.sample_pitch

    def depth_discrimination(self, distance: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Change of true depth [m] that moves the disparity by the declared step, towards and away from the camera.

        The estimator stays as it is set up at the distance. The second may be infinite: a step beyond the disparity of
        infinity ends where the disparity tends to before it.
        """
        a = np.asarray(distance, dtype=np.float64)
        d, step = self.disparity(a), self.discrimination_step_px * self.sample_pitch
        return a - self.depth_of_disparity(d + step, a), self.depth_of_disparity(d - step, a) - a

    def virtual_depth(self, distance: ArrayLike) -> FloatArray:
        """a_L/b_L behind microlenses; NaN for a camera without."""
        return np.full(np.shape(distance), np.nan)

    def limits(self, distance: ArrayLike, criteria: UsableCriteria) -> Mapping[str, Limit]:
        """The geometric conditions of the usable range at distances [m], as far as the criteria ask for them."""
        a = np.asarray(distance, dtype=np.float64)
        found = {"real_image": Limit(value=a, bound=self.gathering_lens.focal_length, met=self.images(a))}
        found |= self.limits_of_kind(a, criteria)
        if criteria.blur_px is not None:
            value = self.estimator_blur_px(a)
            found["focus"] = Limit(value=value, bound=criteria.blur_px, met=value <= criteria.blur_px)
        if criteria.disparity_step_px is not None:
            value = (self.disparity(a) - self.disparity_of_infinity(a)) / self.sample_pitch
            found["last_disparity_step"] = Limit(
                value=value, bound=criteria.disparity_step_px, met=value > criteria.disparity_step_px
            )
        return found

    def limits_of_kind(self, distance: FloatArray, criteria: UsableCriteria) -> Mapping[str, Limit]:  # noqa: ARG002 - none unless the kind has some
        """The conditions that only cameras of this kind have."""
        return {}


def disparity_error_at(camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
    """Standard deviation of the disparity of one measurement [px] at distances [m] and a place in the field."""
    error = camera.disparity_error_px
    if isinstance(error, float | int):
        return np.full(np.shape(distance), float(error))
    return error.error_px(camera, distance, field)


def numerical_error_of_disparity_error(camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
    """Estimated numerical error of `disparity_error_at` [px]: 0 where it is declared."""
    error = camera.disparity_error_px
    if isinstance(error, float | int):
        return np.zeros(np.shape(distance))
    return error.numerical_error_px(camera, distance, field)


def false_match_share(camera: DepthCamera) -> float:
    """Share of all measurements that are false: 0 where the disparity error is declared, and says nothing of them."""
    error = camera.disparity_error_px
    return 0.0 if isinstance(error, float | int) else error.false_matches


def require_disparity_error(error: DisparityError) -> None:
    """Refuse a declared error that is not a finite number above zero; a law answers for itself."""
    if isinstance(error, float | int):
        require_positive("disparity error", error, "px")


def declared_disparity_error(camera: DepthCamera) -> float:
    """The one disparity error [px] of a camera that declares it, for what knows no error that depends on distance.

    Raises
    ------
    OutOfRangeError
        The error is derived from the picture.
    """
    error = camera.disparity_error_px
    if isinstance(error, float | int):
        return float(error)
    raise OutOfRangeError(
        "the disparity error of this camera is derived from its picture and differs from distance to distance",
        remedy="declare disparity_error in pixels",
    )
