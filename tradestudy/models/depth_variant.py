"""One camera in one reading or design of a study: what its models change, at the distances that matter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import DepthCamera, Limit, UsableCriteria, false_match_share
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.depth.evaluation import clear_departure, distribution, imaged, model_error
from tradestudy.depth.linear import all_normal, has_covariance, linearised_depth, scaled_noise
from tradestudy.depth.usable import Boundary, all_met, evaluate_limits, usable_ends, usable_stretches
from tradestudy.effects import OFF, Models
from tradestudy.imaging.models import PictureModels
from tradestudy.imaging.picture import LARGEST_ERROR_PX, PictureDisparityError, WeighedPicture
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray
from tradestudy.study.prepared import apply_models, complete_in_closed_form, in_closed_form, with_models

_ENDS_ARE_KNOWN_TO: Final = 1e-3  # of their distance: at 1e-2, a steep limit would seem not to decide its end
_BESIDE_AN_END: Final = 1e-2  # of its distance, for that slope
_NEAR_ITS_BOUND: Final = 0.1  # of the bound: a limit whose value is this near decides an end
_NEAR_A_STEEP_BOUND: Final = 2.0  # the same for a failed fraction, which can be several times its bound 1 % farther
_SET_BY_FAILURES: Final = 1.0  # the same where the failed fraction is known at the end itself
_TINY: Final = 1e-300
_FAR: Final = 30.0  # times the bound of a failed fraction: no error of linear propagation reaches so far
_AT_AN_END: Final = 0.05  # closer to an end than this share of its distance, a fraction counts as being at its limit
_PLACES: Final = 9  # at which that error is computed
_LARGEST_SHIFT: Final = 0.3  # of a distance; the slope does not predict larger shifts
_FINE: Final = 10  # steps between two distances in the search for the focus
_FIELD_DISTANCES: Final = 5
_CLEARLY: Final = 0.15  # of the half width: above most tolerances
_MOST_ASKED: Final = 8  # distances of the study's questions at which linear propagation is compared with draws


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """The changes of a camera's results by a set of models, relative to the most complete models in closed form.

    Parameters
    ----------
    uncertainty
        Signed relative changes at the places of the variant.
    ends
        The largest relative shift of an end of a usable range; infinite where a range appears or vanishes.
    """

    uncertainty: FloatArray
    ends: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Compared:
    """A quantity with a limit, by the most complete models and by others, everywhere.

    Parameters
    ----------
    old, new
        Its values by either.
    bound
        Its largest allowed value; None if the study declares none.
    sets_end
        Which ends of usable ranges its limit sets.
    missed
        A further relative error of the new values, in either direction.
    """

    old: FloatArray
    new: FloatArray
    bound: float | None
    sets_end: BoolArray
    missed: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthVariant:
    """A camera under one reading or in one design.

    Parameters
    ----------
    camera
        The camera with the models that the study prescribes and all its calibration errors.
    criteria
        Criteria of its usable range.
    distance
        Some or all distances of the study [m], rising.
    asked
        Distances of the study's questions [m], whether or not the camera is usable there.
    forced
        Models that the study prescribes.
    fields
        Places of the picture at which depth is computed, besides the axis.
    error_sources
        The errors that answers include: ``both``, and ``calibration`` alone where a question names it.
    only_in
        The readings and inverse questions in which the variant occurs; empty if the study or a design has it.
    """

    camera: DepthCamera
    criteria: UsableCriteria
    distance: FloatArray
    asked: FloatArray
    forced: Models
    fields: tuple[FieldPosition, ...] = ()
    error_sources: tuple[str, ...] = ("both",)
    only_in: tuple[str, ...] = ()
    _errors_px: dict[PictureModels, FloatArray] = field(default_factory=dict, init=False)
    _half_widths: dict[tuple[bytes, bytes], FloatArray] = field(default_factory=dict, init=False)

    @cached_property
    def reference(self) -> DepthCamera:
        """The camera with the most complete models in closed form: Fresnel's transfer and linear propagation."""
        models = in_closed_form(self.forced)
        if models.get("calibration", "exact") == "exact" and has_covariance(self.camera):
            models["calibration"] = "linear"
        camera = apply_models(self.camera, models)
        law = camera.disparity_error_px
        if isinstance(law, PictureDisparityError):
            complete = with_models(complete_in_closed_form(camera, law), models)
            camera = replace(camera, disparity_error_px=replace(law, models=complete))
        return camera

    @property
    def law(self) -> PictureDisparityError | None:
        """The law of its disparity error where that is derived from the picture; None where it is declared."""
        law = self.reference.disparity_error_px
        return law if isinstance(law, PictureDisparityError) else None

    @property
    def _derived(self) -> PictureDisparityError:
        assert self.law is not None  # only used where the disparity error is derived
        return self.law

    @cached_property
    def limits(self) -> Mapping[str, Limit]:
        """The limits of the usable range, over the distances."""
        return evaluate_limits(self.reference, self.criteria, self.distance, depth=distribution)

    @cached_property
    def usable(self) -> BoolArray:
        """Whether the camera is usable, for each distance."""
        return all_met(self.limits, self.distance.shape)

    @cached_property
    def _boundaries(self) -> tuple[Boundary, ...]:
        return usable_ends(
            self.reference, self.criteria, self.distance, self.limits, to=_ENDS_ARE_KNOWN_TO, depth=distribution
        )

    @cached_property
    def ends(self) -> FloatArray:
        """Ends of the usable ranges within the study [m]."""
        return np.array([end.distance for end in self._boundaries])

    @cached_property
    def places(self) -> FloatArray:
        """Distances at which uncertainties are compared [m]: usable, sharpest, ends, and the study's questions.

        If the camera is usable nowhere, all distances with a picture count as usable.
        """
        counted = self.distance[self.usable] if self.usable.any() else self.distance
        places = np.unique(np.concatenate([counted, self.asked, self._sharpest, self.ends]))
        return places[self.reference.images(places)]

    @cached_property
    def _sharpest(self) -> FloatArray:
        """Usable distances of least blur [m], where pixels and diffraction matter most.

        If the camera is usable nowhere, all distances of least blur.
        """
        if self.law is None:
            return np.zeros(0)
        numbers = np.arange(self.distance.size)
        fine = np.interp(np.arange(0, self.distance.size - 1, 1.0 / _FINE), numbers, self.distance)
        fine = fine[self.reference.images(fine)]
        # Minima: infinite blur around the ends lets an end be one, and of equal neighbours the first is one.
        blur = np.pad(self.reference.picture_geometry(fine).blur_px, 1, constant_values=np.inf)
        sharpest = fine[(blur[1:-1] < blur[:-2]) & (blur[1:-1] <= blur[2:])]
        if not self.usable.any():
            return np.asarray(sharpest)
        ranges = usable_stretches(self._boundaries, self.distance, self.usable)
        inside = [(sharpest >= near) & (sharpest <= far) for near, far in ranges]
        return sharpest[np.any(inside, axis=0)] if inside else np.zeros(0)

    @cached_property
    def _everywhere(self) -> FloatArray:
        """`places`, all distances with a picture, and the ends with their neighbours, each once."""
        return self._at[0]

    @cached_property
    def _at(self) -> tuple[FloatArray, IndexArray]:
        """Every distance once, and the indices from which `_split` restores its three lists."""
        everywhere = np.concatenate([self.places, self._imaged, _beside(self.ends).ravel()])
        return np.unique(everywhere, return_inverse=True)

    @cached_property
    def _images(self) -> BoolArray:
        return self.reference.images(self.distance)

    @property
    def _imaged(self) -> FloatArray:
        return self.distance[self._images]

    def _split(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Split values everywhere into those at the places, over the distances, and around the ends (ends, 3)."""
        first, second = self.places.size, self.places.size + self._imaged.size
        spread = values[self._at[1]]
        return spread[:first], spread[first:second], spread[second:].reshape(-1, 3)

    @cached_property
    def _calibration_over_noise(self) -> FloatArray:
        """Standard deviation by calibration over that by noise, everywhere; 0 where it is unknown or left out."""
        if self.reference.propagation.model == OFF or not self.reference.calibration.groups:
            return np.zeros(self._everywhere.shape)
        if not has_covariance(self.reference):  # as for noise alone, which models move the most
            return np.zeros(self._everywhere.shape)
        noise, calibration = (
            linearised_depth(self.reference, self._everywhere, 0.0, error_source).standard_deviation
            for error_source in ("noise", "calibration")
        )
        return np.asarray(calibration / noise)

    @cached_property
    def _weighed(self) -> WeighedPicture:
        return self._derived.picture(self.reference, self._everywhere)

    def disparity_error_px(self, models: Models) -> FloatArray:
        """Lower bound of the disparity error everywhere [samples], with these models in closed form."""
        law = self._derived
        closed_form = _closed_form_of(law, models)
        if closed_form == law.models:  # cached by the law, since readings of depth at these places use it too
            return law.bound_px(self.reference, self._everywhere)
        if closed_form not in self._errors_px:
            self._errors_px[closed_form] = self._weighed.bound_px(closed_form)
        return self._errors_px[closed_form]

    def _factor(self, models: Models) -> FloatArray:
        """That bound over the reference's, everywhere; 1 where the error is declared or the lens forms no picture."""
        if self.law is None:
            return np.ones(self._everywhere.shape)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = self.disparity_error_px(models) / self.disparity_error_px({})
        return np.where(np.isnan(ratio), 1.0, ratio)

    def _half_width(self, factor: FloatArray, calibration_over_noise: FloatArray) -> FloatArray:
        """Half widths of depth everywhere, or radii about the truth if larger; kept, as many models give the same.

        `factor` multiplies the bound of the disparity error; `calibration_over_noise` is the standard deviation by
        calibration over that by noise.
        """
        key = factor.tobytes(), calibration_over_noise.tobytes()
        if key not in self._half_widths:
            # Models change the bound of the error; the error of a real matcher follows it only in part.
            noise = factor if self.law is None else self.law.matcher.change(self.disparity_error_px({}), factor)
            scale, false_matches = np.hypot(noise, calibration_over_noise), false_match_share(self.reference)
            scaled = scaled_noise(self.reference, self._everywhere, 0.0, scale, false_matches)
            self._half_widths[key] = scaled.judged
        return self._half_widths[key]

    @cached_property
    def _failed_at_most(self) -> float | None:
        """The largest allowed failed fraction, as a share of the true matches; None without such a limit."""
        bound = self.criteria.failed_fraction
        return None if bound is None else float(_of_true_matches(self.reference, bound))

    @cached_property
    def _failed(self) -> tuple[FloatArray, FloatArray]:
        """Failed fractions everywhere, by all errors and by noise alone."""
        without = apply_models(self.reference, {"calibration": OFF})
        return _failed_fraction(self.reference, self._everywhere), _failed_fraction(without, self._everywhere)

    @cached_property
    def _whole(self) -> FloatArray:
        """Half widths of the reference everywhere, by all errors."""
        return self._half_width(np.ones(self._everywhere.shape), self._calibration_over_noise)

    @cached_property
    def _by_noise(self) -> FloatArray:
        """Half widths of the reference everywhere, by noise alone."""
        return self._half_width(np.ones(self._everywhere.shape), np.zeros(self._everywhere.shape))

    def moved(self, models: Models, more_noise: float | FloatArray = 0.0, missed: float = 0.0) -> Moved:
        """The changes that a set of models makes.

        Parameters
        ----------
        models
            Models that replace the most complete ones.
        more_noise
            A further relative change of the disparity error's bound everywhere, in the direction that adds to theirs.
        missed
            A further relative error of the uncertainty, in either direction, which moves ends of usable ranges.
        """
        factor, calibration_off = self._factor(models), models.get("calibration") == OFF
        calibration_over_noise = np.zeros(factor.shape) if calibration_off else self._calibration_over_noise
        new = self._half_width(factor, calibration_over_noise)
        if np.any(more_noise):
            factor = factor * np.where(new >= self._whole, 1.0 + more_noise, 1.0 - np.asarray(more_noise))
            new = self._half_width(factor, calibration_over_noise)
        return Moved(
            uncertainty=self._split(_relative(new, self._whole))[0],
            ends=self._shift_of_ends(factor, new, missed, calibration_off=calibration_off),
        )

    def moved_noise(self, models: Models, more_noise: float | FloatArray = 0.0) -> FloatArray:
        """Signed relative change of the uncertainty by noise alone at the places; parameters as in `moved`."""
        factor, none = self._factor(models), np.zeros(self._everywhere.shape)
        factor = factor * np.where(factor >= 1.0, 1.0 + more_noise, 1.0 - np.asarray(more_noise))
        return self._split(_relative(self._half_width(factor, none), self._by_noise))[0]

    def _compared(
        self, factor: FloatArray, half_width: FloatArray, missed: float, *, calibration_off: bool
    ) -> dict[str, _Compared]:
        """The limits that a set of models can change, by name."""
        by_depth, by_matching = self._decided_by
        compared = {
            "relative_uncertainty": _Compared(
                old=self._whole / self._everywhere,
                new=half_width / self._everywhere,
                bound=self.criteria.relative_uncertainty,
                sets_end=by_depth,
                missed=missed,
            )
        }
        if self.law is not None:
            error = self.disparity_error_px({})
            with np.errstate(invalid="ignore"):  # 0 · ∞: without a picture, no model makes matching possible
                new = error * factor
            compared["matching"] = _Compared(old=error, new=new, bound=LARGEST_ERROR_PX, sets_end=by_matching)
        if calibration_off and (bound := self._failed_at_most) is not None:
            old, new = self._failed
            near = _near(self._split(old)[2][:, 1], bound, _SET_BY_FAILURES)
            compared["failed_fraction"] = _Compared(old=old, new=new, bound=bound, sets_end=near)
        return compared

    def _shift_of_ends(
        self, factor: FloatArray, half_width: FloatArray, missed: float, *, calibration_off: bool
    ) -> float:
        """The largest relative shift, to first order, of an end; infinite where a range appears or vanishes."""
        compared, largest = self._compared(factor, half_width, missed, calibration_off=calibration_off), 0.0
        for quantity in compared.values():
            with np.errstate(invalid="ignore", divide="ignore"):
                # An end moves until its limit is back at the bound: by the change over the slope, both logarithmic.
                by = np.abs(np.log(self._split(quantity.new / quantity.old)[2][:, 1])) + np.log1p(quantity.missed)
                shifts = np.where(
                    quantity.sets_end & (by != 0.0), by / np.abs(_slope(self._split(quantity.old)[2])), 0.0
                )
            largest = max(largest, float(np.max(np.where(np.isnan(shifts), np.inf, shifts), initial=0.0)))
        return np.inf if largest > _LARGEST_SHIFT or self._range_appears_or_vanishes(compared, largest) else largest

    def _range_appears_or_vanishes(self, compared: Mapping[str, _Compared], shift: float) -> bool:
        """Whether the verdict on a limit changes anywhere but next to an end."""
        changed = np.zeros(self._imaged.shape, dtype=bool)
        for quantity in compared.values():
            old, new = self._split(quantity.old)[1], self._split(quantity.new)[1]
            for value in (new * (1.0 + quantity.missed), new / (1.0 + quantity.missed)):
                changed |= False if quantity.bound is None else (value <= quantity.bound) != (old <= quantity.bound)
        others = {name: limit for name, limit in self.limits.items() if name not in ("matching", *compared)}
        # Other limits must be met, too; and a verdict that changes beside an end only tells that this end moves.
        could_be = all_met(others, self.distance.shape)[self._images]
        return bool(np.any(changed & could_be & self._apart(2.0 * (shift + _ENDS_ARE_KNOWN_TO))))

    def _apart(self, share: float) -> BoolArray:
        """Which distances with a picture are farther from every end than a share of its distance."""
        return np.asarray(np.all(np.abs(np.log(self._imaged[:, np.newaxis] / self.ends)) > share, axis=1))

    @cached_property
    def _decided_by(self) -> tuple[BoolArray, BoolArray]:
        """The ends that the depth uncertainty sets, and those that the matcher sets."""
        if not self.ends.size:
            return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
        limits = evaluate_limits(self.reference, self.criteria, self.ends, depth=distribution)

        def near(name: str, share: float) -> BoolArray:
            if (limit := limits.get(name)) is None:
                return np.zeros(self.ends.shape, dtype=bool)
            value, bound = limit.value, limit.bound
            if name == "failed_fraction":
                value, bound = _of_true_matches(self.reference, value), float(_of_true_matches(self.reference, bound))
            return _near(value, bound, share)

        by_depth = near("relative_uncertainty", _NEAR_ITS_BOUND) | near("failed_fraction", _NEAR_A_STEEP_BOUND)
        return by_depth, near("matching", _NEAR_ITS_BOUND)

    @cached_property
    def by_exact_paths(self) -> tuple[FloatArray, FloatArray]:
        """Relative change of Fresnel's disparity error by Kirchhoff's paths at either lens, by a rule with a margin."""
        from tradestudy.models.light_spot import change_by_exact_paths  # imported here: few studies simulate light

        geometry, law = self.reference.picture_geometry(self._everywhere), self._derived
        return change_by_exact_paths(geometry, law.settings, law.models, self.disparity_error_px)

    @cached_property
    def noise_share(self) -> FloatArray:
        """Share of the noise in the variance everywhere."""
        return np.asarray(1.0 / (1.0 + self._calibration_over_noise**2))

    def tried_by_exact_paths(self) -> tuple[float, float]:
        """The largest relative changes of disparity error and uncertainty by Kirchhoff's transfer, at a few places."""
        from tradestudy.models.light_spot import places_to_try, tried_change  # as above

        law = self._derived
        by_rule, share = (self._split(values)[0] for values in (np.sum(self.by_exact_paths, axis=0), self.noise_share))
        tried = places_to_try(by_rule * share, self.reference.picture_geometry(self.places).blur_px)
        geometry = self.reference.picture_geometry(self.places[tried])
        change = np.nan_to_num(tried_change(geometry, law.settings, law.models))
        return float(np.max(change)), float(np.max(change * share[tried]))

    def linear_error(self) -> tuple[float, float]:
        """The largest error of linear propagation against the exact distribution, and its distance [m].

        Compared at both ends and in the middle of the usable distances, at the largest relative uncertainty, and at
        distances of the study's questions; infinite where linear propagation is impossible.
        """
        if not has_covariance(self.camera):
            return np.inf, np.nan
        camera, places = apply_models(self.reference, {"calibration": "linear"}), self.distance[self.usable]
        asked = self.asked[camera.images(self.asked)]
        sample = np.linspace(0, max(0, asked.size - 1), _MOST_ASKED).round().astype(int)  # including the farthest
        tried = asked[np.unique(sample)] if asked.size else asked
        if places.size:
            whole = self._split(self._whole)[1] / self._imaged
            relative = np.where(self.usable[self._images] & np.isfinite(whole), whole, 0.0)
            tried = np.concatenate([tried, places[[0, places.size // 2, -1]], self._imaged[[int(np.argmax(relative))]]])
        if not tried.size:
            return 0.0, np.nan
        tried = np.unique(tried)
        errors = [self._linear_error_at(camera, tried, place) for place in (0.0, *self.fields)]
        error = np.max(errors, axis=0)
        largest, at = float(error.max()), float(tried[int(np.argmax(error))])
        # Ends set by failures take more draws, which are wasted where linear propagation clearly fails already.
        if (bound := self._failed_at_most) is not None and not largest > _CLEARLY:
            largest = max(largest, self._missed_by_the_line(camera, bound))
        return largest, at

    def _missed_by_the_line(self, camera: DepthCamera, bound: float) -> float:
        """The largest relative shift that the error of linear propagation causes in an end set by the failed fraction.

        Infinite where that error leaves open whether the limit is met.
        """

        def error(places: FloatArray) -> FloatArray:
            return np.asarray(model_error(camera, places).failed_fraction / (1.0 - false_match_share(camera)))

        failed = _of_true_matches(camera, self.limits["failed_fraction"].value[self._images])
        close = np.flatnonzero(self._apart(_AT_AN_END) & (failed > bound / _FAR) & (failed < bound * _FAR))
        if close.size:
            close = close[np.unique(np.linspace(0, close.size - 1, _PLACES).round().astype(int))]
            missed = error(self._imaged[close])
            if np.any((missed > 0.0) & (np.abs(failed[close] - bound) <= missed)):
                return np.inf
        if not self.ends.size:
            return 0.0
        fractions = _failed_fraction(camera, _beside(self.ends).ravel()).reshape(-1, 3)
        near = _near(fractions[:, 1], bound, _SET_BY_FAILURES)
        if not near.any():
            return 0.0
        slope = np.abs(_slope(fractions[near]))
        shift = np.log1p(np.nan_to_num(error(self.ends[near])) / fractions[near, 1])
        # Where the fraction does not change along the distance, nothing limits the shift.
        return float(np.max(shift / np.where(np.isfinite(slope) & (slope > 0.0), slope, _TINY)))

    def _linear_error_at(self, camera: DepthCamera, tried: FloatArray, field: FieldPosition) -> FloatArray:
        """The error at a place in the field; 0 where nothing is measured, infinite where it cannot be determined."""
        error = np.zeros(tried.shape) if all_normal(camera) else clear_departure(camera, tried, field)
        if not np.any(error > _CLEARLY):  # otherwise linear propagation fails clearly, and draws would add nothing
            error = np.fmax.reduce(
                [model_error(camera, tried, error_source, field).intervals for error_source in self.error_sources]
            )
        measured = ~np.isnan(distribution(camera, tried, "both", field).half_width)
        return np.where(measured, np.where(np.isnan(error), np.inf, error), 0.0)

    def moved_of_field(self, models: Models) -> float:
        """The largest relative change of the uncertainty at the places in the field that the study declares.

        To first order: there is less light off the axis, and calibration errors act differently.
        """
        largest = 0.0
        for place, noise, total in self._off_axis:
            moved = noise * self._noise_changed(place, models)
            with np.errstate(invalid="ignore", divide="ignore"):
                by_calibration = 0.0 if models.get("calibration") == OFF else np.maximum(total**2 - noise**2, 0.0)
                change = np.abs(np.sqrt(moved**2 + by_calibration) / total - 1.0)
            largest = max(largest, float(np.nanmax(change, initial=0.0)))
        return largest

    @cached_property
    def _few_places(self) -> FloatArray:
        sample = np.unique(np.linspace(0, self.places.size - 1, _FIELD_DISTANCES).astype(int))
        return np.asarray(self.places[sample])

    @cached_property
    def _off_axis(self) -> list[tuple[FieldPosition, FloatArray, FloatArray]]:
        """Each place in the field, with standard deviations by noise and by all errors at a few distances."""
        camera, places = self.reference, self._few_places
        whole = "both" if has_covariance(camera) else "noise"  # noise depends most on models
        return [
            (
                place,
                linearised_depth(camera, places, place, "noise").standard_deviation,
                linearised_depth(camera, places, place, whole).standard_deviation,
            )
            for place in self.fields
        ]

    def _noise_changed(self, field: FieldPosition, models: Models) -> FloatArray:
        """The factor by which noise changes; 1 where the disparity error is declared or the lens forms no picture."""
        if self.law is None:
            return np.ones(self._few_places.shape)
        law = self.law.at_field(self.reference, self.reference.field_share(field))
        bound = law.bound_px(self.reference, self._few_places)
        other = replace(law, models=_closed_form_of(law, models)).bound_px(self.reference, self._few_places)
        with np.errstate(invalid="ignore", divide="ignore"):
            factor = other / bound
        return law.matcher.change(bound, np.where(np.isnan(factor), 1.0, factor))


def _closed_form_of(law: PictureDisparityError, models: Models) -> PictureModels:
    """A law's models, overridden by the closed form of `models` for the effects of the law's picture."""
    closed_form = with_models(law.models, in_closed_form(models))
    # The models are those of all forms of the camera, of which others may have a spectrum.
    return closed_form if law.settings.spectrum else replace(closed_form, spectrum=OFF)


def _of_true_matches(camera: DepthCamera, failed: ArrayLike) -> FloatArray:
    """A failed fraction, or its bound, as a share of the true matches; negative where false matches alone exceed it."""
    share = false_match_share(camera)
    return np.asarray((np.asarray(failed) - share) / (1.0 - share))


def _failed_fraction(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """Share of true matches with a depth beyond infinity, by the camera's model of propagation."""
    return _of_true_matches(camera, distribution(camera, imaged(camera, distance), "both").failed_fraction)


def _near(value: FloatArray, bound: float, share: float) -> BoolArray:
    """Where a value is as near to its bound, in the logarithm, as a share; a bound of 0 is never near."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.abs(np.log(value / bound)) < share)


def _beside(ends: FloatArray) -> FloatArray:
    """Distances [m] just before, at and just beyond each end, shape (ends, 3)."""
    return np.asarray(ends[:, np.newaxis] * (1.0 + _BESIDE_AN_END * np.array([-1.0, 0.0, 1.0])))


def _slope(values: FloatArray) -> FloatArray:
    """Slope d ln(value)/d ln(distance) at the ends, from values at `_beside`."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.log(values[:, 2] / values[:, 0]) / (2.0 * _BESIDE_AN_END))


def _relative(new: FloatArray, old: FloatArray) -> FloatArray:
    """Signed relative change; 0 where both are infinite or one is unknown, infinite where only one is infinite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        change = new / old - 1.0
    change = np.where(np.isinf(new) & np.isinf(old), 0.0, change)
    change = np.where(np.isinf(old) & np.isfinite(new), np.inf, change)
    return np.where(np.isnan(change), 0.0, change)
