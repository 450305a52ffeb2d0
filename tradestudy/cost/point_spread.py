"""Image of a point behind one lens: what every propagator costs, and how far it is from direct quadrature."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.analysis.point_spreads import LensAndPoint
from tradestudy.cost.entries import CostTable, Entry, nothing_measured
from tradestudy.cost.measuring import Allowance, entry_of, measure
from tradestudy.errors import NotConvergedError, UnaffordableError
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation import (
    FieldAccuracy,
    KirchhoffKernel,
    Method,
    TargetGrid,
    aperture_field,
    direct_sum,
    lens_wave,
    nodes_for,
    sample_wave,
)
from tradestudy.run.groups.point_spread import METHODS
from tradestudy.study.schema.wave_optics import ElementPart, PointSpreadPart
from tradestudy.units import significant

DIRECT: Final = "Kirchhoff, node by node"
TITLES: Final[dict[Method, str]] = {
    "geometric": "rays",
    "boundary_wave": "boundary wave",
    "fresnel": "Fresnel",
    "kirchhoff": "Kirchhoff",
}
TOLERANCES: Final = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
_REFERENCE_TOLERANCE: Final = 1e-10
_COUNT: Final = 65  # targets to a side; the reference is at every fourth, row and column
_EVERY: Final = 4
_PILOT_COUNT: Final = 5  # targets to a side, from which the reference's seconds follow
_FINER_TAKES: Final = 4.0  # times as long as a setting before, at most, its repeats included
_REFERENCE_SHARE: Final = 0.5  # at most, of what is left, so that models can be held against it


@dataclass(frozen=True, kw_only=True)
class _Lens:
    """A lens of the study as it stands, with its targets and the reference there."""

    case: LensAndPoint
    grid: TargetGrid
    reference: FloatArray


def point_spread_cost(
    part: PointSpreadPart,
    law: str,
    allowance: Allowance,
    progress: Progress,
    tolerances: tuple[float, ...] = TOLERANCES,
) -> CostTable:
    """Cost of the point-spread functions of the study's lenses as they stand, together, at some tolerances.

    ``law`` is the one that a run answers with.
    """
    step = "cost: point_spread"
    progress(step, 0.0)
    title = "Image of a point"
    names = ", ".join(element.title for element in part.elements.values())
    says = (
        f"Intensity at {_COUNT}² places within {part.window:g} Airy radii behind {names}, on the axis: seconds for all "
        "together, checks included; relative L2 error of the worst."
    )
    predicted = _reference_seconds(part)
    if not allowance.allows(predicted / _REFERENCE_SHARE):
        progress(step, 1.0)
        why = (
            f"everything: no time left: a reference takes about {significant(predicted, 2)} s, and is to take at most "
            f"half of the {significant(max(allowance.left, 0.0), 2)} s that are; a larger --budget measures it"
        )
        return nothing_measured("point_spread", title, says, why)
    begin = time.perf_counter()
    built = [_lens(part, element) for element in part.elements.values()]
    lenses, reference_error = [one for one, _ in built], max(error for _, error in built)
    reference_seconds = time.perf_counter() - begin
    entries: list[Entry] = []
    left_out: list[str] = []
    runs = list(_runs(lenses, law, part.tolerance, tolerances))
    # In case the time ends: first what a run answers with, then what a study can ask for, then what is for comparison.
    ways = {TITLES[method]: "point_spread.tolerance, of both laws that a run computes" for method in METHODS}
    for number, (model, setting, compute, chosen) in enumerate(
        sorted(runs, key=lambda run: (not run[-1], run[0] not in ways))
    ):
        progress(step, number / len(runs))
        earlier = [entry.seconds for entry in entries if entry.model == model]
        predicted = _FINER_TAKES * earlier[-1] if earlier else 0.0
        if not allowance.allows(predicted):
            left_out.append(f"{model}, {setting}: {allowance.lacking(predicted)}")
            continue
        try:
            timed = measure(compute, allowance)
        except (NotConvergedError, UnaffordableError) as error:
            left_out.append(f"{model}, {setting}: {error}")
            continue
        found, nodes = timed.values[0]
        errors = [
            float(np.linalg.norm(one[::_EVERY, ::_EVERY] - lens.reference) / np.linalg.norm(lens.reference))
            for one, lens in zip(found, lenses, strict=True)
        ]
        entries.append(
            entry_of(
                timed,
                model=model,
                setting=setting,
                evaluations=nodes,
                error=max(errors),
                typical_error=float(np.median(errors)),
                chosen=chosen,
            )
        )
    progress(step, 1.0)
    order = [(model, setting) for model, setting, _, _ in runs]
    return CostTable(
        name="point_spread",
        title=title,
        says=says,
        reference=f"Kirchhoff's integral summed node by node at {len(range(0, _COUNT, _EVERY))}² of the places, its "
        "error the change on 1.5 times the nodes in each direction",
        reference_error=reference_error,
        reference_seconds=reference_seconds,
        entries=tuple(sorted(entries, key=lambda entry: order.index((entry.model, entry.setting)))),
        left_out=tuple(left_out),
        notes=(
            f"A run computes {' and '.join(TITLES[method] for method in METHODS)}, as each is the other's check; its "
            "answer, which is marked as chosen, is the one that the accuracy wanted calls for.",
        ),
        ways=ways,
    )


def _reference_seconds(part: PointSpreadPart) -> float:
    """Of the reference, by some of its places: all rows, on as many nodes and on 1.5 times as many either way."""
    begin = time.perf_counter()
    for element in part.elements.values():
        case = _case(part, element)
        _direct(case, _targets(part, case, _PILOT_COUNT), _REFERENCE_TOLERANCE)
    rows = len(range(0, _COUNT, _EVERY))
    return (time.perf_counter() - begin) * (rows / _PILOT_COUNT) ** 2 * (1.0 + 1.5**2)


def _case(part: PointSpreadPart, element: ElementPart) -> LensAndPoint:
    return LensAndPoint(
        focal_length=element.focal_length,
        object_distance=element.object_distance,
        f_number=element.f_number,
        wavelength=part.reference_wavelength,
        lens_phase=part.lens_phase,
        field_angle=0.0,
        defocus_waves=0.0,
    )


def _targets(part: PointSpreadPart, case: LensAndPoint, count: int) -> TargetGrid:
    half = part.window * case.airy_radius
    return TargetGrid.centred(
        centre=case.chief_point, pitch=2 * half / (count - 1), count=count, distance=case.image_distance
    )


def _lens(part: PointSpreadPart, element: ElementPart) -> tuple[_Lens, float]:
    case = _case(part, element)
    grid = _targets(part, case, _COUNT)
    coarse, fine = (_direct(case, grid, _REFERENCE_TOLERANCE, factor, _EVERY)[0] for factor in (1.0, 1.5))
    error = float(np.linalg.norm(coarse - fine) / np.linalg.norm(fine))
    return _Lens(case=case, grid=grid, reference=fine), max(error, float(np.finfo(np.float64).eps))


def _direct(
    case: LensAndPoint, grid: TargetGrid, tolerance: float, factor: float = 1.0, every: int = 1
) -> tuple[FloatArray, int]:
    """Intensity by plain quadrature of Kirchhoff's integral, and its nodes."""
    wave = lens_wave(source=case.source, lens=case.lens, wavelength=case.wavelength, paraxial=False, obliquity="paper")
    kernel = KirchhoffKernel(wavelength=case.wavelength, obliquity="paper")
    counts = nodes_for(wave, kernel, grid, FieldAccuracy(tolerance=tolerance)).scaled(factor)
    x, y = np.meshgrid(grid.x_axis[::every], grid.y_axis[::every])
    z = np.full(x.size, case.image_distance)
    field = direct_sum(sample_wave(wave, counts), kernel, x.ravel(), y.ravel(), z)
    return np.asarray(np.abs(field.reshape(x.shape)) ** 2), counts.total


Run = tuple[str, str, Callable[[int], tuple[list[FloatArray], float]], bool]


def _runs(lenses: list[_Lens], law: str, standing: float, wanted: tuple[float, ...]) -> Iterator[Run]:
    """Model, setting, computation, and whether the study answers with it."""
    for method, title in TITLES.items():
        tolerances = (wanted[0],) if method == "geometric" else sorted({*wanted, standing}, reverse=True)
        for tolerance in tolerances:

            def compute(
                _run: int, method: Method = method, tolerance: float = tolerance
            ) -> tuple[list[FloatArray], float]:
                found = [
                    aperture_field(
                        source=lens.case.source,
                        lens=lens.case.lens,
                        targets=lens.grid,
                        wavelength=lens.case.wavelength,
                        method=method,
                        accuracy=FieldAccuracy(tolerance=tolerance),
                    )
                    for lens in lenses
                ]
                return [one.intensity for one in found], float(sum(one.effort.nodes for one in found))

            used = method == law and math.isclose(tolerance, standing)
            yield title, "" if method == "geometric" else f"tolerance {tolerance:.0e}", compute, used
    for tolerance in wanted[::2]:

        def by_nodes(_run: int, tolerance: float = tolerance) -> tuple[list[FloatArray], float]:
            found = [_direct(lens.case, lens.grid, tolerance) for lens in lenses]
            return [intensity for intensity, _ in found], float(sum(nodes for _, nodes in found))

        yield DIRECT, f"nodes for {tolerance:.0e}", by_nodes, False
