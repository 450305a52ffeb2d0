"""Picture of a light spot through both lenses: what every law and tolerance costs, for one point of it and for all."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.cost.entries import Entry, Measured
from tradestudy.cost.measuring import Allowance, entry_of, measure
from tradestudy.errors import NotConvergedError, UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import ChainAccuracy, ChainImage
from tradestudy.optics.propagation import PointSource
from tradestudy.study.progress import Progress
from tradestudy.study.schema.light_spot import LightSpotPart, MethodName
from tradestudy.study.situations.light_spot import picture_seconds
from tradestudy.study.spot_images import compared_models, light_source, picture_of

TITLES: Final[dict[MethodName, str]] = {
    "geometric": "rays",
    "fresnel": "Fresnel",
    "kirchhoff-fresnel": "Kirchhoff + Fresnel",
    "kirchhoff": "Kirchhoff",
}
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
    runs: list[_Run] = [("geometric", math.nan, lambda: image("geometric", ChainAccuracy(tolerance=_COARSEST)))]
    runs += [
        (method, tolerance, _later(image, method, ChainAccuracy(tolerance=tolerance)))
        for tolerance in _POINT_TOLERANCES
        for method in _WAVES
    ]
    entries, left_out = _measured(
        "spot_point",
        runs,
        reference.pixels,
        allowance,
        progress,
        predicted=lambda method, tolerance: _predicted(part, method, tolerance, speed, point=True),
    )
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


def spot_cost(part: LightSpotPart, allowance: Allowance, progress: Progress, *, speed: float) -> Measured:
    """Cost of the picture of the whole spot, as far as the time allows.

    Parameters
    ----------
    part
        The light path.
    allowance
        Time and repeats.
    progress
        Called with the step and the share done.
    speed
        Of this machine, for what is predicted.
    """

    def image(method: MethodName, tolerance: float, seed: int = 0) -> ChainImage:
        accuracy = ChainAccuracy(tolerance=tolerance)
        return picture_of(part, light_source(part), compared_models(part, method), accuracy=accuracy, seed=seed)

    title, name, standing = "Picture of the whole spot", "spot", part.tolerance
    says = "All pixels of the picture of the spot: relative L2 error over the pixels."
    progress("cost: spot", 0.0)
    # The finest reference of which the time allows two, so that something is left to be held against it.
    finest = next(
        (
            tolerance
            for tolerance in (standing / 2, standing, 2 * standing, 5 * standing, 0.1)
            if tolerance <= 0.1 and allowance.allows(2.0 * _predicted(part, "kirchhoff", tolerance, speed))
        ),
        None,
    )
    if finest is None:
        needed = 2.0 * _predicted(part, "kirchhoff", 0.1, speed)
        why = f"everything: a reference at 10 % alone takes about {needed / 2:.0f} s, {allowance.left:.0f} s are left"
        return Measured(
            name=name,
            title=title,
            says=says,
            reference="none",
            reference_error=math.nan,
            reference_seconds=math.nan,
            entries=(),
            left_out=(why,),
        )
    begin = time.perf_counter()
    reference = image("kirchhoff", finest, _REFERENCE_SEED)
    reference_seconds = time.perf_counter() - begin
    tolerances = list(dict.fromkeys((standing, *_SPOT_TOLERANCES)))  # the study's own first, in case the time ends
    asked: list[tuple[MethodName, float]] = [
        *(() if part.spot.coherent else (("geometric", math.nan),)),
        *((m, t) for t in tolerances for m in _WAVES if t > finest),
    ]
    left_out = [
        f"{TITLES[m]}, {_setting(t)}: the reference is no finer" for t in tolerances for m in _WAVES if t <= finest
    ]
    runs: list[_Run] = [
        (method, tolerance, _later(image, method, _tolerance(tolerance))) for method, tolerance in asked
    ]
    entries, missing = _measured(
        name,
        runs,
        reference.pixels,
        allowance,
        progress,
        chosen=lambda method, tolerance: (
            method in part.methods and (math.isnan(tolerance) or math.isclose(tolerance, standing))
        ),
        predicted=lambda method, tolerance: _predicted(part, method, tolerance, speed),
    )
    return Measured(
        name=name,
        title=title,
        says=says,
        reference=f"Kirchhoff on both legs at a tolerance of {100 * finest:g} %, with its own stated error",
        reference_error=reference.numerical_error,
        reference_seconds=reference_seconds,
        entries=entries,
        left_out=(*left_out, *missing),
    )


_Run = tuple[MethodName, float, Callable[[], ChainImage]]


def _later(image: Callable[..., ChainImage], method: MethodName, accuracy: object) -> Callable[[], ChainImage]:
    return lambda: image(method, accuracy)


def _predicted(
    part: LightSpotPart, method: MethodName, tolerance: float, speed: float, *, point: bool = False
) -> float:
    models = compared_models(part, method)
    models = replace(models, tolerance=_tolerance(tolerance), point=point or models.point)
    return picture_seconds(part, models) / speed


def _tolerance(of_entry: float) -> float:
    """Rays have none, and take any."""
    return _COARSEST if math.isnan(of_entry) else of_entry


def _setting(tolerance: float) -> str:
    return "" if math.isnan(tolerance) else f"tolerance {100 * tolerance:g} %"


def _measured(
    name: str,
    runs: Sequence[_Run],
    reference: FloatArray,
    allowance: Allowance,
    progress: Progress,
    *,
    chosen: Callable[[MethodName, float], bool] = lambda _method, _tolerance: False,
    predicted: Callable[[MethodName, float], float] = lambda _method, _tolerance: 0.0,
) -> tuple[tuple[Entry, ...], tuple[str, ...]]:
    """Entries of all runs that the time allows, and the words for those that it does not."""
    entries: list[Entry] = []
    left_out: list[str] = []
    slower = 1.0  # than predicted, so far
    for number, (method, tolerance, compute) in enumerate(runs):
        progress(f"cost: {name}", number / len(runs))
        words = ", ".join(part for part in (TITLES[method], _setting(tolerance)) if part)
        needed = slower * predicted(method, tolerance)
        if not allowance.allows(needed):
            left_out.append(f"{words}: about {needed:.0f} s, {max(allowance.left, 0.0):.0f} s are left")
            continue
        try:
            timed = measure(lambda _run, compute=compute: compute(), allowance)  # type: ignore[misc]  # bound at once
        except (NotConvergedError, UnaffordableError) as error:
            left_out.append(f"{words}: {error}")
            continue
        if predicted(method, tolerance) > 1.0:
            slower = max(1.0, timed.seconds / predicted(method, tolerance))
        found = timed.values[0]
        relative = float(np.linalg.norm(found.pixels - reference) / np.linalg.norm(reference))
        entries.append(
            entry_of(
                timed,
                model=TITLES[method],
                setting=_setting(tolerance),
                evaluations=float(found.effort.get("source points", math.nan)),
                error=relative,
                typical_error=relative,
                chosen=chosen(method, tolerance),
            )
        )
    progress(f"cost: {name}", 1.0)
    order = list(TITLES.values())
    return tuple(sorted(entries, key=lambda entry: order.index(entry.model))), tuple(left_out)
