"""Picture of a light spot through both lenses: what every law and tolerance costs, for one point of it and for all."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, get_args

import numpy as np

from tradestudy.cost.entries import Entry, Measured, nothing_measured
from tradestudy.cost.measuring import Allowance, entry_of, measure
from tradestudy.errors import NotConvergedError, UnaffordableError
from tradestudy.light_methods import short_title
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import ChainAccuracy, ChainImage, DiscSource
from tradestudy.optics.propagation import PointSource
from tradestudy.study.progress import Progress
from tradestudy.study.schema.light_spot import LightSpotPart, MethodName
from tradestudy.study.situations.light_spot import picture_seconds
from tradestudy.study.spot_images import RAYS, SpotModels, compared_models, light_source, picture_of

_WAVES: Final[tuple[MethodName, ...]] = ("kirchhoff", "kirchhoff-fresnel", "fresnel")
_POINT_TOLERANCES: Final = (0.1, 1e-2, 1e-3, 1e-4)
_POINT_REFERENCE: Final = ChainAccuracy(
    tolerance=1e-5, pupil_nodes=1.2, microlens_nodes=1.2, field_sampling=1.2, diffraction_reach=1.2
)
_SPOT_TOLERANCES: Final = (0.2, 0.05)
_COARSEST: Final = 0.2
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
    entries, left_out = _measured("spot_point", runs, reference.pixels, allowance, progress)
    return Measured(
        name="spot_point",
        title="Picture of one point of the spot",
        says="Pixels lit by one point, halfway between the middle and the rim of the spot, through main lens and "
        "microlenses: relative L2 error over the pixels.",
        reference="Kirchhoff on both legs at a tolerance of 1e-5 with 1.2 times the nodes, samples and reach, its "
        f"intensities within {checked:.1e} of direct quadrature at random places",
        reference_error=reference.numerical_error,
        reference_seconds=reference_seconds,
        entries=entries,
        left_out=left_out,
    )


def spot_cost(
    part: LightSpotPart, chosen: SpotModels, allowance: Allowance, progress: Progress, *, speed: float
) -> Measured:
    """Cost of the picture of the whole spot, as far as the time allows.

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
    """

    def image(models: SpotModels, seed: int = 0) -> ChainImage:
        accuracy = ChainAccuracy(tolerance=models.tolerance)
        source = light_source(part)
        source = source.centre if models.point and isinstance(source, DiscSource) else source
        return picture_of(part, source, models, accuracy=accuracy, seed=seed)

    def predicted(models: SpotModels) -> float:
        return picture_seconds(part, models) / speed

    title, name = "Picture of the whole spot", "spot"
    standing = part.tolerance if chosen.method in RAYS else min(part.tolerance, chosen.tolerance)
    says = "All pixels of the picture of the spot: relative L2 error over the pixels."
    best = compared_models(part, "kirchhoff")
    progress("cost: spot", 0.0)
    # The finest reference of which the time allows two, so that something is left to be held against it.
    finest = next(
        (
            tolerance
            for tolerance in (standing / 2, standing, 2 * standing, 5 * standing, 0.1)
            if tolerance <= 0.1 and allowance.allows(2.0 * predicted(replace(best, tolerance=tolerance)))
        ),
        None,
    )
    if finest is None:
        needed = predicted(replace(best, tolerance=0.1))
        why = f"everything: a reference at 10 % alone takes about {needed:.0f} s, {allowance.left:.0f} s are left"
        return nothing_measured(name, title, says, why)
    begin = time.perf_counter()
    reference = image(replace(best, tolerance=finest), _REFERENCE_SEED)
    reference_seconds = time.perf_counter() - begin
    runs: list[_Run] = []
    too_fine: list[str] = []
    for models in _asked(part, chosen):
        setting = _setting(part, models)
        if models.method not in RAYS and models.tolerance <= finest:
            too_fine.append(f"{short_title(models.method)}, {setting}: the reference is no finer")
            continue
        runs.append(
            _Run(
                method=models.method,
                setting=setting,
                predicted=predicted(models),
                compute=partial(image, models),
                chosen=models == chosen,
            )
        )
    entries, left_out = _measured(name, runs, reference.pixels, allowance, progress)
    return Measured(
        name=name,
        title=title,
        says=says,
        reference=f"Kirchhoff on both legs at a tolerance of {100 * finest:g} %, with its own stated error",
        reference_error=reference.numerical_error,
        reference_seconds=reference_seconds,
        entries=entries,
        left_out=(*too_fine, *left_out),
    )


def _asked(part: LightSpotPart, chosen: SpotModels) -> Iterator[SpotModels]:
    """The study's own picture first, in case the time ends; then every law at every tolerance with nothing left out."""
    yield chosen
    if not part.spot.coherent:
        for method in RAYS:
            rays = replace(compared_models(part, method), tolerance=chosen.tolerance)
            if rays != chosen:
                yield rays
    for tolerance in dict.fromkeys((part.tolerance, *_SPOT_TOLERANCES)):
        for method in _WAVES:
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


def _measured(
    name: str, runs: Sequence[_Run], reference: FloatArray, allowance: Allowance, progress: Progress
) -> tuple[tuple[Entry, ...], tuple[str, ...]]:
    """Entries of all runs that the time allows, and the words for those that it does not."""
    entries: list[Entry] = []
    left_out: list[str] = []
    slower = 1.0  # than predicted, so far
    for number, run in enumerate(runs):
        progress(f"cost: {name}", number / len(runs))
        words = ", ".join(part for part in (short_title(run.method), run.setting) if part)
        needed = slower * run.predicted
        if not allowance.allows(needed):
            left_out.append(f"{words}: about {needed:.0f} s, {max(allowance.left, 0.0):.0f} s are left")
            continue
        try:
            timed = measure(lambda _run, compute=run.compute: compute(), allowance)  # type: ignore[misc]  # bound at once
        except (NotConvergedError, UnaffordableError) as error:
            left_out.append(f"{words}: {error}")
            continue
        if run.predicted > 1.0:
            slower = max(1.0, timed.seconds / run.predicted)
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
    progress(f"cost: {name}", 1.0)
    order = [short_title(method) for method in get_args(MethodName)]
    return tuple(sorted(entries, key=lambda entry: order.index(entry.model))), tuple(left_out)
