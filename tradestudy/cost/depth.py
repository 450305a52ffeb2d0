"""Depth uncertainty: what every way of propagating errors costs, and how far it is from a code of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.analysis.depth import ONE_SIGMA, depth_uncertainty
from tradestudy.analysis.usable import all_met, evaluate_limits
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cost.depth_reference import SUPERSCRIPTS, DepthCase, reference_of
from tradestudy.cost.entries import NOWHERE_USABLE, PLAIN, SOBOL, CostTable, Entry, gain, nothing_measured
from tradestudy.cost.interval_quadrature import half_width_by_quadrature
from tradestudy.cost.measuring import MOST_PLACES, Allowance, Timed, entry_of, measure
from tradestudy.effects.depth_errors import LINEAR as EFFECT_LINEAR
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.execution.steps import Progress
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import StudyDefinition
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.evaluation import Outcome
from tradestudy.uncertainty.linear import linear
from tradestudy.uncertainty.monte_carlo import FEWEST_REPLICATES, Sampling, propagate
from tradestudy.uncertainty.sources import Source, Sources
from tradestudy.uncertainty.streams import Sampler, plain_random, scrambled_sobol
from tradestudy.units import FRACTION, LENGTH, pretty

_SAMPLERS: Final[Mapping[str, Sampler]] = {SOBOL: scrambled_sobol, PLAIN: plain_random}
_POWERS: Final = range(9, 20, 2)
_MOST_POWER: Final = {SOBOL: 17, PLAIN: 19}
_REFERENCE_SHARE: Final = 0.4  # of the time allowed
_RULES_AFTER: Final = 13  # power of two of the draws, after which draws by other rules are tried
_UNTIL_CONVERGED: Final = 8.0  # times as many draws as those, which such a rule is expected to take


def depth_cost(definition: StudyDefinition, allowance: Allowance, progress: Progress) -> CostTable:
    """Cost of the depth uncertainty of the study's cameras as declared; those usable nowhere are left out and named."""
    cameras = definition.case.cameras
    cases = [case for name, camera in cameras.items() for case in _declared(definition, name, camera)]
    name, title = "depth_uncertainty", "Depth uncertainty"
    titles = {camera: definition.file.cameras[camera].title for camera in cameras}
    usable = [case.name for case in cases]
    says = (
        "Half the central 68.27 % interval of depth of "
        f"{'; '.join(titles[camera] for camera in usable or cameras)} at up to {MOST_PLACES} "
        "distances each where they are usable: seconds for all of them together, relative error at the worst."
    )
    if not cases:
        return nothing_measured(name, title, says, NOWHERE_USABLE)
    measured = propagation_cost(
        cases,
        allowance,
        progress,
        name=name,
        title=title,
        says=says,
        chosen=IN_DISPARITY,
        asked=definition.file.accuracy.wanted().relative["depth_uncertainty"],
    )
    derived = any(isinstance(one.disparity_error_px, PictureDisparityError) for one in cameras.values())
    unusable = tuple(f"{titles[one]}: usable at no distance of the study" for one in cameras if one not in usable)
    return replace(
        measured,
        left_out=(*unusable, *measured.left_out),
        notes=(_WHICH_IS_LINEAR, *([_PICTURES] * derived), *measured.notes) if measured.entries else measured.notes,
        ways={IN_DISPARITY: "no option, as every run takes it"},
    )


IN_DISPARITY: Final = "linear in disparity, closed form"
_PICTURES: Final = (
    "What it takes to derive disparity errors from pictures is measured by itself, below; here they are known."
)
LINEAR, INVERSE = "linear in depth", "linear in inverse depth"
_WHICH_IS_LINEAR: Final = (
    f"What a run takes, {IN_DISPARITY}, is what the table of effects calls calibration: {EFFECT_LINEAR}. All errors "
    "that act are added up as errors of disparity, with their distributions, and the ends of the interval are mapped "
    f"to depth. {LINEAR.capitalize()} and {INVERSE} are other models, which no run takes for this: lines by difference "
    "quotients of the exact model, one standard deviation wide, in depth itself or in its inverse."
)
QUADRATURE: Final = "quadrature"
_NODES: Final = {1: "steepest direction alone", 3: "3 nodes per dimension", 5: "5 nodes per dimension"}
_ORDER: Final = (LINEAR, INVERSE, IN_DISPARITY, QUADRATURE, SOBOL, PLAIN)


def propagation_cost(
    cases: Sequence[DepthCase],
    allowance: Allowance,
    progress: Progress,
    *,
    name: str,
    title: str,
    says: str,
    chosen: str,
    asked: float = math.nan,
    more: Sequence[tuple[str, str, Sampling]] = (),
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
    chosen
        The model that the study's run uses.
    asked
        Relative error that the study asks for; NaN where it asks for none.
    more
        Further samplings: model, setting in words, and how it samples.
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
    for model, compute in _analytic(cases):
        try:
            timed = measure(compute, allowance)
        except OutOfRangeError as error:
            left_out.append(f"{model}: {error}")
            continue
        evaluations = sum(2 * case.sources.dimensions + 1 for case in cases) if model != IN_DISPARITY else math.nan
        entries.append(_entry(model, "", evaluations, timed, reference, chosen=model == chosen))
        if model == chosen:
            notes.append(_where_worst(cases, model, timed, reference))
    took_last = 0.0
    for nodes, setting in _NODES.items():
        # The nodes of up to five dimensions grow by less than a hundredfold from one setting to the next.
        if not allowance.allows(2.0 * took_last):
            left_out.append(f"{QUADRATURE}, {setting}: {allowance.lacking(2.0 * took_last)}")
            continue
        try:
            timed = measure(
                lambda _run, nodes=nodes: _joined(  # type: ignore[misc]  # bound at once
                    half_width_by_quadrature(case.model, case.sources, ONE_SIGMA, nodes) for case in cases
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
    took, drawn = dict.fromkeys(_SAMPLERS, 0.0), 0.0
    # Model, setting, sampling, draws, and how many times longer than the draws of the model before it takes: four times
    # the draws take four times as long, with one run for the memory, and at least one for the time. Rules come before
    # the many draws, lest those leave no time for what a run takes.
    runs: list[tuple[str, str, Sampling, float, float]] = []
    for power in _POWERS:
        runs += [
            (model, f"2{str(power).translate(SUPERSCRIPTS)} draws", fixed_sampling(sampler, 2**power), 2.0**power, 8.0)
            for model, sampler in _SAMPLERS.items()
            if power <= _MOST_POWER[model] and 2**power <= most_draws
        ]
        runs += [(*rule, math.nan, _UNTIL_CONVERGED) for rule in more if power == _RULES_AFTER]
    for model, setting, sampling, draws, longer in runs:
        predicted = longer * took[model]
        if not allowance.allows(predicted):
            left_out.append(f"{model}, {setting}: {allowance.lacking(predicted)}")
            continue
        timed = measure(partial(_sampled, cases, sampling), allowance)
        is_rule = math.isnan(draws)
        entries.append(_entry(model, setting, draws, timed, reference, chosen=is_rule and model == chosen))
        if not is_rule:
            took[model], drawn = timed.seconds, drawn + draws
            share = drawn / math.fsum(one[3] for one in runs if not math.isnan(one[3]))
            progress(f"cost: {name}", _REFERENCE_SHARE + (1.0 - _REFERENCE_SHARE) * share)
        elif model == chosen:
            notes.append(_where_worst(cases, f"{model} {setting}", timed, reference))
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


def _declared(definition: StudyDefinition, name: str, camera: DepthCamera) -> Iterator[DepthCase]:
    """The camera at some of the distances where it is usable and its uncertainty finite; nothing where there is none.

    Its errors are those that it declares, each direction drawn independently, through its exact model.
    """
    distance = usable_places(definition, camera)
    if distance.size == 0:
        return
    directions = camera.error_directions(distance)
    shapes = {part.name: part.shape for part in camera.depth_error_parts(distance)}
    moved = {
        f"{part} {number}": (part, error) for part, errors in directions.items() for number, error in enumerate(errors)
    }
    sources = tuple(
        Source(
            name=key,
            distribution=Uniform(low=-math.sqrt(3.0), high=math.sqrt(3.0))
            if shapes.get(part) == "uniform"
            else Normal(mean=0.0, standard_deviation=1.0),
            error_class=ErrorClass.RIG,
        )
        for key, (part, _) in moved.items()
    )

    def model(values: Mapping[str, FloatArray]) -> Outcome:
        errors: dict[str, FloatArray] = {}
        for key, (_, direction) in moved.items():
            for parameter, deviation in direction.items():
                added = values[key] * np.asarray(deviation, dtype=np.float64)
                errors[parameter] = errors[parameter] + added if parameter in errors else added
        depth = camera.depth_with_errors(distance, errors)
        shape = (len(next(iter(values.values()))), distance.size)
        return Outcome(values=np.broadcast_to(1.0 / depth, shape))

    known = _with_known_errors(camera, distance)
    yield DepthCase(
        name=name,
        title=definition.file.cameras[name].title,
        model=model,
        sources=Sources(groups=sources),
        distance=distance,
        closed_form=lambda: depth_uncertainty(known, distance),
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
    found = law.error_px(camera, distance)
    known = _KnownDisparityError(
        settings=law.settings, models=law.models, distance=tuple(distance.tolist()), known_px=tuple(found.tolist())
    )
    return replace(camera, disparity_error_px=known)


def _analytic(cases: Sequence[DepthCase]) -> Iterator[tuple[str, Callable[[int], FloatArray]]]:
    def mapped(case: DepthCase) -> FloatArray:
        low, high = linear(case.model, case.sources, inverse_depth=True).mapped_quantiles(ONE_SIGMA)
        return np.asarray((high - low) / 2.0)

    yield (
        LINEAR,
        lambda _run: _joined(
            linear(case.model, case.sources, inverse_depth=True).standard_uncertainty for case in cases
        ),
    )
    yield INVERSE, lambda _run: _joined(mapped(case) for case in cases)
    closed = [case.closed_form for case in cases if case.closed_form is not None]
    if len(closed) == len(cases):
        yield IN_DISPARITY, lambda _run: _joined(one() for one in closed)


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
