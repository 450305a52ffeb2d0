"""One camera in one reading or design of a study: what its models change, at the distances that matter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.cameras.depth_camera import DepthCamera, Limit, UsableCriteria, false_match_share
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.depth.evaluation import clear_departure, distribution, model_error
from tradestudy.depth.linear import all_normal, has_covariance, linearised_depth, scaled_noise
from tradestudy.depth.usable import Boundary, all_met, evaluate_limits, usable_ends, usable_stretches
from tradestudy.effects import OFF, Models
from tradestudy.imaging.models import PictureModels
from tradestudy.imaging.picture import LARGEST_ERROR_PX, PictureDisparityError, WeighedPicture
from tradestudy.models.off_axis import OffAxis, closed_form_of
from tradestudy.models.variants import (
    missed_by_the_line,
    of_true_matches,
    shift_without_calibration,
    verdict_changed_without_calibration,
)
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray
from tradestudy.study.building import apply_models, complete_in_closed_form, in_closed_form, with_models

_ENDS_ARE_KNOWN_TO: Final = 1e-3  # of their distance: at 1e-2, a steep limit would seem not to decide its end
_BESIDE_AN_END: Final = 1e-2  # of its distance, for that slope
_NEAR_ITS_BOUND: Final = 0.1  # of the bound: a limit whose value is this near decides an end
_NEAR_A_STEEP_BOUND: Final = 2.0  # the same for a failed fraction, which can be several times its bound 1 % farther
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
        found = self.reference.disparity_error_px
        return found if isinstance(found, PictureDisparityError) else None

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
        beside = self.ends[:, np.newaxis] * (1.0 + _BESIDE_AN_END * np.array([-1.0, 0.0, 1.0]))
        return np.unique(np.concatenate([self.places, self._imaged, beside.ravel()]), return_inverse=True)

    @cached_property
    def _imaged(self) -> FloatArray:
        return self.distance[self.reference.images(self.distance)]

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
        law = self.law
        assert law is not None  # only used where the disparity error is derived
        return law.picture(self.reference, self._everywhere)

    def disparity_error_px(self, models: Models) -> FloatArray:
        """Lower bound of the disparity error everywhere [samples], with these models in closed form."""
        law = self.law
        assert law is not None  # as above
        own = closed_form_of(law, models)
        if own == law.models:  # cached by the law, since readings of depth at these places use it too
            return law.bound_px(self.reference, self._everywhere)
        if own not in self._errors_px:
            self._errors_px[own] = self._weighed.bound_px(own)
        return self._errors_px[own]

    def _factor(self, models: Models) -> FloatArray:
        """That bound over the reference's, everywhere; 1 where the error is declared or the lens forms no picture."""
        if self.law is None:
            return np.ones(self._everywhere.shape)
        with np.errstate(invalid="ignore", divide="ignore"):
            found = self.disparity_error_px(models) / self.disparity_error_px({})
        return np.where(np.isnan(found), 1.0, found)

    def _half_width(self, factor: FloatArray, beside: FloatArray) -> FloatArray:
        """Half widths of depth everywhere, or radii about the truth if larger; kept, as many models give the same.

        `factor` multiplies the bound of the disparity error; `beside` is the standard deviation by calibration over
        that by noise.
        """
        key = factor.tobytes(), beside.tobytes()
        if key not in self._half_widths:
            self._half_widths[key] = self._new_half_width(factor, beside)
        return self._half_widths[key]

    def _new_half_width(self, factor: FloatArray, beside: FloatArray) -> FloatArray:
        noise = factor if self.law is None else self.law.matcher.change(self.disparity_error_px({}), factor)
        scale, false_matches = np.hypot(noise, beside), false_match_share(self.reference)
        return scaled_noise(self.reference, self._everywhere, 0.0, scale, false_matches).judged

    @cached_property
    def _failed_at_most(self) -> float | None:
        """The largest allowed failed fraction, as a share of the true matches; None without such a limit."""
        bound = self.criteria.failed_fraction
        return None if bound is None else float(of_true_matches(self.reference, bound))

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
        factor, off = self._factor(models), models.get("calibration") == OFF
        beside = np.zeros(factor.shape) if off else self._calibration_over_noise
        new = self._half_width(factor, beside)
        if np.any(more_noise):
            factor = factor * np.where(new >= self._whole, 1.0 + more_noise, 1.0 - np.asarray(more_noise))
            new = self._half_width(factor, beside)
        return Moved(
            uncertainty=self._split(_relative(new, self._whole))[0],
            ends=self._shift_of_ends(factor, new, missed, off=off),
        )

    def moved_noise(self, models: Models, more_noise: float | FloatArray = 0.0) -> FloatArray:
        """Signed relative change of the uncertainty by noise alone at the places; parameters as in `moved`."""
        factor, none = self._factor(models), np.zeros(self._everywhere.shape)
        factor = factor * np.where(factor >= 1.0, 1.0 + more_noise, 1.0 - np.asarray(more_noise))
        return self._split(_relative(self._half_width(factor, none), self._by_noise))[0]

    def _shift_of_ends(self, factor: FloatArray, half_width: FloatArray, missed: float, *, off: bool) -> float:
        """The largest relative shift, to first order, of an end that the depth uncertainty or the matcher sets."""
        by_depth, by_matching = self._decided_by
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = half_width / self._whole
            by = np.abs(np.log(self._split(ratio)[2][:, 1])) + np.log1p(missed)
            of_depth = by / self._slope(self._whole / self._everywhere)
            shifts = np.where(by_depth, np.abs(of_depth), 0.0)
            if self.law is not None:
                of_matching = np.log(self._split(factor)[2][:, 1]) / self._slope(self.disparity_error_px({}))
                shifts = np.maximum(shifts, np.where(by_matching, np.abs(of_matching), 0.0))
        largest = float(np.max(np.where(np.isnan(shifts), np.inf, shifts), initial=0.0))
        if off and (bound := self._failed_at_most) is not None and self.ends.size:
            largest = max(largest, shift_without_calibration(self.reference, bound, self.ends))
        either = (half_width * (1.0 + missed), half_width / (1.0 + missed))
        anew = any(self._range_appears_or_vanishes(factor, one, largest, off=off) for one in either)
        return np.inf if largest > _LARGEST_SHIFT or anew else largest

    def _slope(self, values: FloatArray) -> FloatArray:
        """Slope d ln(value)/d ln(distance) at the ends."""
        beside = np.log(self._split(values)[2])
        return np.asarray((beside[:, 2] - beside[:, 0]) / (2.0 * _BESIDE_AN_END))

    @cached_property
    def _decided_by(self) -> tuple[BoolArray, BoolArray]:
        """The ends that the depth uncertainty sets, and those that the matcher sets."""
        if not self.ends.size:
            return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
        limits = evaluate_limits(self.reference, self.criteria, self.ends, depth=distribution)

        def near(name: str, share: float) -> BoolArray:
            limit = limits.get(name)
            if limit is None:
                return np.zeros(self.ends.shape, dtype=bool)
            value, bound = limit.value, np.asarray(limit.bound)
            if name == "failed_fraction":
                value, bound = (of_true_matches(self.reference, one) for one in (value, bound))
            with np.errstate(invalid="ignore", divide="ignore"):
                return np.asarray(np.abs(np.log(value / bound)) < share)

        by_depth = near("relative_uncertainty", _NEAR_ITS_BOUND) | near("failed_fraction", _NEAR_A_STEEP_BOUND)
        return by_depth, near("matching", _NEAR_ITS_BOUND)

    def _range_appears_or_vanishes(
        self, factor: FloatArray, half_width: FloatArray, shift: float, *, off: bool
    ) -> bool:
        """Whether the verdict on a limit changes anywhere but next to an end."""
        changed = np.zeros(self._imaged.shape, dtype=bool)
        bound = self.criteria.relative_uncertainty
        if bound is not None:
            new, old = (self._split(width)[1] / self._imaged <= bound for width in (half_width, self._whole))
            changed |= new != old
        if self.law is not None:
            error = self.disparity_error_px({})
            with np.errstate(invalid="ignore"):  # 0 · ∞: without a picture, no model makes matching possible
                new, old = (self._split(one)[1] <= LARGEST_ERROR_PX for one in (error * factor, error))
            changed |= new != old
        compared = ["relative_uncertainty", "matching"]
        if off and (bound := self._failed_at_most) is not None:
            changed |= verdict_changed_without_calibration(self.reference, bound, self._imaged)
            compared.append("failed_fraction")
        others = {name: one for name, one in self.limits.items() if name not in compared}
        could_be = all_met(others, self.distance.shape)[self.reference.images(self.distance)]
        for end in self.ends:
            changed &= np.abs(np.log(self._imaged / end)) > 2.0 * (shift + _ENDS_ARE_KNOWN_TO)
        return bool(np.any(changed & could_be))

    @cached_property
    def by_exact_paths(self) -> tuple[FloatArray, FloatArray]:
        """Relative change of Fresnel's disparity error by Kirchhoff's paths at either lens, by a rule with a margin."""
        from tradestudy.models.light_spot import change_by_exact_paths  # imported here: few studies simulate light

        law = self.law
        assert law is not None  # as above
        return change_by_exact_paths(
            self.reference.picture_geometry(self._everywhere), law.settings, law.models, self.disparity_error_px
        )

    @cached_property
    def noise_share(self) -> FloatArray:
        """Share of the noise in the variance everywhere."""
        return np.asarray(1.0 / (1.0 + self._calibration_over_noise**2))

    def tried_by_exact_paths(self) -> tuple[float, float]:
        """The largest relative changes of disparity error and uncertainty by Kirchhoff's transfer, at a few places."""
        from tradestudy.models.light_spot import places_to_try, tried_change  # as above

        law = self.law
        assert law is not None  # as above
        by_rule, share = (self._split(one)[0] for one in (np.sum(self.by_exact_paths, axis=0), self.noise_share))
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
        some = np.linspace(0, max(0, asked.size - 1), _MOST_ASKED).round().astype(int)  # including the farthest
        tried = asked[np.unique(some)] if asked.size else asked
        if places.size:
            whole = self._split(self._whole)[1] / self._imaged
            relative = np.where(self.usable[self.reference.images(self.distance)] & np.isfinite(whole), whole, 0.0)
            tried = np.concatenate([tried, places[[0, places.size // 2, -1]], self._imaged[[int(np.argmax(relative))]]])
        if not tried.size:
            return 0.0, np.nan
        tried = np.unique(tried)
        found = [self._linear_error_at(camera, tried, place) for place in (0.0, *self.fields)]
        error = np.max(found, axis=0)
        largest, at = float(error.max()), float(tried[int(np.argmax(error))])
        if (bound := self._failed_at_most) is not None and not largest > _CLEARLY:
            failed = self.limits["failed_fraction"].value[self.reference.images(self.distance)]
            failed = of_true_matches(camera, failed)
            largest = max(largest, missed_by_the_line(camera, bound, self._imaged, failed, self.ends))
        return largest, at

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
        """The largest relative change of the uncertainty at the places in the field that the study declares."""
        return max((place.moved(models) for place in self._off_axis), default=0.0)

    @cached_property
    def _off_axis(self) -> tuple[OffAxis, ...]:
        some = self.places[np.unique(np.linspace(0, self.places.size - 1, _FIELD_DISTANCES).astype(int))]
        return tuple(OffAxis(reference=self.reference, places=some, field=field) for field in self.fields)


def _relative(new: FloatArray, old: FloatArray) -> FloatArray:
    """Signed relative change; 0 where both are infinite or one is unknown, infinite where only one is infinite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        found = new / old - 1.0
    found = np.where(np.isinf(new) & np.isinf(old), 0.0, found)
    found = np.where(np.isinf(old) & np.isfinite(new), np.inf, found)
    return np.where(np.isnan(found), 0.0, found)
