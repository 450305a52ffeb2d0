"""Picture of a light spot through both lenses: what every law and tolerance costs, for one point of it and for all."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, get_args

import numpy as np

from tradestudy.cost.entries import Entry, Measured, nothing_measured
from tradestudy.cost.measuring import Allowance, Timed, entry_of, measure
from tradestudy.errors import NotConvergedError, UnaffordableError
from tradestudy.light_methods import short_title
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import ChainAccuracy, ChainImage, DiscSource
from tradestudy.optics.propagation import PointSource
from tradestudy.study.progress import Progress
from tradestudy.study.schema.light_spot import LightSpotPart, MethodName
from tradestudy.study.situations.light_spot import picture_seconds
from tradestudy.study.spot_images import RAYS, SpotModels, compared_models, light_source, picture_of
from tradestudy.units import significant

_WAVES: Final[tuple[MethodName, ...]] = ("kirchhoff", "kirchhoff-fresnel", "fresnel")
_POINT_TOLERANCES: Final = (0.1, 1e-2, 1e-3, 1e-4)
_POINT_REFERENCE: Final = ChainAccuracy(
    tolerance=1e-5, pupil_nodes=1.2, microlens_nodes=1.2, field_sampling=1.2, diffraction_reach=1.2
)
_TOLERANCES: Final = (0.1, 10.0, 1.0)  # of that of the study
_FINEST: Final = 1e-6
_FINER_SOURCE: Final = 1.4  # sampling that keeps the angles of the source below what its points err by; 1.2 does not
_COARSEST: Final = 0.2
_COARSEST_REFERENCE: Final = 0.1
_PACED: Final = 1.0  # seconds from which a prediction tells the pace
_REFERENCE_SEED: Final = 1


def point_cost(part: LightSpotPart, allowance: Allowance, progress: Progress, *, speed: float) -> Measured:
    """Cost of the picture of one point, halfway between the middle and the rim of the spot; see `spot_cost`."""
    x = part.spot.x + part.spot.diameter / 4

    def image(method: MethodName, accuracy: ChainAccuracy, seed: int = 0) -> ChainImage:
        point = PointSource(x=x, y=part.spot.y, distance=part.spot.distance)
        return picture_of(part, point, compared_models(part, method), accuracy=accuracy, seed=seed)

    progress("cost: spot_point", 0.0)
    begin = time.perf_counter()
    reference = image("kirchhoff", _POINT_REFERENCE, _REFERENCE_SEED)
    reference_seconds = time.perf_counter() - begin
    checked = max(reference.direct_check.values(), default=math.nan)
    coarsest = ChainAccuracy(tolerance=_COARSEST)
    runs = [_Run(method="geometric", setting="", predicted=0.0, compute=lambda: image("geometric", coarsest))]
    for tolerance in _POINT_TOLERANCES:
        for method in _WAVES:
            models = replace(compared_models(part, method), tolerance=tolerance, point=True)
            runs.append(
                _Run(
                    method=method,
                    setting=_percent(tolerance),
                    predicted=picture_seconds(part, models) / speed,
                    compute=partial(image, method, ChainAccuracy(tolerance=tolerance)),
                )
            )
    taking = _Taking(name="spot_point", allowance=allowance, progress=progress)
    for run in runs:
        taking.take(run)
    progress("cost: spot_point", 1.0)
    return Measured(
        name="spot_point",
        title="Picture of one point of the spot",
        says="Pixels lit by one point, halfway between the middle and the rim of the spot, through main lens and "
        "microlenses: relative L2 error over the pixels.",
        reference="Kirchhoff on both legs at a tolerance of 1e-5 with 1.2 times the nodes, samples and reach, its "
        f"intensities within {checked:.1e} of direct quadrature at random places",
        reference_error=reference.numerical_error,
        reference_seconds=reference_seconds,
        entries=taking.entries(reference.pixels),
        left_out=tuple(taking.left_out),
    )


def spot_cost(
    part: LightSpotPart, chosen: SpotModels, allowance: Allowance, progress: Progress, *, speed: float, asked: float
) -> Measured:
    """Cost of the picture of the whole spot, as far as the time allows.

    The picture of the study comes first, and tells how fast this machine is just now; then the finest reference that
    leaves time for Kirchhoff's picture at a tenth of the study's tolerance; then that picture, and all others.

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
    """

    def image(models: SpotModels, seed: int = 0, sampling: float = 1.0) -> ChainImage:
        accuracy = ChainAccuracy(tolerance=models.tolerance, source_sampling=sampling)
        source = light_source(part)
        source = source.centre if models.point and isinstance(source, DiscSource) else source
        return picture_of(part, source, models, accuracy=accuracy, seed=seed)

    def run(models: SpotModels) -> _Run:
        return _Run(
            method=models.method,
            setting=_setting(part, models),
            predicted=picture_seconds(part, models) / speed,
            compute=partial(image, models),
            chosen=models == chosen,
        )

    standing = part.tolerance if chosen.method in RAYS else min(part.tolerance, chosen.tolerance)
    best = compared_models(part, "kirchhoff")
    taking = _Taking(name="spot", allowance=allowance, progress=progress)
    coarsest = run(replace(best, tolerance=_COARSEST_REFERENCE))
    if allowance.allows(2.0 * coarsest.predicted + run(chosen).predicted):
        taking.take(run(chosen))
    # Its tolerance, how much more finely the source is sampled, and the tolerance of what shall be held against it.
    wishes = [
        (standing / 20, _FINER_SOURCE, standing / 10),
        (standing / 20, 1.0, standing / 10),
        *((factor * standing, 1.0, standing) for factor in (0.5, 1, 2, 5)),
        (_COARSEST_REFERENCE, 1.0, _COARSEST),
    ]
    finest, sampling = next(
        (
            (tolerance, sampling)
            for tolerance, sampling, held in wishes
            if _FINEST <= tolerance <= _COARSEST_REFERENCE
            and taking.allows(
                sampling**2 * run(replace(best, tolerance=tolerance)).predicted
                + run(replace(best, tolerance=min(held, _COARSEST))).predicted
            )
        ),
        (None, 1.0),
    )
    title = "Picture of the whole spot"
    says = "All pixels of the picture of the spot: relative L2 error over the pixels."
    if finest is None:
        why = (
            f"everything: a reference at {100 * _COARSEST_REFERENCE:g} % and a picture beside it take about "
            f"{taking.paced(2.0 * coarsest.predicted):.0f} s at the pace of this machine just now, "
            f"{max(allowance.left, 0.0):.0f} s are left"
        )
        alone = "; ".join(
            f"{short_title(run.method)}, {run.setting}, took {timed.seconds:.0f} s, with nothing to hold it against"
            for run, timed in taking.taken
        )
        return nothing_measured("spot", title, says, "; ".join(filter(None, (why, alone))))
    begin = time.perf_counter()
    reference = image(replace(best, tolerance=finest), _REFERENCE_SEED, sampling)
    reference_seconds = time.perf_counter() - begin
    for models in _others(part, chosen, standing):
        if models.method not in RAYS and models.tolerance <= finest:
            words = f"{short_title(models.method)}, {_setting(part, models)}"
            taking.left_out.append(f"{words}: the reference is no finer, for which there was no time")
        else:
            taking.take(run(models))
    progress("cost: spot", 1.0)
    entries = taking.entries(reference.pixels)
    return Measured(
        name="spot",
        title=title,
        says=says,
        reference=f"Kirchhoff on both legs at a tolerance of {100 * finest:g} %, its source sampled {sampling:g} times "
        "as finely, with its own stated error",
        reference_error=reference.numerical_error,
        reference_seconds=reference_seconds,
        entries=entries,
        left_out=tuple(taking.left_out),
        notes=tuple(_digit_of_tolerance(entries, standing)),
        asked=asked,
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


@dataclass(frozen=True, kw_only=True)
class _Run:
    """One picture to be measured; ``predicted`` seconds on this machine."""

    method: MethodName
    setting: str
    predicted: float
    compute: Callable[[], ChainImage]
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
    """Pictures that are measured as long as the time allows, to be held against a reference when there is one.

    ``pace`` is the time that pictures take over what is predicted, the longest of those measured so far.
    """

    name: str
    allowance: Allowance
    progress: Progress
    left_out: list[str] = field(default_factory=list)
    taken: list[tuple[_Run, Timed[ChainImage]]] = field(default_factory=list)
    pace: float = math.nan

    def allows(self, predicted: float) -> bool:
        """Whether computations that are predicted to take so long may begin, at the pace so far."""
        return self.allowance.allows(self.paced(predicted))

    def paced(self, predicted: float) -> float:
        """What is predicted, at the pace so far."""
        return predicted if math.isnan(self.pace) else self.pace * predicted

    def take(self, run: _Run) -> None:
        """Measure one picture, or note why not."""
        left = max(self.allowance.left, 0.0)
        self.progress(f"cost: {self.name}", 1.0 - left / self.allowance.seconds)
        words = ", ".join(part for part in (short_title(run.method), run.setting) if part)
        if not self.allows(run.predicted):
            self.left_out.append(f"{words}: about {self.paced(run.predicted):.0f} s, {left:.0f} s are left")
            return
        try:
            timed = measure(lambda _run: run.compute(), self.allowance)
        except (NotConvergedError, UnaffordableError) as error:
            self.left_out.append(f"{words}: {error}")
            return
        self.taken.append((run, timed))
        if run.predicted > _PACED:
            self.pace = max(timed.seconds / run.predicted, 0.0 if math.isnan(self.pace) else self.pace)

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
