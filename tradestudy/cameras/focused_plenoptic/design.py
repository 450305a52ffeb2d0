"""The focused plenoptic camera (plenoptic II): microlenses relay the image of the main lens onto the sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.cameras.camera import Properties
from tradestudy.cameras.contradictions import Contradiction, lens_contradictions
from tradestudy.cameras.depth_camera import (
    DepthErrorPart,
    Limit,
    UsableCriteria,
    declared_disparity_error,
)
from tradestudy.cameras.environment import Environment
from tradestudy.cameras.exact_model import ExactModel
from tradestudy.cameras.focused_plenoptic.description import focuses_before_array, properties_of
from tradestudy.cameras.focused_plenoptic.errors import PLENOPTIC_ERRORS
from tradestudy.cameras.focused_plenoptic.estimator import (
    LENSES_OF_PAIRS,
    PlenopticEstimator,
    UsedLenses,
    effective_baseline,
    neighbour_distance,
    require_choice,
    share_with_a_pair,
)
from tradestudy.cameras.focused_plenoptic.focus import MicrolensTypesFocus
from tradestudy.cameras.focused_plenoptic.method import METHOD
from tradestudy.cameras.focused_plenoptic.picture import relayed_picture
from tradestudy.cameras.focused_plenoptic.relay import Observation, Relay, relay_inverse_depth, relay_observation
from tradestudy.cameras.method import Method
from tradestudy.cameras.parts import Lens, MicrolensArray, require_positive
from tradestudy.cameras.picture_geometry import PictureGeometry
from tradestudy.cameras.plenoptic import DECLARED_ERRORS, PlenopticCalibration, array_contradictions, plenoptic_parts
from tradestudy.cameras.reading import Errors, InverseDepthReading, require_field, require_known
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.depth_of_field.plenoptic import inverse_focus_virtual_depth, relay_blur_diameter
from tradestudy.optics.microlens_coverage import mean_seen_count, projected_radius_over_pitch
from tradestudy.optics.microlens_projection import (
    microlens_object_distance,
    object_distance_of_virtual_depth,
    virtual_depth,
)
from tradestudy.optics.thin_lens import focus_shift
from tradestudy.optics.triangulation import depth_of_inverse, plenoptic_depth

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart
    from tradestudy.uncertainty.sources import Group

COVERING_VIRTUAL_DEPTH: Final = 2.0
"""Of the total covering plane: the nearest at which two microlenses of any type see every point."""


@dataclass(frozen=True, kw_only=True)
class FocusedPlenoptic(ExactModel):
    """Main lens, microlens array at z, sensor at b_L behind the array.

    Parameters
    ----------
    main_lens, sensor, microlenses
        The parts.
    mla_distance
        Main lens to array z [m].
    estimator
        Which micro-images depth is measured from: two neighbours, two neighbours of the same type, the two farthest
        apart, or least squares over all.
    lenses
        Which microlenses the estimator may use: ``all`` types, or those of the ``sharpest-type`` at each distance. Two
        neighbours are of different types, so ``adjacent-pair`` uses all; ``same-type-pair`` uses the sharpest.
    disparity_error_px
        Standard deviation of the disparity of one pair [px], of which one image coordinate has 1/√2, or the law it
        follows from.
    discrimination_step_px
        The disparity step [px] of the depth discrimination.
    calibration
        See `PlenopticCalibration`.
    expansion
        Standard deviation of the relative change of z with temperature since the calibration.

    Raises
    ------
    OutOfRangeError
        For parts that do not fit together.
    """

    family: ClassVar[str] = "plenoptic"
    error_units: ClassVar[Mapping[str, str]] = PLENOPTIC_ERRORS
    pictured_by_microlenses: ClassVar[bool] = True
    method: ClassVar[Method] = METHOD

    main_lens: Lens
    microlenses: MicrolensArray
    mla_distance: float
    estimator: PlenopticEstimator
    lenses: UsedLenses
    calibration: PlenopticCalibration = field(default_factory=PlenopticCalibration)

    def __post_init__(self) -> None:
        require_positive("distance from main lens to microlens array", self.mla_distance)
        super().__post_init__()
        require_choice(self.estimator, self.lenses)
        if self.microlenses.pitch > self.sensor.width:
            raise OutOfRangeError(
                "the sensor is smaller than one microlens",
                value=f"pitch {self.microlenses.pitch * 1e6:g} um",
                limit=f"at most {self.sensor.width * 1e6:g} um",
            )

    @property
    def focus(self) -> MicrolensTypesFocus:
        """What the types of microlenses keep sharp."""
        return MicrolensTypesFocus(
            main_lens=self.main_lens,
            microlenses=self.microlenses,
            mla_distance=self.mla_distance,
            sample_pitch=self.sensor.pixel_pitch,
        )

    @property
    def gathering_lens(self) -> Lens:
        """The main lens."""
        return self.main_lens

    def depth_behind_lens(self, nearest: float) -> float:  # noqa: ARG002 - nothing moves
        """Main lens to sensor [m]."""
        return self.mla_distance + self.microlenses.gap

    def microlens_object_distance(self, distance: ArrayLike) -> FloatArray:
        """a_L = z − b_M [m], signed: positive Keplerian, negative Galilean."""
        return microlens_object_distance(distance, self.mla_distance, self.main_lens.focal_length)

    def virtual_depth(self, distance: ArrayLike) -> FloatArray:
        """v = a_L / b_L."""
        return virtual_depth(distance, self.mla_distance, self.microlenses.gap, self.main_lens.focal_length)

    def radius_over_pitch(self, distance: ArrayLike) -> FloatArray:
        """Radius of the disc in which microlenses see a point, over the pitch; infinite objects allowed.

        NaN for objects inside the focal length, which have no image behind the main lens.
        """
        a_L = self.microlens_object_distance(distance)
        real = a_L < self.mla_distance
        radius = projected_radius_over_pitch(
            microlens_object_distance=np.where(real, a_L, 0.0),
            mla_distance=self.mla_distance,
            pupil_diameter=self.main_lens.pupil_diameter,
            microlens_pitch=self.microlenses.pitch,
        )
        return np.asarray(np.where(real, radius, np.nan))

    def estimator_baseline(self, distance: ArrayLike) -> FloatArray:
        """The distance Δx [m] of two microlenses that would measure as well as the estimator."""
        if self.estimator in LENSES_OF_PAIRS:
            return np.full(np.shape(distance), neighbour_distance(self.estimator, self.microlenses))
        return effective_baseline(self.estimator, self.lenses, self.microlenses, self.radius_over_pitch(distance))

    def disparity(self, distance: ArrayLike) -> FloatArray:
        """Disparity over the estimator's baseline, ``Δσ = Δx / v`` [m], signed like v."""
        v = self.virtual_depth(distance)
        with np.errstate(divide="ignore"):  # an image on the array has no finite disparity
            return np.asarray(self.estimator_baseline(distance) / v)

    def disparity_of_infinity(self, distance: ArrayLike) -> FloatArray:
        """Disparity [m] of infinity over the baseline that the estimator has at a distance.

        Minus infinity for an object so near that its image lies on the other side of the array than that of infinity:
        no error of disparity takes it there without passing a_L = 0.
        """
        reached = self.estimator_baseline(distance) / self.virtual_depth(np.inf)
        return np.asarray(np.where(self.disparity(distance) * reached > 0.0, reached, -np.inf))

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:
        """Eq. 8 [m] with the baseline that the estimator has at a true distance; see `plenoptic_depth`.

        Past zero it is what the true sign tends to, not the image of the other relay: infinity for a Keplerian relay,
        the front focal point for a Galilean one.
        """
        true, f = self.disparity(distance), self.main_lens.focal_length
        depth = plenoptic_depth(
            disparity,
            self.estimator_baseline(distance),
            mla_distance=self.mla_distance,
            microlens_gap=self.microlenses.gap,
            focal_length=f,
        )
        crossed = np.sign(disparity) * np.sign(true) <= 0.0
        depth = np.where(crossed, np.where(true > 0.0, np.inf, f), depth)
        return np.asarray(np.where(np.isnan(disparity), np.nan, depth))

    def depth_error_parts(self, distance: ArrayLike) -> tuple[DepthErrorPart, ...]:
        """Parts of the error as errors of disparity [m], to first order.

        A change δs of the focus shift read from a fixed picture acts like ``δd = Δx δs / (b_L v²)``, and ``∂s/∂z = 1``,
        ``∂s/∂b_L = −v`` and, for all that the focal length does to depth, ``−(1 + s/f)²``, of opposite sign to z:
        the two are one part, with their correlation.
        """
        f, gap = self.main_lens.focal_length, self.microlenses.gap
        s, v = focus_shift(distance, f), self.virtual_depth(distance)
        d = self.disparity(distance)
        with np.errstate(divide="ignore", invalid="ignore"):  # an image on the array has no disparity: NaN is meant
            per_shift = d / (gap * v)
        return plenoptic_parts(
            self,
            self.calibration,
            distance,
            of_mla_distance=per_shift,
            of_focal_length=per_shift * (1.0 + s / f) ** 2,
            of_gap=d / gap,
            expanded=self.expansion * self.mla_distance,
        )

    def depth_with_errors(self, distance: ArrayLike, errors: Mapping[str, ArrayLike]) -> FloatArray:
        """The depth [m] that eq. 8 gives for a fixed picture read with parameters that are off by ``errors``.

        Parameters
        ----------
        distance
            True distance [m].
        errors
            ``pixel_noise`` [m of disparity], ``mla_distance``, ``focal_length``, ``microlens_gap`` [m]; missing is 0.

        Returns
        -------
        FloatArray
            Exact, not linearised; +infinity for disparities that belong to no point in front of the camera.
        """
        require_known(errors, DECLARED_ERRORS, "a focused plenoptic camera")
        # Of a point on the axis, as `read` gives it, without its limit to what is in front of the lens.
        inverse, _ = self.believe(errors, self.observe({}, 0.0, 0.0, distance), distance)
        return depth_of_inverse(inverse)

    def error_directions(self, distance: ArrayLike) -> Mapping[str, tuple[Mapping[str, ArrayLike], ...]]:
        """One standard deviation of each error; z and f_M split into what they share and what f_M has alone."""
        return self.calibration.error_directions(self.noise(distance), self.expansion * self.mla_distance)

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the stereo rig of this focal length and disparity error that measures as well.

        ``B = (a/(a − f))² f Δx / (b_L v²)``.
        """
        a, f = np.asarray(distance, dtype=np.float64), self.main_lens.focal_length
        v2 = self.virtual_depth(a) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):  # v = 0: an image on the array
            return np.asarray(
                (1.0 + focus_shift(a, f) / f) ** 2 * f * self.estimator_baseline(a) / (self.microlenses.gap * v2)
            )

    def blur_px(self, distance: ArrayLike) -> FloatArray:
        """Geometric blur of each type's micro-image, ``D |1/v − 1/v₀|`` [px]; shape (types, …), D the lens diameter."""
        v = self.virtual_depth(distance)
        array = self.microlenses
        in_focus = inverse_focus_virtual_depth(array.focal_lengths, array.gap).reshape((-1,) + (1,) * v.ndim)
        return relay_blur_diameter(v, in_focus, array.aperture_diameter) / self.sensor.pixel_pitch

    def availability(self, distance: ArrayLike) -> FloatArray:
        """Share of points seen by at least two of the microlenses that the estimator uses."""
        return share_with_a_pair(self.lenses, self.microlenses, self.radius_over_pitch(distance))

    def limits_of_kind(self, distance: FloatArray, criteria: UsableCriteria) -> Mapping[str, Limit]:
        """Total covering plane and availability of the estimator's microlenses."""
        found = {}
        if criteria.virtual_depth is not None:
            value = np.abs(self.virtual_depth(distance))
            found["total_covering_plane"] = Limit(
                value=value, bound=criteria.virtual_depth, met=value >= criteria.virtual_depth * (1.0 - 1e-9)
            )
        if criteria.availability is not None:
            value = self.availability(distance)
            found["availability"] = Limit(value=value, bound=criteria.availability, met=value >= criteria.availability)
        return found

    def least_sharp_type(self, distance: ArrayLike) -> NDArray[np.intp]:
        """Number of the type that gives the least sharp picture that the estimator needs: second best of neighbours."""
        order = np.argsort(self.blur_px(distance), axis=0)
        if self.estimator == "adjacent-pair":
            return np.asarray(order[min(1, len(order) - 1)])
        return np.asarray(order[-1] if self.lenses == "all" else order[0])

    def estimator_blur_px(self, distance: FloatArray) -> FloatArray:
        """Blur [px] of the least sharp picture that the estimator needs."""
        used = self.least_sharp_type(distance)
        return np.asarray(np.take_along_axis(self.blur_px(distance), used[np.newaxis], axis=0)[0])

    def picture_geometry(self, distance: ArrayLike) -> PictureGeometry:
        """The micro-images on the sensor; the least sharp type that the estimator needs stands for all."""
        a = np.asarray(distance, dtype=np.float64)
        a = np.where(self.images(a), a, np.nan)
        used = self.least_sharp_type(a)
        return relayed_picture(
            a,
            self.main_lens,
            self.microlenses,
            self.sensor,
            self.mla_distance,
            blur=np.take_along_axis(self.blur_px(a), used[np.newaxis], axis=0)[0] * self.sensor.pixel_pitch,
            used_type=used,
        )

    def without_calibration_errors(self) -> FocusedPlenoptic:
        """The same camera, perfectly calibrated."""
        return replace(self, calibration=PlenopticCalibration())

    @property
    def relay(self) -> Relay:
        """The geometry that both what is seen and what is read follow from."""
        return Relay(
            focal_length=self.main_lens.focal_length,
            mla_distance=self.mla_distance,
            gap=self.microlenses.gap,
            pitch=self.microlenses.pitch,
            corner=self.sensor.diagonal / 2.0,
        )

    def observe(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Observation:
        """What a camera that deviates from its design by ``errors`` sees of a point; see `relay_observation`."""
        return relay_observation(self.relay, self.estimator_baseline(z), errors, x, y, z)

    def believe(self, errors: Errors, seen: Observation, distance: ArrayLike) -> tuple[FloatArray, BoolArray]:
        """The inverse depth that a calibration which is off by ``errors`` reads; see `relay_inverse_depth`.

        The true distance [m] tells the two microlenses and the sign of the disparity.
        """
        sign = np.sign(self.virtual_depth(distance))
        return relay_inverse_depth(self.relay, self.estimator_baseline(distance), errors, seen, sign)

    def read(
        self, distance: FloatArray, field: float, errors: Errors, environment: Environment | None = None
    ) -> InverseDepthReading:
        """See `ExactModel.read`.

        z, b_L and the pitch grow with the housing; the focal length of the main lens has its own drift and follows the
        index of the air.
        """
        require_known(errors, PLENOPTIC_ERRORS, "a focused plenoptic camera")
        require_field(field)
        a, sensor = np.asarray(distance, dtype=np.float64), self.sensor
        changed: dict[str, ArrayLike] = {}
        if environment is not None and ("temperature_change" in errors or "pressure_change" in errors):
            growth = environment.length_factor(errors) - 1.0
            changed = {
                "mla_distance": self.mla_distance * growth,
                "microlens_gap": self.microlenses.gap * growth,
                "microlens_pitch": self.microlenses.pitch * growth,
                "focal_length": self.main_lens.focal_length * (environment.focal_length_factor(errors) - 1.0),
            }
        right = field * sensor.width / 2.0 / self.mla_distance
        down = field * sensor.height / 2.0 / self.mla_distance
        inverse, valid = self.believe(errors, self.observe(changed, right * a, down * a, a), a)
        return InverseDepthReading(
            inverse_depth=inverse,
            no_overlap=np.zeros((1, 1), dtype=bool),
            out_of_range=~(valid & (a > self.main_lens.focal_length)),
        )

    def declared_errors(self) -> tuple[Group, ...]:
        """See `PlenopticCalibration.groups`."""
        return tuple(self.calibration.groups(declared_disparity_error(self) * self.sensor.pixel_pitch))

    def observe_target(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, ...]:
        """Disparity of the two micro-images of a corner, and where on the array they lie."""
        apart, on_x, on_y = self.observe(errors, x, y, z)
        return apart - self.estimator_baseline(z), on_x, on_y

    def target_noise_px(self, corner_noise_px: float) -> FloatArray:
        """That of the disparity as declared, and of both coordinates on the array."""
        return np.array([declared_disparity_error(self), corner_noise_px, corner_noise_px])

    def seen_on_sensor(self, observed_px: FloatArray) -> BoolArray:
        """A corner is seen where its micro-images lie on the sensor."""
        half = np.array([self.sensor.columns, self.sensor.rows]) / 2.0
        inside = np.all(np.abs(observed_px[..., 1:]) <= half, axis=-1)
        return np.repeat(inside[..., np.newaxis], 3, axis=-1)

    def microlenses_seeing(self, distance: FloatArray) -> FloatArray:
        """Mean number of microlenses that see a point."""
        radius = self.radius_over_pitch(distance)
        count = mean_seen_count(np.nan_to_num(radius), layout=self.microlenses.layout)
        return np.asarray(np.where(np.isnan(radius), np.nan, count))

    @property
    def total_covering_plane(self) -> float:
        """Where |v| = 2 on the side of the array that the first type focuses on [m]; NaN where that is nowhere."""
        side = 1.0 if focuses_before_array(self.microlenses) else -1.0
        return float(
            object_distance_of_virtual_depth(
                side * COVERING_VIRTUAL_DEPTH,
                mla_distance=self.mla_distance,
                microlens_gap=self.microlenses.gap,
                focal_length=self.main_lens.focal_length,
            )
        )

    def properties(self) -> Properties:
        """Distances, microlenses, coverage and field of view; see `properties_of`."""
        at_infinity = float(self.virtual_depth(math.inf))
        return properties_of(self.main_lens, self.microlenses, self.sensor, self.mla_distance, at_infinity)

    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:  # noqa: ARG002 - none of depth
        """Those of the main lens and of the array."""
        array = array_contradictions(self.main_lens, self.microlenses, self.mla_distance, stated)
        return [*lens_contradictions(self.main_lens, self.sensor, stated), *array]
