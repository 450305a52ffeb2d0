"""How much longer pictures of light spots take by the chosen models than by the cheapest that suffice.

    python -m tests.campaigns.light_regret [--cases 60] [--seed 0] [--large]

A case is a random light path and a tolerance of 0.5 to 20 %. Truth is the picture by the most complete models. Sets
that differ in diffraction, source extent, crosstalk, pixel integration and sampling are compared: regret is
(t_chosen + 0.1 s)/(t_cheapest sufficient + 0.1 s), with trials in t_chosen, each the least of three processor
times, which other work on the machine hardly touches. Seeds 1 to 3, 102, 201, 202, 302, 303, 811 to 822, 825 were
looked at while rules and trials were written; 75 cases take ten minutes of processor time.

`--large` draws discs of which pictures follow so many points that trials of laws are worth their time; of ten draws,
about one has such a disc and takes little enough time. Its sets differ in diffraction and sampling alone.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.campaigns import record
from tests.campaigns.light_cases import large_part, random_part
from tradestudy.errors import TradestudyError
from tradestudy.models.light_spot import TOLERANCES, LightSpotProblem, spot_models
from tradestudy.models.problem import choose
from tradestudy.models.slow_steps import picture_seconds
from tradestudy.models.spot_images import RAYS, SpotModels, picture_of
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.schema.wave_optics import LightSpotPart, MethodName

METHODS: tuple[MethodName, ...] = ("exact-rays", "fresnel", "fresnel-kirchhoff", "kirchhoff")
ADDED = 0.1  # seconds that nobody notices
_PREDICTED_WITHIN = 10.0  # factor; the prediction is one of magnitude
_LONGEST, _LONGEST_TRUTH = 4.0, 12.0  # seconds of a picture to 1 %, as predicted, and of the truth


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One case: what was chosen, its change over the tolerance, and its regret."""

    number: int
    tolerance: float
    chosen: SpotModels
    cheapest: SpotModels
    change: float
    trial_seconds: float
    seconds: float
    least_seconds: float

    @property
    def regret(self) -> float:
        """Trials included."""
        return (self.trial_seconds + self.seconds + ADDED) / (self.least_seconds + ADDED)

    @property
    def exceeded(self) -> float:
        """Change of the picture over the tolerance."""
        return self.change / self.tolerance


def measured(number: int, seed: int, *, large: bool = False) -> Outcome | None:
    """One case; None where the most complete picture is refused, or no set suffices."""
    rng = np.random.default_rng([seed, number])
    part = large_part(rng) if large else random_part(rng)
    tolerance = math.exp(rng.uniform(math.log(0.005), math.log(0.2)))
    if large and not _suits(part):
        return None
    start = time.process_time()
    try:
        truth = _picture(part, SpotModels(method="kirchhoff", tolerance=max(tolerance / 10, 2e-3)))
    except TradestudyError:
        return None
    if large and time.process_time() - start > _LONGEST_TRUTH:
        return None
    trial_seconds = _least(lambda: choose(LightSpotProblem(part, {}), {"pixel_intensity": tolerance}, {}))
    chosen = spot_models(choose(LightSpotProblem(part, {}), {"pixel_intensity": tolerance}, {}).models)
    seconds, change = _timed(part, chosen, truth)
    seconds = min(seconds, *(_timed(part, chosen, truth)[0] for _ in range(2)))
    best, least = chosen, seconds if change <= tolerance else math.inf
    for steps in _sets(tolerance, laws_alone=large):
        if (found := _least_of(part, steps, truth, tolerance, least)) is not None:
            best, least = found
    if not math.isfinite(least):
        return None
    return Outcome(
        number=number,
        tolerance=tolerance,
        chosen=chosen,
        cheapest=best,
        change=change,
        trial_seconds=trial_seconds,
        seconds=seconds,
        least_seconds=least,
    )


def _suits(part: LightSpotPart) -> bool:
    """Whether trials of laws are worth their time, and the picture can be computed many times."""
    try:
        tried = LightSpotProblem(part, {}).tries_laws
        complete = SpotModels(method="kirchhoff", tolerance=0.01, monochromatic=True)
        return tried and picture_seconds(part, complete.tolerance) < _LONGEST
    except TradestudyError:
        return False


def _least_of(
    part: LightSpotPart, steps: Sequence[SpotModels], truth: FloatArray, tolerance: float, least: float
) -> tuple[SpotModels, float] | None:
    """The coarsest sampling that suffices and its least seconds of three; None if it takes longer than others do."""
    try:
        if picture_seconds(part, steps[0].tolerance) > _PREDICTED_WITHIN * least:
            return None
        for models in steps:  # finer sampling takes longer
            first, found = _timed(part, models, truth)
            if first > 1.3 * least:
                return None
            if found <= tolerance:
                again = min(first, *(_timed(part, models, truth)[0] for _ in range(2)))
                return (models, again) if again < least else None
    except TradestudyError:
        pass
    return None


def _sets(tolerance: float, *, laws_alone: bool) -> Iterator[tuple[SpotModels, ...]]:
    """Every law, unless alone with every omission, sampled to the tolerance and to the two steps below it."""
    finer = [one for one in TOLERANCES if one <= tolerance][:3]
    omissions = [(False, False, True)]
    if not laws_alone:
        omissions = list(itertools.product((True, False), (False, True), (True, False)))
    for method, (point, separate, integrated) in itertools.product(METHODS, omissions):
        if integrated or method not in RAYS:
            yield tuple(
                SpotModels(method=method, tolerance=one, point=point, separate=separate, integrated=integrated)
                for one in (finer[:1] if method in RAYS else finer)
            )


def _picture(part: LightSpotPart, models: SpotModels) -> FloatArray:
    return picture_of(part, replace(models, monochromatic=True), seed=part.seed).pixels


def _timed(part: LightSpotPart, models: SpotModels, truth: FloatArray) -> tuple[float, float]:
    """Seconds of a picture, and its relative change."""
    start = time.process_time()
    pixels = _picture(part, models)
    seconds = time.process_time() - start
    return seconds, float(np.linalg.norm(pixels - truth) / np.linalg.norm(truth))


def _least(run: Callable[[], object]) -> float:
    """Least seconds of three."""
    found = []
    for _ in range(3):
        start = time.process_time()
        run()
        found.append(time.process_time() - start)
    return min(found)


def rows(outcomes: list[Outcome]) -> list[tuple[str, str]]:
    """What the record states."""
    regrets = np.array([one.regret for one in outcomes])
    exceeded = sorted((one.exceeded for one in outcomes if one.exceeded > 1.0), reverse=True)
    laws = {method: sum(one.chosen.method == method for one in outcomes) for method in METHODS}
    return [
        ("cases", str(len(outcomes))),
        ("regret ≤ 1.5", f"{100 * np.mean(regrets <= 1.5):.0f} %"),
        ("regret ≤ 3", f"{100 * np.mean(regrets <= 3.0):.0f} %"),
        ("median and largest regret", f"{np.median(regrets):.2f}, {regrets.max():.1f}"),
        ("tolerance exceeded", f"{len(exceeded)} times"),
        ("change over tolerance, largest", f"{max(one.exceeded for one in outcomes):.2f}"),
        ("trials, median and largest", f"{np.median([1e3 * o.trial_seconds for o in outcomes]):.0f} ms, "
         f"{max(1e3 * o.trial_seconds for o in outcomes):.0f} ms"),
        ("chosen", ", ".join(f"{method} {count}" for method, count in laws.items())),
    ]  # fmt: skip


def main() -> None:
    """Measure every case, write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--large", action="store_true")
    asked = parser.parse_args()
    outcomes = []
    for number in range(asked.cases):
        if one := measured(number, asked.seed, large=asked.large):
            outcomes.append(one)
            print(
                f"{number}: {one.tolerance:.3f} regret {one.regret:.2f}, change/tolerance {one.exceeded:.2f}; trials "
                f"{one.trial_seconds:.3f} s, {_words(one.chosen)} {one.seconds:.3f} s, {_words(one.cheapest)} "
                f"{one.least_seconds:.3f} s", flush=True
            )  # fmt: skip
            _write(asked, outcomes, number + 1)


def _write(asked: argparse.Namespace, outcomes: list[Outcome], drawn: int) -> None:
    """The record of the cases so far, so that an interrupted run leaves one."""
    name, of, option = (
        ("light_regret_large", " with large discs", " --large") if asked.large else ("light_regret", "", "")
    )
    record.write(
        name,
        f"Regret of chosen pictures: {len(outcomes)} of {drawn} random light paths{of}, seed {asked.seed}",
        f"python -m tests.campaigns.light_regret --cases {drawn} --seed {asked.seed}{option}",
        ("What", "Measured"),
        rows(outcomes),
    )


def _words(models: SpotModels) -> str:
    marks = [name for name in ("point", "separate") if getattr(models, name)]
    marks += [] if models.integrated else ["middles"]
    return f"{models.method} {100 * models.tolerance:g} %{''.join(f' {one}' for one in marks)}"


if __name__ == "__main__":
    main()
