"""Depth uncertainty: what every way of propagating errors costs, and how far it is from many quasi-random draws."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from scipy.special import ndtri

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cost.draws_saved import PLAIN, SOBOL, gain
from tradestudy.cost.entries import Entry, Measured
from tradestudy.cost.measuring import MOST_PLACES, REFERENCE_SEED, Allowance, Timed, entry_of, measure
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.depth import ONE_SIGMA, depth_uncertainty
from tradestudy.study.progress import Progress
from tradestudy.study.usable import all_met, evaluate_limits
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.evaluation import Model, Outcome, ranked
from tradestudy.uncertainty.linear import linear
from tradestudy.uncertainty.monte_carlo import FEWEST_REPLICATES, Sampling, propagate
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources
from tradestudy.uncertainty.streams import Sampler, plain_random, scrambled_sobol
from tradestudy.units import FRACTION, LENGTH, pretty

_SAMPLERS: Final[Mapping[str, Sampler]] = {SOBOL: scrambled_sobol, PLAIN: plain_random}
_POWERS: Final = range(9, 20, 2)
_MOST_POWER: Final = {SOBOL: 17, PLAIN: 19}
_SUPERSCRIPTS: Final = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_SCRAMBLES: Final = 8
_MOST_REFERENCE_DRAWS, _FEWEST_REFERENCE_DRAWS = 2**20, 2**15
_BATCH: Final = 2**13
_REFERENCE_SHARE: Final = 0.25  # of the time allowed


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One camera whose depth is asked for.

    Parameters
    ----------
    name
        Its key in the study.
    model, sources
        Its exact model of inverse depth, and what is uncertain.
    distance
        Where it is asked for [m].
    closed_form
        The uncertainty by the closed form of ``/depth`` [m]; None where the errors have none.
    """

    name: str
    model: Model
    sources: Sources
    distance: FloatArray
    closed_form: Callable[[], FloatArray] | None


def depth_cost(definition: StudyDefinition, allowance: Allowance, progress: Progress) -> Measured | None:
    """Cost of the depth uncertainty of the study's cameras as declared; None where none measures depth anywhere."""
    cases = [case for name, camera in definition.case.cameras.items() for case in _declared(definition, name, camera)]
    if not cases:
        return None
    cameras = ", ".join(case.name for case in cases)
    return propagation_cost(
        cases,
        allowance,
        progress,
        name="depth_uncertainty",
        title="Depth uncertainty",
        says=f"Half the central 68.27 % interval of depth of {cameras} at up to {MOST_PLACES} distances each where "
        "they are usable: seconds for all of them together, relative error at the worst.",
        chosen=CLOSED_FORM,
    )


CLOSED_FORM: Final = "closed form"
LINEAR, INVERSE = "linear in depth", "linear in inverse depth"


_ORDER: Final = (LINEAR, INVERSE, CLOSED_FORM, SOBOL, PLAIN)


def propagation_cost(
    cases: Sequence[Case],
    allowance: Allowance,
    progress: Progress,
    *,
    name: str,
    title: str,
    says: str,
    chosen: str,
    more: Sequence[tuple[str, str, Sampling]] = (),
    most_draws: int = 2**19,
) -> Measured:
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
    more
        Further samplings: model, setting in words, and how it samples.
    most_draws
        Of any way; the reference takes at most eight times as many.
    """
    progress(f"cost: {name}", 0.0)
    reference, reference_error, reference_seconds, words = _reference(
        cases, allowance.share(_REFERENCE_SHARE), most_draws
    )
    progress(f"cost: {name}", _REFERENCE_SHARE)
    entries: list[Entry] = []
    left_out: list[str] = []
    notes: list[str] = []
    if endless := int(np.count_nonzero(np.isnan(reference))):
        left_out.append(f"{endless} of {reference.size} places: the interval there has no far end by the reference")
    if endless == reference.size:
        return Measured(
            name=name,
            title=title,
            says=says,
            reference=words,
            reference_error=reference_error,
            reference_seconds=reference_seconds,
            entries=(),
            left_out=tuple(left_out),
        )
    for model, compute in _analytic(cases):
        try:
            timed = measure(compute, allowance)
        except OutOfRangeError as error:
            left_out.append(f"{model}: {error}")
            continue
        evaluations = sum(2 * case.sources.dimensions + 1 for case in cases) if model != CLOSED_FORM else math.nan
        entries.append(_entry(model, "", evaluations, timed, reference, chosen=model == chosen))
        if model == chosen:
            notes.append(_where_worst(cases, model, timed, reference))
    took = dict.fromkeys(_SAMPLERS, 0.0)
    for power in _POWERS:
        for model, sampler in _SAMPLERS.items():
            if power > _MOST_POWER[model] or 2**power > most_draws:
                continue
            setting = f"2{str(power).translate(_SUPERSCRIPTS)} draws"
            # Four times the draws take four times as long; one run for the memory, and at least one for the time.
            if not allowance.allows(2.0 * 4.0 * took[model]):
                left_out.append(f"{model}, {setting}: no time left")
                continue
            timed = measure(partial(_sampled, cases, fixed_sampling(sampler, 2**power)), allowance)
            took[model] = timed.seconds
            entries.append(_entry(model, setting, 2.0**power, timed, reference))
            progress(f"cost: {name}", _REFERENCE_SHARE + (1 - _REFERENCE_SHARE) * _spent(allowance))
    for model, setting, sampling in more:
        timed = measure(partial(_sampled, cases, sampling), allowance)
        entries.append(_entry(model, setting, math.nan, timed, reference, chosen=model == chosen))
        if model == chosen:
            notes.append(_where_worst(cases, f"{model} {setting}", timed, reference))
    progress(f"cost: {name}", 1.0)
    return Measured(
        name=name,
        title=title,
        says=says,
        reference=words,
        reference_error=reference_error,
        reference_seconds=reference_seconds,
        entries=tuple(sorted(entries, key=lambda entry: _ORDER.index(entry.model))),
        left_out=tuple(left_out),
        notes=(*notes, *gain(entries, reference_error)),
    )


def _spent(allowance: Allowance) -> float:
    return min(1.0, 1.0 - allowance.left / allowance.seconds) if allowance.seconds > 0.0 else 1.0


def _declared(definition: StudyDefinition, name: str, camera: DepthCamera) -> Iterator[Case]:
    """The camera at some of the distances where it is usable and its uncertainty finite; nothing where there is none.

    Its errors are those that it declares, each direction drawn independently, through its exact model.
    """
    case = definition.case
    usable = all_met(evaluate_limits(camera, case.criteria, case.distance), case.distance.shape)
    places = case.distance[usable & np.isfinite(depth_uncertainty(camera, case.distance))]
    if places.size == 0:
        return
    wanted = np.geomspace(places[0], places[-1], MOST_PLACES)
    distance = places[np.unique(np.abs(places[:, None] - wanted).argmin(axis=0))]
    directions = camera.error_directions(distance)
    shapes = {part.name: part.shape for part in camera.depth_error_parts(distance)}
    sources: list[Source] = []
    moved: dict[str, Mapping[str, object]] = {}
    for part, errors in directions.items():
        for number, error in enumerate(errors):
            key = f"{part} {number}"
            uniform = shapes.get(part) == "uniform"
            spread = (
                Uniform(low=-math.sqrt(3.0), high=math.sqrt(3.0))
                if uniform
                else Normal(mean=0.0, standard_deviation=1.0)
            )
            sources.append(Source(name=key, distribution=spread, error_class=ErrorClass.RIG))
            moved[key] = error

    def model(values: Mapping[str, FloatArray]) -> Outcome:
        errors: dict[str, FloatArray] = {}
        for key, direction in moved.items():
            for parameter, deviation in direction.items():
                added = values[key] * np.asarray(deviation, dtype=np.float64)
                errors[parameter] = errors[parameter] + added if parameter in errors else added
        depth = camera.depth_with_errors(distance, errors)
        shape = (len(next(iter(values.values()))), distance.size)
        return Outcome(values=np.broadcast_to(1.0 / depth, shape))

    yield Case(
        name=name,
        model=model,
        sources=Sources(groups=tuple(sources)),
        distance=distance,
        closed_form=lambda: depth_uncertainty(camera, distance),
    )


def _analytic(cases: Sequence[Case]) -> Iterator[tuple[str, Callable[[int], FloatArray]]]:
    def lines(case: Case) -> FloatArray:
        return linear(case.model, case.sources, inverse_depth=True).standard_uncertainty

    def mapped(case: Case) -> FloatArray:
        low, high = linear(case.model, case.sources, inverse_depth=True).mapped_quantiles(ONE_SIGMA)
        return np.asarray((high - low) / 2.0)

    yield LINEAR, lambda _run: _joined(lines(case) for case in cases)
    yield INVERSE, lambda _run: _joined(mapped(case) for case in cases)
    closed = [case.closed_form for case in cases if case.closed_form is not None]
    if len(closed) == len(cases):
        yield CLOSED_FORM, lambda _run: _joined(one() for one in closed)


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


def _sampled(cases: Sequence[Case], sampling: Sampling, run: int) -> FloatArray:
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


def _where_worst(cases: Sequence[Case], words: str, timed: Timed[FloatArray], reference: FloatArray) -> str:
    """Where what is chosen errs most, and how uncertain depth is there."""
    places = [(case.name, float(distance)) for case in cases for distance in case.distance]
    worst = int(np.nanargmax(_errors(timed, reference)))
    name, distance = places[worst]
    return (
        f"What a run takes, {words}, errs most for {name} at {pretty(distance, LENGTH)}, where the uncertainty is "
        f"{pretty(float(reference[worst]) / distance, FRACTION)} of the distance."
    )


def _reference(cases: Sequence[Case], allowance: Allowance, most_draws: int) -> tuple[FloatArray, float, float, str]:
    """Half-widths from many draws, their relative standard error, what they took, and the words for all.

    NaN where the interval of some scramble has no far end.

    Written apart from what is measured: the draws come from scipy's own scrambled Sobol sequence, unaligned, and the
    quantiles from numpy over all draws of a scramble.
    """
    draws = _FEWEST_REFERENCE_DRAWS
    found = _scrambles(cases, draws)
    while draws < min(_MOST_REFERENCE_DRAWS, 8 * most_draws) and allowance.allows(2.5 * found[1]):
        draws *= 2
        found = _scrambles(cases, draws)
    widths = np.where(np.isfinite(found[0]).all(axis=0), found[0], np.nan)
    mean = widths.mean(axis=0)
    errors = widths.std(axis=0, ddof=1) / math.sqrt(_SCRAMBLES) / mean
    error = math.nan if np.isnan(errors).all() else float(np.nanmax(errors))
    power = str(draws.bit_length() - 1).translate(_SUPERSCRIPTS)
    words = (
        f"2{power} scrambled Sobol draws in {_SCRAMBLES} scrambles of a seed of their own through the exact models, "
        "quantiles by a code of their own"
    )
    return mean, error, found[1], words


def _scrambles(cases: Sequence[Case], draws: int) -> tuple[FloatArray, float]:
    """Half-widths of every scramble, shape (scrambles, places), and the seconds they took."""
    from scipy.stats.qmc import Sobol

    begin = time.perf_counter()
    rows = []
    for scramble in range(_SCRAMBLES):
        parts = []
        for number, case in enumerate(cases):
            rng = np.random.default_rng((REFERENCE_SEED, scramble, number))
            engine = Sobol(case.sources.dimensions, scramble=True, bits=52, rng=rng)
            depths = []
            for _ in range(max(1, draws // _SCRAMBLES // _BATCH)):
                uniform = engine.random(min(_BATCH, draws // _SCRAMBLES)).T + 2.0**-53
                found = case.model(case.sources.draw(ndtri(uniform)))
                depths.append(ranked(found, inverse_depth=True, draws=uniform.shape[1])[0])
            with np.errstate(invalid="ignore"):  # between two infinite depths: NaN, no far end
                low, high = np.quantile(np.concatenate(depths, axis=1), ONE_SIGMA, axis=1, method="hazen")
            parts.append((high - low) / 2.0)
        rows.append(np.concatenate(parts))
    return np.stack(rows), time.perf_counter() - begin
