"""Depth uncertainty: what every way of propagating errors costs, and how far it is from a code of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.analysis.depth import depth_uncertainty
from tradestudy.analysis.depth_draws import outcome_model, uncertain_sources
from tradestudy.analysis.usable import all_met, evaluate_limits
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cost.depth_reference import ENDS, SUPERSCRIPTS, DepthCase, reference_of
from tradestudy.cost.entries import NOWHERE_USABLE, PLAIN, SOBOL, CostTable, Entry, gain, nothing_measured
from tradestudy.cost.interval_quadrature import half_width_by_quadrature
from tradestudy.cost.measuring import MOST_PLACES, Allowance, Timed, entry_of, measure
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.execution.steps import Progress
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import StudyDefinition
from tradestudy.uncertainty.linear import linear
from tradestudy.uncertainty.monte_carlo import FEWEST_REPLICATES, Sampling, propagate
from tradestudy.uncertainty.streams import Sampler, plain_random, scrambled_sobol
from tradestudy.units import FRACTION, LENGTH, pretty

_SAMPLERS: Final[Mapping[str, Sampler]] = {SOBOL: scrambled_sobol, PLAIN: plain_random}
_POWERS: Final = range(9, 20, 2)
_MOST_POWER: Final = {SOBOL: 17, PLAIN: 19}
_REFERENCE_SHARE: Final = 0.4  # of the time allowed
LINEAR, INVERSE, QUADRATURE = "linear in depth", "linear in inverse depth", "quadrature"
NOISE_ALONE, MIXED = "noise alone, exactly", "what acts in each camera"
_NODES: Final = {1: "steepest direction alone", 3: "3 nodes per dimension", 5: "5 nodes per dimension"}
_ORDER: Final = (LINEAR, INVERSE, NOISE_ALONE, MIXED, QUADRATURE, SOBOL, PLAIN)
_WAYS: Final[Mapping[str, str]] = {
    INVERSE: "effects.calibration: linear",
    SOBOL: "effects.calibration: exact; accuracy.depth_uncertainty says how many draws, propagation.max_draws bounds "
    "them",
    NOISE_ALONE: "effects.calibration: off, or a camera without calibration errors",
    MIXED: "accuracy.depth_uncertainty, by which the cheapest of them is chosen for each camera",
}
_WHICH_IS_LINEAR: Final = (
    f"What the table of effects calls calibration: linear is {INVERSE}: the covariance of all errors through the "
    "Jacobian of the exact reading, the ends of the interval mapped back to depth. What it calls calibration: exact "
    f"are {SOBOL} draws through the exact reading."
)
_PICTURES: Final = (
    "What it takes to derive disparity errors from pictures is measured by itself, below; here they are known."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """The way that a run takes: model and setting in words, and half-widths [m] at all places by a seed."""

    model: str
    setting: str
    compute: Callable[[int], FloatArray]


def depth_cost(definition: StudyDefinition, allowance: Allowance, progress: Progress) -> CostTable:
    """Cost of the depth uncertainty of the study's cameras, noise and calibration, on the axis.

    Parameters
    ----------
    definition
        The study as planned, its calibrations inferred.
    allowance
        Time and repeats.
    progress
        Called with the step and the share done.

    Returns
    -------
    CostTable
        Cameras that are usable nowhere are left out and named.
    """
    cameras = definition.case.cameras
    titles = {name: definition.file.cameras[name].title for name in cameras}
    places = {name: usable_places(definition, camera) for name, camera in cameras.items()}
    usable = {name: _with_known_errors(cameras[name], places[name]) for name in cameras if places[name].size}
    says = (
        "Half the central 68.27 % interval of depth of "
        f"{'; '.join(titles[name] for name in usable or cameras)} at up to {MOST_PLACES} "
        "distances each where they are usable: seconds for all of them together, relative error at the worst."
    )
    name, title = "depth_uncertainty", "Depth uncertainty"
    if not usable:
        return nothing_measured(name, title, says, NOWHERE_USABLE)
    cases = [
        DepthCase(
            name=one,
            title=titles[one],
            model=outcome_model(camera, places[one], way=_way(camera)),
            sources=uncertain_sources(camera, _way(camera)),
            distance=places[one],
        )
        for one, camera in usable.items()
    ]
    measured = propagation_cost(
        cases,
        allowance,
        progress,
        name=name,
        title=title,
        says=says,
        taken=_taken(usable, cases),
        asked=definition.file.accuracy.wanted().relative["depth_uncertainty"],
    )
    derived = any(isinstance(one.disparity_error_px, PictureDisparityError) for one in cameras.values())
    unusable = tuple(f"{titles[one]}: usable at no distance of the study" for one in cameras if one not in usable)
    return replace(
        measured,
        left_out=(*unusable, *measured.left_out),
        notes=(_WHICH_IS_LINEAR, *([_PICTURES] * derived), *measured.notes) if measured.entries else measured.notes,
        ways=_WAYS,
    )


def _way(camera: DepthCamera) -> str:
    """Which errors act in a camera."""
    return "noise" if camera.propagation.model == "off" else "both"


def _taken(cameras: Mapping[str, DepthCamera], cases: Sequence[DepthCase]) -> Taken:
    """What the models that were chosen make of these cameras; which is which where they differ."""
    models = {
        case.title: NOISE_ALONE
        if not camera.calibration.groups
        else {"off": NOISE_ALONE, "linear": INVERSE, "exact": SOBOL}[camera.propagation.model]
        for case, camera in zip(cases, cameras.values(), strict=True)
    }
    different = dict.fromkeys(models.values())

    def compute(run: int) -> FloatArray:
        return _joined(
            depth_uncertainty(replace(camera, propagation=replace(camera.propagation, seed=run)), case.distance)
            for case, camera in zip(cases, cameras.values(), strict=True)
        )

    if len(different) > 1:
        named = {model: ", ".join(title for title, own in models.items() if own == model) for model in different}
        return Taken(model=MIXED, setting="; ".join(f"{model}: {who}" for model, who in named.items()), compute=compute)
    (model,) = different
    tolerance = next(iter(cameras.values())).propagation.tolerance
    return Taken(model=model, setting=f"until {100.0 * tolerance:g} %" if model == SOBOL else "", compute=compute)


def propagation_cost(
    cases: Sequence[DepthCase],
    allowance: Allowance,
    progress: Progress,
    *,
    name: str,
    title: str,
    says: str,
    taken: Taken,
    asked: float = math.nan,
    most_draws: int = 2**19,
) -> CostTable:
    """Measure every way of propagation.

    Parameters
    ----------
    cases
        Cameras with their errors.
    allowance
        Time and repeats.
    progress
        Called with the step and the share done.
    name, title, says
        Of the quantity.
    taken
        What the study's run takes.
    asked
        Relative error that the study asks for; NaN where it asks for none.
    most_draws
        Of any way; the reference takes at most eight times as many.
    """
    progress(f"cost: {name}", 0.0)

    def alive() -> None:
        progress(f"cost: {name}", min(1.0 - allowance.left / allowance.seconds, _REFERENCE_SHARE))

    try:
        found = reference_of(cases, allowance.share(_REFERENCE_SHARE), most_draws, alive)
    except UnaffordableError as error:
        progress(f"cost: {name}", 1.0)
        return nothing_measured(name, title, says, f"everything: no time left: {error}")
    reference, reference_error = found.half_width, found.relative_error
    progress(f"cost: {name}", _REFERENCE_SHARE)
    entries: list[Entry] = []
    left_out: list[str] = []
    notes: list[str] = []
    if endless := int(np.count_nonzero(np.isnan(reference))):
        left_out.append(f"{endless} of {reference.size} places: the interval there has no far end by the reference")
    if endless == reference.size:
        return CostTable(
            name=name,
            title=title,
            says=says,
            reference=found.words,
            reference_error=reference_error,
            reference_seconds=found.seconds,
            entries=(),
            left_out=tuple(left_out),
        )
    timed = measure(taken.compute, allowance)
    entries.append(_entry(taken.model, taken.setting, math.nan, timed, reference, chosen=True))
    notes.append(_where_worst(cases, ", ".join(filter(None, (taken.model, taken.setting))), timed, reference))
    for model, compute in _analytic(cases):
        if model == taken.model:
            continue
        try:
            timed = measure(compute, allowance)
        except OutOfRangeError as error:
            left_out.append(f"{model}: {error}")
            continue
        evaluations = sum(2 * case.sources.dimensions + 1 for case in cases)
        entries.append(_entry(model, "", evaluations, timed, reference))
    took_last = 0.0
    for nodes, setting in _NODES.items():
        # The nodes of up to five dimensions grow by less than a hundredfold from one setting to the next.
        if not allowance.allows(2.0 * took_last):
            left_out.append(f"{QUADRATURE}, {setting}: {allowance.lacking(2.0 * took_last)}")
            continue
        try:
            timed = measure(
                lambda _run, nodes=nodes: _joined(  # type: ignore[misc]  # bound at once
                    half_width_by_quadrature(case.model, case.sources, ENDS, nodes) for case in cases
                ),
                allowance,
            )
        except OutOfRangeError as error:
            left_out.append(f"{QUADRATURE}: {error}")
            break
        took_last = timed.seconds
        entries.append(_entry(QUADRATURE, setting, math.nan, timed, reference))
        if entries[-1].error <= 2.0 * reference_error:  # finer ones are as good as can be told
            break
    took = dict.fromkeys(_SAMPLERS, 0.0)
    runs = [
        (model, 2**power)
        for power in _POWERS
        for model in _SAMPLERS
        if power <= _MOST_POWER[model] and 2**power <= most_draws
    ]
    for number, (model, draws) in enumerate(runs):
        # Four times the draws take four times as long, with one run for the memory, and at least one for the time.
        setting, predicted = f"2{str(draws.bit_length() - 1).translate(SUPERSCRIPTS)} draws", 8.0 * took[model]
        if not allowance.allows(predicted):
            left_out.append(f"{model}, {setting}: {allowance.lacking(predicted)}")
            continue
        timed = measure(partial(_sampled, cases, fixed_sampling(_SAMPLERS[model], draws)), allowance)
        entries.append(_entry(model, setting, draws, timed, reference))
        took[model] = timed.seconds
        progress(f"cost: {name}", _REFERENCE_SHARE + (1.0 - _REFERENCE_SHARE) * number / len(runs))
    progress(f"cost: {name}", 1.0)
    return CostTable(
        name=name,
        title=title,
        says=says,
        reference=found.words,
        reference_error=reference_error,
        reference_seconds=found.seconds,
        entries=tuple(sorted(entries, key=lambda entry: (_ORDER.index(entry.model), math.isnan(entry.evaluations)))),
        left_out=tuple(left_out),
        notes=(*notes, *gain(entries, reference_error)),
        asked=asked,
    )


def usable_places(definition: StudyDefinition, camera: DepthCamera) -> FloatArray:
    """Some of the study's distances where the camera is usable and its uncertainty finite."""
    case = definition.case
    usable = all_met(evaluate_limits(camera, case.criteria, case.distance), case.distance.shape)
    places = case.distance[usable & np.isfinite(depth_uncertainty(camera, case.distance))]
    if places.size == 0:
        return places
    wanted = np.geomspace(places[0], places[-1], MOST_PLACES)
    return np.asarray(places[np.unique(np.abs(places[:, None] - wanted).argmin(axis=0))])


@dataclass(frozen=True, kw_only=True)
class _KnownDisparityError(PictureDisparityError):
    """Errors that a picture has at some distances, so that no way of propagation is charged with deriving them."""

    distance: tuple[float, ...]
    known_px: tuple[float, ...]

    def error_px(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:  # noqa: ARG002  # known of one camera
        """At those distances."""
        return np.interp(np.asarray(distance, dtype=np.float64), self.distance, self.known_px)


def _with_known_errors(camera: DepthCamera, distance: FloatArray) -> DepthCamera:
    """The camera, at some distances, without the picture that its disparity error is derived from."""
    law = camera.disparity_error_px
    if not isinstance(law, PictureDisparityError):
        return camera
    places = np.union1d(distance, camera.propagation.judged)
    found = law.error_px(camera, places)
    known = _KnownDisparityError(
        settings=law.settings, models=law.models, distance=tuple(places.tolist()), known_px=tuple(found.tolist())
    )
    return replace(camera, disparity_error_px=known)


def _analytic(cases: Sequence[DepthCase]) -> Iterator[tuple[str, Callable[[int], FloatArray]]]:
    def mapped(case: DepthCase) -> FloatArray:
        low, high = linear(case.model, case.sources, inverse_depth=True).mapped_quantiles(ENDS)
        return np.asarray((high - low) / 2.0)

    yield (
        LINEAR,
        lambda _run: _joined(
            linear(case.model, case.sources, inverse_depth=True).standard_uncertainty for case in cases
        ),
    )
    yield INVERSE, lambda _run: _joined(mapped(case) for case in cases)


def _joined(parts: Iterator[FloatArray]) -> FloatArray:
    return np.concatenate(list(parts))


def fixed_sampling(sampler: Sampler, draws: int) -> Sampling:
    """So many draws over all replicates, whatever the error."""
    return Sampling(
        absolute_tolerance=0.0,
        relative_tolerance=0.0,
        budget_draws=draws,
        first_draws=draws // FEWEST_REPLICATES,
        batch_draws=2**13,
        sampler=sampler,
    )


def _sampled(cases: Sequence[DepthCase], sampling: Sampling, run: int) -> FloatArray:
    return _joined(
        propagate(
            case.model, case.sources, sampling, seed=run, point=f"cost/{case.name}", inverse_depth=True
        ).half_width
        for case in cases
    )


def _entry(
    model: str,
    setting: str,
    evaluations: float,
    timed: Timed[FloatArray],
    reference: FloatArray,
    *,
    chosen: bool = False,
) -> Entry:
    """The worst and the median error over places with a reference."""
    error = _errors(timed, reference)[~np.isnan(reference)]
    return entry_of(
        timed,
        model=model,
        setting=setting,
        evaluations=evaluations,
        error=float(np.max(error)),
        typical_error=float(np.median(error)),
        chosen=chosen,
    )


def _errors(timed: Timed[FloatArray], reference: FloatArray) -> FloatArray:
    """Relative error at every place: root mean square over the runs, which draw anew; NaN without a reference."""
    with np.errstate(invalid="ignore"):  # an unbounded interval is no error bar, and said so by an infinite error
        relative = np.abs(np.stack(timed.values) / reference - 1.0)
    relative = np.where(np.isnan(relative) & ~np.isnan(reference), np.inf, relative)
    return np.asarray(np.sqrt(np.mean(relative**2, axis=0)))


def _where_worst(cases: Sequence[DepthCase], words: str, timed: Timed[FloatArray], reference: FloatArray) -> str:
    """Where what is chosen errs most, and how uncertain depth is there."""
    places = [(case.title, float(distance)) for case in cases for distance in case.distance]
    worst = int(np.nanargmax(_errors(timed, reference)))
    title, distance = places[worst]
    return (
        f"What a run takes, {words}, errs most for {title} at {pretty(distance, LENGTH)}, where the uncertainty is "
        f"{pretty(float(reference[worst]) / distance, FRACTION)} of the distance."
    )
