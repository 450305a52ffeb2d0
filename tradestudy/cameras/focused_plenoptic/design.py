"""The focused plenoptic camera (plenoptic II): microlenses relay the image of the main lens onto the sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.cameras.camera import DerivedValue, Properties
from tradestudy.cameras.depth_camera import (
    Formula,
    Limit,
    Method,
    UsableCriteria,
)
from tradestudy.cameras.depth_measurement import Errors, value_of
from tradestudy.cameras.focused_plenoptic.estimator import (
    LENSES_OF_PAIRS,
    MicroImages,
    PlenopticEstimator,
    UsedLenses,
    effective_baseline,
    neighbour_distance,
    share_with_a_pair,
)
from tradestudy.cameras.focused_plenoptic.focus import NO_SCALING, DepthScaling, MicrolensTypesFocus
from tradestudy.cameras.microlens_exposure import ArrayGeometry, Observation, disparity_error
from tradestudy.cameras.parts import Lens, MicrolensArray, require_positive
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.cameras.plenoptic import PlenopticCamera, fill_properties
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.microlens_coverage import (
    PAIR_COVERING_RADIUS,
    covering_microlens_object_distance,
    lit_radius_over_pitch,
    mean_seen_count,
    projected_radius_over_pitch,
)
from tradestudy.optics.plenoptic_depth_of_field import inverse_focus_virtual_depth, relay_blur_diameter
from tradestudy.optics.thin_lens import (
    focus_shift,
    image_distance,
    microlens_object_distance,
    object_distance,
    object_distance_of_virtual_depth,
    virtual_depth,
)
from tradestudy.optics.triangulation import depth_of_inverse, plenoptic_depth, plenoptic_focus_shift
from tradestudy.units import ANGLE, FRACTION, LENGTH, NUMBER, pretty

METHOD: Final = Method(
    name="plenoptic",
    title="Depth from a focused plenoptic camera",
    statements=(
        "The main lens (focal length *f*~M~) forms the image of a point at distance *a*~M~. The microlens array is a "
        "distance *z* behind the main lens, and the image lies *a*~L~ in front of the array (Keplerian), or behind it "
        "(Galilean), where *a*~L~ is negative. Every microlens that sees this image forms an image of it on the "
        "sensor, a gap *b*~L~ behind the array. The virtual depth is *v* = *a*~L~/*b*~L~; the total covering plane "
        "is the object distance at which its magnitude is 2. Two microlenses whose centres are at *x*~off~ show the "
        "point at the position σ, measured in each micro-image from the centre of its microlens; superscripts "
        "distinguish the two:",
        Formula(
            typst='a_M = f_M [1 + f_M / ((z - f_M) - b_L (x_"off"^1 - x_"off"^2) / (sigma^1 - sigma^2))]',
            alt="a M equals f M times one plus f M over the quantity z minus f M minus b L times the difference of the "
            "two microlens centres over the difference of the two micro-image coordinates.",
            reference="paper, eq. 8",
        ),
        "A calibration may correct this depth by a quadratic function of it (`depth.scaling`). Its derivative then "
        "multiplies the depth uncertainty.",
        "The standard deviation σ~v~ of the virtual depth, and errors of *z* and *f*~M~, affect depth as follows:",
        Formula(
            typst="sigma_(a_M) = ((a_M - f_M) / f_M)^2 b_L sigma_v, quad"
            " (partial a_M) / (partial z) = -((a_M - f_M) / f_M)^2, quad"
            " (partial a_M) / (partial f_M) = (a_M / f_M)^2",
            alt="The standard deviation of a M equals the square of a M minus f M over f M, times b L, times the "
            "standard deviation of v. The derivative of a M with respect to z is minus the square of a M minus f M "
            "over f M; with respect to f M it is the square of a M over f M.",
        ),
        "The two derivatives have opposite signs: depth depends mainly on the error of *z* − *f*~M~, and therefore on "
        "how the errors of *z* and *f*~M~ are correlated. For a given disparity error, the error of *v* depends on "
        "the declared estimator: it grows with *v*² for the nearest pair of microlenses (of any type, or of "
        "one type), with *v* for the widest pair, and is constant for least squares over all microlenses.",
    ),
    matching=(
        "A focused plenoptic camera compares two micro-images, each *n* in diameter, over the part of the object that "
        "both show. If their microlenses are *D* apart, the micro-images are offset by *d* once their textures are "
        "aligned. If the image lies a distance *b*~M~ behind the main lens, the largest square that fits into both "
        "has the side *w*:",
        Formula(
            typst="w = (sqrt(2 n^2 - d^2) - d) / 2, quad d = D / abs(v) thin b_M / z",
            alt="w equals half of the square root of two n squared minus d squared, less d, where d is D over the "
            "absolute value of v, times b M over z.",
        ),
        "The matching window of a pair is this square or the declared window, whichever is smaller. Of the pairs that "
        "see a point, the widest one has the longest baseline and the smallest window. Least squares adds the "
        "information of all pairs, each with its own window.",
    ),
)


def _covered(lens: Lens, array: MicrolensArray, mla_distance: float, depth_scaling: DepthScaling) -> str:
    """Exact distances at which two microlenses of any type see every point, on both sides of the array.

    Light behind the array (Galilean) covers it up to a distance, and light in front (Keplerian) from a distance on,
    whatever the focal lengths of the microlenses.
    """
    ranges = []
    for keplerian in (False, True):
        if not keplerian and 2.0 * PAIR_COVERING_RADIUS * array.pitch * lens.pupil_ratio > lens.pupil_diameter:
            continue
        a_L = float(
            covering_microlens_object_distance(
                PAIR_COVERING_RADIUS,
                mla_distance=lens.principal_distance(mla_distance),
                pupil_diameter=lens.pupil_diameter,
                microlens_pitch=array.pitch,
                pupil_ratio=lens.pupil_ratio,
                keplerian=keplerian,
            )
        )
        shift = mla_distance - a_L - lens.focal_length
        if shift > 0.0:
            covering = depth_scaling.metric(object_distance(shift, lens.focal_length))
            distance = pretty(float(covering), LENGTH, 4)
            ranges.append(f"from {distance}" if keplerian else f"up to {distance}")
        elif not keplerian:
            return "everywhere"
    return " and ".join(ranges) or "nowhere"


def _counted(least_lit_share: float) -> str:
    """Which microlenses count, in words."""
    return f"those with {pretty(least_lit_share, FRACTION, 3)} or more of the light of the point's best-lit microlens"


def _grid_scale(geometry: ArrayGeometry, errors: Errors) -> FloatArray:
    """Ratio of actual to designed distance of microlens centres, from the pitch and the pupil that locates them."""
    moved = {name: error for name, error in errors.items() if name == "pupil_distance"}
    through_pupil = (1.0 + geometry.image_spread({})) / (1.0 + geometry.image_spread(moved))
    return geometry.pitch_scale(errors) * through_pupil


COVERING_VIRTUAL_DEPTH: Final = 2.0
"""Virtual depth of the total covering plane: the smallest at which two microlenses of any type see every point."""


@dataclass(frozen=True, kw_only=True)
class FocusedPlenoptic(PlenopticCamera):
    """Main lens, microlens array at a distance z behind it, and sensor at a distance b_L behind the array.

    Parameters
    ----------
    main_lens, sensor, microlenses, field_curvature
        See `PlenopticCamera`.
    mla_distance
        Distance z from main lens to array [m].
    estimator
        Micro-images that are compared: two neighbours, two neighbours of the same type, the two farthest apart, or all
        by least squares.
    lenses
        Microlenses that the estimator may use: ``all`` types, or those of the ``sharpest-type`` at each distance.
        Neighbours are of different types, so ``adjacent-pair`` uses all; ``same-type-pair`` uses the sharpest.
    disparity_error_px
        Standard deviation of the disparity of one pair [px] (1/√2 of it for one image coordinate), or the law that
        gives it.
    discrimination_step_px
        The disparity step [px] of the depth discrimination.
    depth_scaling
        Metric depth M of the depth Z by eq. 8. An object at M is imaged, blurred and seen by as many microlenses as the
        design images an object at Z = s⁻¹(M); its size on the sensor is that of an object at M. A scaling corrects
        readings: rendered pictures and `light_chain` have none, so depth read in rendered pictures of M is s(M).
    least_lit_share
        A microlens counts where it receives at least this share of the light of the best-lit one; None where its centre
        lies in the disc of light. It acts in the number of microlenses, in availability and in the baselines of
        estimators that use many microlenses, whose disparities are equally precise.

    Raises
    ------
    OutOfRangeError
        The parts do not fit together.
    """

    pictured_by_microlenses: ClassVar[bool] = True
    method: ClassVar[Method] = METHOD

    mla_distance: float
    estimator: PlenopticEstimator
    lenses: UsedLenses
    depth_scaling: DepthScaling = NO_SCALING
    least_lit_share: float | None = None

    def __post_init__(self) -> None:
        require_positive("distance from main lens to microlens array", self.mla_distance)
        super().__post_init__()
        only = LENSES_OF_PAIRS.get(self.estimator, self.lenses)
        if self.lenses != only:
            raise OutOfRangeError(
                f"the estimator {self.estimator} has no choice of microlenses", value=self.lenses, limit=only
            )

    @property
    def focus(self) -> MicrolensTypesFocus:
        """The focus of the microlens types."""
        return MicrolensTypesFocus(
            main_lens=self.main_lens,
            microlenses=self.microlenses,
            mla_distance=self.mla_distance,
            sample_pitch=self.sensor.pixel_pitch,
            depth_scaling=self.depth_scaling,
        )

    def modelled_distance(self, distance: ArrayLike) -> FloatArray:
        """Z [m] for metric distances M [m]; see `DepthScaling`."""
        return self.depth_scaling.modelled(distance)

    def microlens_object_distance(self, distance: ArrayLike) -> FloatArray:
        """a_L = z − b_M [m], signed: positive Keplerian, negative Galilean."""
        a = self.modelled_distance(distance)
        return microlens_object_distance(a, self.mla_distance, self.main_lens.focal_length)

    def virtual_depth(self, distance: ArrayLike) -> FloatArray:
        """v = a_L / b_L."""
        return self._virtual_depth_of(self.modelled_distance(distance))

    def _virtual_depth_of(self, modelled: ArrayLike) -> FloatArray:
        return virtual_depth(modelled, self.mla_distance, self.microlenses.gap, self.main_lens.focal_length)

    def radius_over_pitch(self, distance: ArrayLike) -> FloatArray:
        """Radius, in pitches, of the disc in which microlenses see a point; objects may be at infinity.

        NaN for objects inside the focal length, which have no image behind the main lens.
        """
        a_L = self.microlens_object_distance(distance)
        real = (a_L < self.mla_distance) & (self.from_pupil(self.modelled_distance(distance)) > 0.0)
        radius = projected_radius_over_pitch(
            microlens_object_distance=np.where(real, a_L, 0.0),
            mla_distance=self.principal_distance,
            pupil_diameter=self.main_lens.pupil_diameter,
            microlens_pitch=self.microlenses.pitch,
            pupil_ratio=self.main_lens.pupil_ratio,
        )
        return np.asarray(np.where(real, radius, np.nan))

    def counted_radius_over_pitch(self, distance: ArrayLike) -> FloatArray:
        """Radius, in pitches, of the disc in which the centres of microlenses lie that count; see `least_lit_share`."""
        radius, array = self.radius_over_pitch(distance), self.microlenses
        if self.least_lit_share is None:
            return radius
        lens = array.aperture_diameter / array.pitch / 2.0
        return lit_radius_over_pitch(radius, lens_radius_over_pitch=lens, least_share=self.least_lit_share)

    def estimator_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline Δx [m] of a pair of microlenses that measures as precisely as the estimator."""
        if self.estimator in LENSES_OF_PAIRS:
            return np.full(np.shape(distance), neighbour_distance(self.estimator, self.microlenses))
        z = np.asarray(distance, dtype=np.float64)
        return _baseline(self, z.tobytes(), z.shape)

    def disparity(self, distance: ArrayLike) -> FloatArray:
        """Disparity over the estimator's baseline, ``Δσ = Δx / v`` [m], signed like v."""
        v = self.virtual_depth(distance)
        with np.errstate(divide="ignore"):  # an image on the array has no finite disparity
            return np.asarray(self.estimator_baseline(distance) / v)

    def disparity_of_infinity(self, distance: ArrayLike) -> FloatArray:
        """Disparity [m] of infinity, or of `DepthScaling.farthest`, over the estimator's baseline at a distance.

        Minus infinity for an object so near that its image lies on the other side of the array: no disparity error can
        move it to infinity without passing a_L = 0.
        """
        reached = self.estimator_baseline(distance) / self._virtual_depth_of(self.depth_scaling.farthest)
        return np.asarray(np.where(self.disparity(distance) * reached > 0.0, reached, -np.inf))

    def depth_of_disparity(self, disparity: ArrayLike, distance: ArrayLike) -> FloatArray:
        """Depth [m] by eq. 8 with the baseline that the estimator uses at a true distance; see `plenoptic_depth`.

        Disparities of the wrong sign give the limit at zero disparity, not the depth of the other relay: infinity for a
        Keplerian relay, the front focal point for a Galilean one.
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
        return self.depth_scaling.metric(np.where(np.isnan(disparity), np.nan, depth))

    def equivalent_baseline(self, distance: ArrayLike) -> FloatArray:
        """Baseline [m] of the equally precise stereo rig with this focal length and disparity error.

        ``B = (a/(a − f))² f Δx / (b_L v²)``, times ``(M/Z)²/(dM/dZ)`` for a depth scaling.
        """
        a, f = self.modelled_distance(distance), self.main_lens.focal_length
        v2 = self._virtual_depth_of(a) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):  # v = 0: an image on the array
            baseline = self.estimator_baseline(distance)
            equivalent = (1.0 + focus_shift(a, f) / f) ** 2 * f * baseline / (self.microlenses.gap * v2)
            if not self.depth_scaling.is_identity:
                equivalent *= np.square(np.asarray(distance) / a) / self.depth_scaling.slope(a)
            return np.asarray(equivalent)

    def blur_px(self, distance: ArrayLike) -> FloatArray:
        """Geometric blur of each type's micro-image, ``D |1/v − 1/v₀|`` [px]; shape (types, …), D the lens diameter."""
        v = self.virtual_depth(distance)
        array = self.microlenses
        in_focus = inverse_focus_virtual_depth(array.focal_lengths, array.gap).reshape((-1,) + (1,) * v.ndim)
        return relay_blur_diameter(v, in_focus, array.aperture_diameter) / self.sensor.pixel_pitch

    def availability(self, distance: ArrayLike) -> FloatArray:
        """Share of points seen by at least two of the microlenses that the estimator uses."""
        return share_with_a_pair(self.lenses, self.microlenses, self.counted_radius_over_pitch(distance))

    def limits_of_kind(self, distance: FloatArray, criteria: UsableCriteria) -> Mapping[str, Limit]:
        """Conditions on virtual depth and on availability; without enough microlenses there is no depth."""
        value, bound = self.availability(distance), criteria.availability or 0.0
        limits = {"availability": Limit(value=value, bound=bound, met=(value >= bound) & (value > 0.0))}
        if criteria.virtual_depth is not None:
            value = np.abs(self.virtual_depth(distance))
            limits["total_covering_plane"] = Limit(
                value=value, bound=criteria.virtual_depth, met=value >= criteria.virtual_depth * (1.0 - 1e-9)
            )
        return limits

    def least_sharp_type(self, distance: ArrayLike) -> NDArray[np.intp]:
        """Index of the least sharp type that the estimator needs; for neighbours, the second sharpest."""
        order = np.argsort(self.blur_px(distance), axis=0)
        if self.estimator == "adjacent-pair":
            return np.asarray(order[min(1, len(order) - 1)])
        return np.asarray(order[-1] if self.lenses == "all" else order[0])

    def picture_geometry(self, distance: ArrayLike) -> PictureGeometry:
        """The micro-images on the sensor; the least sharp type that the estimator needs represents all."""
        a = np.asarray(distance, dtype=np.float64)
        a = np.where(self.images(a), a, np.nan)
        used, modelled = self.least_sharp_type(a), self.modelled_distance(a)
        array, pixel, lens = self.microlenses, self.sensor.pixel_pitch, self.main_lens
        z, f, pupil = self.principal_distance, lens.focal_length, lens.pupil_diameter
        image = lens.principal_distance(image_distance(modelled, f))
        from_pupil = self.from_pupil(modelled)
        relayed = np.asarray(microlens_object_distance(modelled, self.mla_distance, f))
        # An image on the array is magnified infinitely: there is no picture.
        relayed = np.where(relayed == 0.0, np.nan, relayed)
        relay = array.gap / np.abs(relayed)
        blur = np.take_along_axis(self.blur_px(a), used[np.newaxis], axis=0)[0] * pixel
        microlens = LensStage(
            aperture_diameter=array.aperture_diameter,
            focal_length=np.asarray(array.focal_lengths)[used],
            object_distance=relayed,
            plane_distance=np.full_like(modelled, array.gap),
            blur_diameter=np.where(np.isnan(relayed), np.nan, blur),
            relay=np.ones_like(modelled),
        )
        micro_image = min(array.pitch, pupil * array.gap / z)
        geometry = PictureGeometry(
            distance=modelled,
            magnification=image / from_pupil * relay,
            sample_pitch=pixel,
            sample_width=pixel,
            sample_shape="square",
            pixel_pitch=pixel,
            compared=MicroImages(
                estimator=self.estimator,
                lenses=self.lenses,
                array=array,
                diameter_px=micro_image / pixel,
                neighbours_apart_px=array.pitch * relay * image / z / pixel,
                radius_over_pitch=self.radius_over_pitch(a),
            ),
            light_f_number=microlens.f_number,
            pupil_diameter=pupil,
            main_lens=LensStage(
                aperture_diameter=pupil,
                focal_length=np.where(np.isnan(modelled), f, lens.thin_focal_length(from_pupil)),
                object_distance=from_pupil,
                plane_distance=image,
                blur_diameter=np.zeros_like(modelled),
                relay=relay,
            ),
            microlens=microlens,
            micro_image_diameter=micro_image,
        )
        if self.depth_scaling.is_identity:
            return geometry
        return replace(geometry, distance=a, magnification=geometry.magnification * modelled / a)

    @property
    def left_out(self) -> str:
        """See `Camera.left_out`."""
        scaling = (
            ""
            if self.depth_scaling.is_identity
            else "its depth scaling acts in measured depth, not in rendered pictures"
        )
        return "; ".join(filter(None, (super().left_out, scaling)))

    @property
    def geometry(self) -> ArrayGeometry:
        """The geometry with the array at its declared distance."""
        return self.geometry_at(self.mla_distance)

    def observe(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Observation:
        """Distance between the two micro-images of a point, and their position.

        Two microlenses Δx apart relay the image at a_L in front of the array: ``Δu = Δx (1 + b_L/a_L)`` (eq. 4 in
        absolute coordinates on the detector). Exact for thin lenses; infinite where the main lens images onto the
        array, NaN for points that it does not image. Pixel noise and the scatter of the microlens centres, which varies
        over the array, belong to `believe`.
        """
        baseline = self.estimator_baseline(z)
        if not self.depth_scaling.is_identity:
            modelled = self.modelled_distance(z)
            x, y, z = (np.asarray(coordinate) * (modelled / np.asarray(z)) for coordinate in (x, y, z))  # along the ray
        errors, geometry = self.with_known(errors), self.geometry
        place = geometry.place_of(errors, x, y, z)
        a_L = geometry.microlens_object_distance(errors, place, z)
        with np.errstate(divide="ignore"):  # an image on the array is a pole, documented above
            apart = baseline * _grid_scale(geometry, errors) * (1.0 + place.gap / a_L)
        return apart, *place.on_sensor

    def rescaled(self, seen: Observation, changed: Errors, scale: FloatArray) -> Observation:  # noqa: ARG002 - all is on the sensor
        """All three are lengths on the sensor, and the distance of the centres is that of the calibration."""
        apart, x, y = seen
        return apart / scale, x / scale, y / scale

    def believe(self, errors: Errors, seen: Observation, distance: ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Inverse depth by eq. 8 with coordinates on the detector, and by the depth scaling.

        ``Δσ = Δu cos φ + error − Δx``, ``a_L = b_L Δx/Δσ``, ``b = z − a_L``, ``1/a = (b − f)/(f b)``. Beyond infinity,
        it continues smoothly down to −1/f. A disparity of the wrong sign gives −1/f for a Keplerian relay, and the
        front focal point (1/f) for a Galilean one. NaN where the estimator has no microlenses; invalid where a
        calibrated length is not positive or the calibrated distortion has no inverse.
        """
        turned = np.cos(value_of(errors, "array_rotation"))  # relative to the camera, which contains what is known
        errors = self.with_known(errors)
        geometry, baseline, (apart, seen_x, seen_y) = self.geometry, self.estimator_baseline(distance), seen
        f, place = geometry.focal_length_with(errors), geometry.place_seen(errors, seen_x, seen_y)
        spacing = baseline * _grid_scale(geometry, errors)
        sigma = apart * turned + disparity_error(errors) - spacing
        shift = plenoptic_focus_shift(
            sigma,
            spacing,
            mla_distance=place.flat_distance,
            microlens_gap=place.gap * place.stretch,
            focal_length=f,
        )
        shift = shift + place.undisplacement(shift + f)
        inverse = np.maximum(shift, -f) / (f * (f + np.maximum(shift, 0.0)))
        sign = np.sign(apart - baseline)  # 1 for a Keplerian relay, −1 for a Galilean one
        inverse = np.where(sigma * sign <= 0.0, -sign / f, inverse)
        return self.depth_scaling.metric_inverse(inverse), place.valid & (spacing > 0.0)

    def depth_at(self, inverse_virtual_depth: FloatArray, place: FloatArray, distance: FloatArray) -> FloatArray:
        """Depth [m] measured at places on the sensor (2, …) [m] from 1/v there, near distances [m]; see `believe`."""
        apart = self.estimator_baseline(distance) * (1.0 + inverse_virtual_depth)
        inverse, valid = self.believe({}, (apart, place[0], place[1]), distance)
        return depth_of_inverse(np.where(valid, inverse, np.nan))

    def observe_target(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> tuple[FloatArray, ...]:
        """Disparity of the two micro-images of a corner, and their position on the array."""
        apart, on_x, on_y = self.observe(errors, x, y, z)
        return apart - self.estimator_baseline(z), on_x, on_y

    def microlenses_seeing(self, distance: FloatArray) -> FloatArray:
        """Mean number of microlenses that see a point."""
        radius = self.counted_radius_over_pitch(distance)
        count = mean_seen_count(np.nan_to_num(radius), layout=self.microlenses.layout)
        return np.asarray(np.where(np.isnan(radius), np.nan, count))

    @property
    def total_covering_plane(self) -> float:
        """Object distance with |v| = 2 on the side of the array on which the first type is used [m]; NaN if none."""
        side = 1.0 if self.focus.keplerian[0] else -1.0
        plane = object_distance_of_virtual_depth(
            side * COVERING_VIRTUAL_DEPTH,
            mla_distance=self.mla_distance,
            microlens_gap=self.microlenses.gap,
            focal_length=self.main_lens.focal_length,
        )
        return float(self.depth_scaling.metric(plane))

    def properties(self) -> Properties:
        """Distances, microlenses, coverage and field of view."""
        array, lens, sensor, scaling = self.microlenses, self.main_lens, self.sensor, self.depth_scaling
        at_infinity, plane = float(self.virtual_depth(math.inf)), self.total_covering_plane
        if math.isnan(plane) and math.isclose(abs(at_infinity), COVERING_VIRTUAL_DEPTH):
            plane = math.inf
        count = len(array.focal_lengths)
        types = [""] if count == 1 else [f", type {k + 1}" for k in range(count)]
        return (
            *(() if scaling.is_identity else (("metric depth of the depth Z by eq. 8", scaling.words),)),
            ("distance from main lens to array, z", DerivedValue(self.mla_distance, LENGTH)),
            ("microlens gap, b_L", DerivedValue(array.gap, LENGTH)),
            *(
                (
                    f"microlens focal length, f_L{type_}",
                    DerivedValue(focal_length, LENGTH) if math.isfinite(focal_length) else "none: pinholes",
                )
                for type_, focal_length in zip(types, array.focal_lengths, strict=True)
            ),
            *self.lens_places(),
            ("pupil diameter", DerivedValue(lens.pupil_diameter, LENGTH)),
            ("microlens f-number, gap/pitch", DerivedValue(array.gap / array.pitch, NUMBER)),
            ("pixels per microlens", DerivedValue(array.pitch / sensor.pixel_pitch, NUMBER)),
            *fill_properties(array),
            ("virtual depth at infinity", DerivedValue(at_infinity, NUMBER)),
            (
                "total covering plane, where |virtual depth| is 2",
                "none" if math.isnan(plane) else DerivedValue(plane, LENGTH),
            ),
            (
                "distances, exact for this lattice, at which two or more microlenses of any type see every point"
                + ("" if self.least_lit_share is None else " with their centres"),
                _covered(lens, array, self.mla_distance, scaling),
            ),
            *(() if self.least_lit_share is None else (("microlenses that count", _counted(self.least_lit_share)),)),
            ("horizontal field of view, focused at infinity", DerivedValue(lens.field_of_view(sensor.width), ANGLE)),
            ("diagonal field of view, focused at infinity", DerivedValue(lens.field_of_view(sensor.diagonal), ANGLE)),
        )


@lru_cache(maxsize=8)
def _baseline(camera: FocusedPlenoptic, distances: bytes, shape: tuple[int, ...]) -> FloatArray:
    """Baseline [m] of an estimator that uses many microlenses, the same for every noise that is tried at a distance."""
    radius = camera.counted_radius_over_pitch(np.frombuffer(distances).reshape(shape))
    return effective_baseline(camera.estimator, camera.lenses, camera.microlenses, radius)
