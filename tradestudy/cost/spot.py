"""Picture of a light spot through both lenses: what every law and tolerance costs, for one point of it and for all."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, get_args

import numpy as np

from tradestudy.analysis.spot_images import RAYS, SpotModels, compared_models, light_source, picture_of
from tradestudy.cost.entries import CostTable, Entry, nothing_measured
from tradestudy.cost.measuring import Allowance, Pace, Timed, entry_of, measure
from tradestudy.errors import NotConvergedError, UnaffordableError
from tradestudy.execution.steps import Progress
from tradestudy.light_methods import short_title
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import ChainAccuracy, ChainImage, DiscSource
from tradestudy.optics.propagation import PointSource
from tradestudy.plan.situations.light_spot import picture_seconds
from tradestudy.study.schema.light_spot import LightSpotPart, MethodName
from tradestudy.units import significant

_WAVES: Final[tuple[MethodName, ...]] = ("kirchhoff", "kirchhoff-fresnel", "fresnel")
_POINT_TOLERANCES: Final = (0.1, 1e-2, 1e-3, 1e-4)
# What the picture of a point may be held against, the finest first, and how many times longer than a picture of that
# tolerance it takes at the pace of a coarse one, its finer nodes and its checks included.
_POINT_REFERENCES: Final = {1e-5: 3.0, 1e-4: 2.5, 1e-3: 2.0, 1e-2: 1.5}
_FINER: Final = 1.2
_DIMENSIONS: Final = 4  # of a spot's source and of its grids, in which a finer one takes more
_TOLERANCES: Final = (0.1, 10.0, 1.0)  # of that of the study
_FINEST: Final = 1e-6
_COARSEST: Final = 0.2
_COARSEST_REFERENCE: Final = 0.1
_REFERENCE_SEED: Final = 1
_WAYS: Final = "light_spot.methods at light_spot.tolerance, of a run's own picture accuracy.pixel_intensity and effects"
_LARGEST_SHARE: Final = 0.5  # of what is left, for a reference that is not the cheapest one


def point_cost(
    part: LightSpotPart, allowance: Allowance, progress: Progress, *, speed: float, pace: Pace | None = None
) -> CostTable:
    """Cost of the picture of one point, halfway between the middle and the rim of the spot; see `spot_cost`.

    Rays and a coarse Kirchhoff come first; the reference is the finest one that takes at most half of what is left.
    """
    x = part.spot.x + part.spot.diameter / 4

    def image(method: MethodName, accuracy: ChainAccuracy, seed: int = 0) -> ChainImage:
        point = PointSource(x=x, y=part.spot.y, distance=part.spot.distance)
        return picture_of(part, point, compared_models(part, method), accuracy=accuracy, seed=seed)

    def run(method: MethodName, tolerance: float) -> _Run:
        models = replace(compared_models(part, method), tolerance=tolerance, point=True)
        return _Run(
            method=method,
            setting="" if method == "geometric" else _percent(tolerance),
            predicted=picture_seconds(part, models) / speed,
            compute=partial(image, method, ChainAccuracy(tolerance=tolerance)),
            tolerance=tolerance,
        )

    progress("cost: spot_point", 0.0)
    title = "Picture of one point of the spot"
    says = (
        "Pixels lit by one point, halfway between the middle and the rim of the spot, through main lens and "
        "microlenses: relative L2 error over the pixels."
    )
    taking = _Taking(name="spot_point", allowance=allowance, progress=progress, pace=pace or Pace())
    references = {
        tolerance: factor * run("kirchhoff", tolerance).predicted for tolerance, factor in _POINT_REFERENCES.items()
    }
    cheapest = min(references.values())
    rays = [] if part.spot.coherent else [run("geometric", _COARSEST)]
    first = [*rays, run("kirchhoff", max(_POINT_TOLERANCES))]
    if allowance.allows(taking.paced("kirchhoff", cheapest) + taking.paced(first[0].method, first[0].predicted)):
        for one in first:
            taking.take(one, before=cheapest)
    finest = next(
        (
            tolerance
            for tolerance, predicted in references.items()
            if taking.taken and taking.allows(predicted if predicted == cheapest else predicted / _LARGEST_SHARE)
        ),
        None,
    )
    if finest is None:
        progress("cost: spot_point", 1.0)
        why = taking.too_little(cheapest, "a reference at 1 % takes")
        return replace(nothing_measured("spot_point", title, says, why), of_a_run=False)
    begin = time.perf_counter()
    reference = image("kirchhoff", _finer(finest, _FINER), _REFERENCE_SEED)
    reference_seconds = time.perf_counter() - begin
    checked = max(reference.direct_check.values(), default=math.nan)
    others = [run(method, tolerance) for tolerance in _POINT_TOLERANCES for method in _WAVES]
    for one in sorted(others, key=lambda other: other.predicted):
        taking.take_beside(one, coarser=one.tolerance > finest)
    progress("cost: spot_point", 1.0)
    return CostTable(
        name="spot_point",
        title=title,
        says=says,
        reference=f"Kirchhoff on both legs at a tolerance of {finest:g} with {_FINER:g} times the nodes, samples and "
        f"reach, its intensities within {checked:.1e} of direct quadrature at random places",
        reference_error=reference.numerical_error,
        reference_seconds=reference_seconds,
        entries=taking.entries(reference.pixels),
        left_out=tuple(taking.left_out),
        of_a_run=False,
    )


def _finer(tolerance: float, factor: float) -> ChainAccuracy:
    """Of this tolerance with finer nodes and samples, none of which a picture of the same tolerance has."""
    return ChainAccuracy(
        tolerance=tolerance,
        pupil_nodes=factor,
        microlens_nodes=factor,
        field_sampling=factor,
        diffraction_reach=factor,
        pixel_sampling=factor,
        source_sampling=factor,
    )


def spot_cost(
    part: LightSpotPart,
    chosen: SpotModels,
    allowance: Allowance,
    progress: Progress,
    *,
    speed: float,
    asked: float,
    pace: Pace | None = None,
) -> CostTable:
    """Cost of the picture of the whole spot, as far as the time allows.

    Rays come first, then the picture of the study, which tells how fast this machine is just now; then the finest
    reference that leaves time for Kirchhoff's picture at a tenth of the study's tolerance, or for the cheapest one that
    may be held against it; then that picture, and all others. None is begun without time for the cheapest reference.

    Parameters
    ----------
    part
        The light path.
    chosen
        The models that make the picture of the study: what a run computes, whatever it compares beside it.
    allowance
        Time and repeats.
    progress
        Called with the step and the share done.
    speed
        Of this machine, for what is predicted.
    asked
        Relative error of the pixels that the study asks for.
    pace
        As far as it is known from other pictures.
    """

    def image(models: SpotModels, seed: int = 0, finer: float = 1.0) -> ChainImage:
        accuracy = _finer(models.tolerance, finer)
        source = light_source(part)
        source = source.centre if models.point and isinstance(source, DiscSource) else source
        return picture_of(part, source, models, accuracy=accuracy, seed=seed)

    def run(models: SpotModels) -> _Run:
        return _Run(
            method=models.method,
            setting=_setting(part, models),
            predicted=picture_seconds(part, models) / speed,
            compute=partial(image, models),
            tolerance=models.tolerance,
            chosen=models == chosen,
        )

    standing = part.tolerance if chosen.method in RAYS else min(part.tolerance, chosen.tolerance)
    best = compared_models(part, "kirchhoff")
    taking = _Taking(name="spot", allowance=allowance, progress=progress, pace=pace or Pace())
    coarsest = run(replace(best, tolerance=_COARSEST_REFERENCE)).predicted
    others = [run(models) for models in _others(part, chosen, standing)]
    own = run(chosen)
    rays = sorted((one for one in (own, *others) if one.method in RAYS), key=lambda one: one.predicted)
    waves = [one for one in others if one.method not in RAYS]
    for one in rays:
        taking.take(one, before=coarsest)
    if own not in rays:
        taking.take(own, before=2.0 * coarsest)

    def cheapest_beside(tolerance: float) -> float:
        """Of the pictures by waves that may be held against a reference; nothing where there is none."""
        return min((one.predicted for one in waves if one.tolerance > tolerance), default=0.0)

    # Its tolerance, how much finer it is than that calls for, and seconds of what shall be held against it.
    digit = run(replace(best, tolerance=standing / 10)).predicted
    wishes = [
        (standing / 10, _FINER, digit),
        *((factor * standing, 1.0, cheapest_beside(factor * standing)) for factor in (0.1, 0.5, 1, 2, 5)),
        (_COARSEST_REFERENCE, 1.0, 0.0 if taking.taken else cheapest_beside(_COARSEST_REFERENCE)),
    ]
    finest, finer = next(
        (
            (tolerance, finer)
            for tolerance, finer, beside in wishes
            if _FINEST <= tolerance <= _COARSEST_REFERENCE
            and (taking.taken or beside)
            and taking.allows(finer**_DIMENSIONS * run(replace(best, tolerance=tolerance)).predicted + beside)
        ),
        (None, 1.0),
    )
    title = "Picture of the whole spot"
    says = "All pixels of the picture of the spot: relative L2 error over the pixels."
    if finest is None:
        progress("cost: spot", 1.0)
        words = f"a reference at {100 * _COARSEST_REFERENCE:g} % and a picture beside it take"
        return nothing_measured("spot", title, says, taking.too_little(2.0 * coarsest, words))
    begin = time.perf_counter()
    reference = image(replace(best, tolerance=finest), _REFERENCE_SEED, finer)
    reference_seconds = time.perf_counter() - begin
    for one in waves:
        taking.take_beside(one, coarser=one.tolerance > finest or (one.tolerance == finest and finer > 1.0))
    progress("cost: spot", 1.0)
    entries = taking.entries(reference.pixels)
    return CostTable(
        name="spot",
        title=title,
        says=says,
        reference=f"Kirchhoff on both legs at a tolerance of {100 * finest:g} %"
        + (f" with {finer:g} times the source, nodes, samples and reach" if finer > 1.0 else "")
        + ", with its own stated error",
        reference_error=reference.numerical_error,
        reference_seconds=reference_seconds,
        entries=entries,
        left_out=tuple(taking.left_out),
        notes=tuple(_digit_of_tolerance(entries, standing)),
        asked=asked,
        ways={entry.model: _WAYS for entry in entries},
    )


def _digit_of_tolerance(entries: Sequence[Entry], standing: float) -> Iterator[str]:
    """What Kirchhoff takes, and how far it is from the reference, at the study's tolerance and at a tenth of it."""
    law = short_title("kirchhoff")
    found = {entry.setting: entry for entry in entries if entry.model == law}
    coarse, fine = (found.get(_percent(tolerance)) for tolerance in (standing, standing / 10))
    if coarse is not None and fine is not None:
        yield (
            f"{law} at the study's {_percent(standing)} took {significant(coarse.seconds, 2)} s and differs from the "
            f"reference by {significant(100 * coarse.error, 2)} %; at {_percent(standing / 10)} it took "
            f"{significant(fine.seconds, 2)} s, {significant(fine.seconds / coarse.seconds, 2)} times as long, and "
            f"differs by {significant(100 * fine.error, 2)} %."
        )


def _others(part: LightSpotPart, chosen: SpotModels, standing: float) -> Iterator[SpotModels]:
    """Every law with nothing left out beside the study's own picture, the next digit first in case the time ends.

    Fresnel errs by its law at any tolerance, which a tenth of it would not show better.
    """
    asked = [] if part.spot.coherent else [(method, chosen.tolerance) for method in RAYS]
    tolerances = list(dict.fromkeys(min(factor * standing, _COARSEST) for factor in _TOLERANCES))
    asked += [("kirchhoff", tolerance) for tolerance in tolerances]
    asked += [(method, tolerance) for tolerance in tolerances if tolerance >= standing for method in _WAVES]
    for method, tolerance in dict.fromkeys(asked):
        models = replace(compared_models(part, method), tolerance=tolerance)
        if models != chosen:
            yield models


def _words(run: _Run) -> str:
    return ", ".join(part for part in (short_title(run.method), run.setting) if part)


@dataclass(frozen=True, kw_only=True)
class _Run:
    """One picture to be measured; ``predicted`` seconds on this machine."""

    method: MethodName
    setting: str
    predicted: float
    compute: Callable[[], ChainImage]
    tolerance: float
    chosen: bool = False


def _percent(tolerance: float) -> str:
    return f"tolerance {100 * tolerance:g} %"


def _setting(part: LightSpotPart, models: SpotModels) -> str:
    """The tolerance, and what is left out of the declared spot."""
    left_out = {
        "no cross-talk": models.separate,
        "pixels not integrated": not models.integrated,
        "a point for the spot": models.point and not part.spot.is_point,
        "one wavelength": models.monochromatic and len(part.lines) > 1,
    }
    tolerance = () if models.method == "geometric" else (_percent(models.tolerance),)
    return ", ".join((*tolerance, *(words for words, is_left_out in left_out.items() if is_left_out)))


@dataclass(kw_only=True)
class _Taking:
    """Pictures that are measured as long as the time allows, to be held against a reference when there is one."""

    name: str
    allowance: Allowance
    progress: Progress
    pace: Pace
    left_out: list[str] = field(default_factory=list)
    tried: set[tuple[MethodName, str]] = field(default_factory=set)
    taken: list[tuple[_Run, Timed[ChainImage]]] = field(default_factory=list)

    def allows(self, predicted: float) -> bool:
        """Whether Kirchhoff's pictures that are predicted to take so long may begin, at the pace so far."""
        return self.allowance.allows(self.paced("kirchhoff", predicted))

    def paced(self, method: MethodName, predicted: float) -> float:
        """What is predicted, at the pace so far."""
        return self.pace.of(method) * predicted

    def too_little(self, predicted: float, words: str) -> str:
        """Why nothing is measured: what the least takes, what is left, and what was measured in vain."""
        needed, left = self.paced("kirchhoff", predicted), max(self.allowance.left, 0.0)
        why = (
            f"everything: {words} about {significant(needed, 2)} s at the pace of this machine just now, "
            f"{significant(left, 2)} s are left; a larger --budget measures it"
        )
        alone = "; ".join(
            f"{_words(run)}, took {significant(timed.seconds, 2)} s, with nothing to hold it against"
            for run, timed in self.taken
        )
        return "; ".join(filter(None, (why, alone)))

    def take_beside(self, run: _Run, *, coarser: bool) -> None:
        """Measure one picture by waves that is coarser than the reference, unless that was tried before."""
        if (run.method, run.setting) in self.tried:
            return
        if not coarser:
            self.left_out.append(f"{_words(run)}: the reference is no finer, for which there was no time")
        else:
            self.take(run)

    def take(self, run: _Run, *, before: float = 0.0) -> None:
        """Measure one picture, or note why not; ``before`` are predicted seconds of a reference that is to follow."""
        self.tried.add((run.method, run.setting))
        left = max(self.allowance.left, 0.0)
        self.progress(f"cost: {self.name}", 1.0 - left / self.allowance.seconds)
        needed, kept = self.paced(run.method, run.predicted), self.paced("kirchhoff", before)
        if not self.allowance.allows(needed + kept):
            reference = f", a reference {significant(kept, 2)} s" if kept else ""
            self.left_out.append(f"{_words(run)}: about {significant(needed, 2)} s{reference}, {left:.2g} s are left")
            return
        try:
            timed = measure(lambda _run: run.compute(), self.allowance.keeping(kept))
        except (NotConvergedError, UnaffordableError) as error:
            self.left_out.append(f"{_words(run)}: {error}")
            return
        self.taken.append((run, timed))
        self.pace.learn(run.method, predicted=run.predicted, took=timed.seconds)

    def entries(self, reference: FloatArray) -> tuple[Entry, ...]:
        """All that was measured, law by law."""
        order = [short_title(method) for method in get_args(MethodName)]
        entries = []
        for run, timed in self.taken:
            found = timed.values[0]
            relative = float(np.linalg.norm(found.pixels - reference) / np.linalg.norm(reference))
            entries.append(
                entry_of(
                    timed,
                    model=short_title(run.method),
                    setting=run.setting,
                    evaluations=float(found.effort.get("source points", math.nan)),
                    error=relative,
                    typical_error=relative,
                    chosen=run.chosen,
                )
            )
        return tuple(sorted(entries, key=lambda entry: order.index(entry.model)))
