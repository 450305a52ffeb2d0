"""How long a study will take, step by step, before any of it is computed: counts of work times seconds per unit."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from tradestudy.cameras.declaration import DepthCameraDeclaration
from tradestudy.effects.models import Models
from tradestudy.errors import OutOfRangeError
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.light_spot import LightSpotPart, MethodName
from tradestudy.study.schema.questions import ImageDifferenceClaim, LitPixelsClaim
from tradestudy.study.schema.wave_optics import FresnelValidityPart, PointSpreadPart
from tradestudy.study.sweep import sweep_axes
from tradestudy.wording import counted

# Runs differ by as much in the seconds of one unit; a range that a sampler states holds them.
_UNITS_VARY: Final = 1.5
# Seconds per unit of work on the reference machine (speed 1): processor seconds, so that what else ran on it while it
# was measured does not count. `python tests/benchmarks/step_costs.py` measures them through runs of the shipped
# studies and holds every prediction against its run.
SECONDS: Final[Mapping[str, float]] = {
    "libraries": 2.6,
    "study read again": 0.020,  # a reading, a design of a sweep, a trial of an inverse question
    "camera": 0.015,
    "camera at a distance": 4e-5,
    "pair of cameras": 0.13,
    "pair of cameras, ranked": 0.7,
    "trial of an inverse question": 0.040,
    "claim about depth": 0.02,
    "camera's depth of field": 0.007,
    "inference step of an ensemble": 2.2e-3,
    "distribution": 0.02,  # drawn: what moves it most is found first
    "draw": 2.5e-6,  # of all errors of a camera
    "draw at a distance": 2.0e-7,
    "Fresnel against Kirchhoff on axis": 0.095,
    "root of a limit": 0.06,
    "Fresnel against Kirchhoff off axis": 6.0,
    "aperture of 256² targets": 0.035,
    "source point through both lenses": 1.4,
    "point spread": 0.28,
    "hard case": 0.012,
    "report": 2.0,
    "figure": 0.42,
}

_WAYS: Final = 2  # with calibration errors, of three; noise alone is not drawn
_FIRST_DRAWS: Final = 8 * 256  # of an adaptive propagation, over all scrambles
_FIRST_STEPS: Final = 1000  # of an ensemble, before the first look
_ENSEMBLES: Final = 4
_TORNADO_DRAWS: Final = 2**14
_MORE_SOURCES: Final = 2  # of a camera: the noise of a measurement, and what is inferred during the run
_ROOT_TRIALS: Final = 24  # of a root finder
_MOST_WEIGHED: Final = 64  # designs of a sweep that models are chosen for


@dataclass(frozen=True, kw_only=True)
class PredictedStep:
    """One step of a run.

    Parameters
    ----------
    name
        As the run's progress calls it.
    low, high
        Seconds; equal for fixed work. Samplers that stop when they have converged take anything between.
    work
        What is counted, in words.
    """

    name: str
    low: float
    high: float
    work: str


def predicted_seconds(definition: StudyDefinition, speed: float) -> tuple[PredictedStep, ...]:
    """Predict every step of a run, the writing of its report included, one worker computing.

    Parameters
    ----------
    definition
        The study.
    speed
        Of this machine over that of the reference machine (`tradestudy.machine.machine_speed`).

    Raises
    ------
    OutOfRangeError
        If the speed is not positive.
    """
    if not 0.0 < speed < math.inf:
        raise OutOfRangeError("speed of the machine", value=f"{speed:g}", limit="> 0, finite")
    return tuple(
        PredictedStep(name=step.name, low=step.low / speed, high=step.high / speed, work=step.work)
        for step in _steps(definition)
    )


def _steps(definition: StudyDefinition) -> Iterator[PredictedStep]:
    """In the order of a run, on the reference machine."""
    file = definition.file
    readings, designs = len(file.readings), _designs(definition)
    yield _fixed(
        "start",
        f"libraries, the study and {counted(readings, 'reading')} of it",
        {"libraries": 1, "study read again": readings + (min(designs, _MOST_WEIGHED) if file.sweep else 0)},
    )
    if definition.case.cameras:
        yield from _calibrations(definition)
        yield from _depth(definition)
    if file.depth_of_field is not None:
        cameras = len(definition.case.all_cameras)
        yield _fixed("depth of field", counted(cameras, "camera"), {"camera's depth of field": cameras})
    if file.fresnel_validity is not None:
        yield from _fresnel_validity(file.fresnel_validity)
    if file.light_spot is not None:
        yield from _light_spot(file.light_spot, definition.models)
    if file.point_spread is not None:
        points = _points(file.point_spread)
        yield _fixed("point spread", f"{points} point-spread functions", {"point spread": points})
    if file.hard_cases is not None:
        yield _hard_cases(file.hard_cases.families)
    if file.claims or file.requirements:
        yield _claims(definition)
    yield _report(definition)


def _fixed(name: str, work: str, counts: Mapping[str, float]) -> PredictedStep:
    seconds = _seconds(counts)
    return PredictedStep(name=name, low=seconds, high=seconds, work=work)


def _seconds(counts: Mapping[str, float]) -> float:
    return math.fsum(SECONDS[unit] * count for unit, count in counts.items())


def _depth(definition: StudyDefinition) -> Iterator[PredictedStep]:
    """Depth on the axis and beside it, and what is decided from it; exact cameras draw until they have converged."""
    file, case = definition.file, definition.case
    cameras, distances = len(case.cameras), case.distance.size
    exact = sum(camera.propagation.model == "exact" for camera in case.cameras.values())
    designs = _designs(definition)
    yield _sampled(
        "depth",
        f"{counted(designs, 'design')} of {counted(cameras, 'camera')} at {counted(distances, 'distance')}",
        {
            "study read again": designs if file.sweep else 0,
            "camera": designs * cameras,
            "camera at a distance": designs * cameras * distances,
        },
        *_exact(definition, designs * exact, distances),
    )
    if places := len(file.propagation.field_places):
        yield _sampled(
            "depth off the axis",
            f"{counted(places, 'place')} of {counted(cameras, 'camera')} at {counted(distances, 'distance')}",
            {"camera": places * cameras, "camera at a distance": places * cameras * distances},
            *_exact(definition, places * exact, distances),
        )
    readings = 1 + len(file.readings)
    pairs = readings if file.decision is not None else 0
    trials = _ROOT_TRIALS * len(file.solve)
    yield _fixed(
        "decision",
        f"a pair of cameras under {counted(pairs, 'reading')}, {counted(len(file.solve), 'inverse question')}",
        {"pair of cameras": pairs, "trial of an inverse question": trials, "camera": cameras if file.sweep else 0},
    )
    if file.decision is not None:
        compared = len(file.decision.compare or (file.decision.between,))
        yield _fixed("ranks", counted(compared, "pair"), {"pair of cameras, ranked": compared})
    if file.sensitivity is not None:
        asked = len(file.sensitivity.at)
        groups = sum(_MORE_SOURCES + len(camera.calibration.groups) for camera in case.cameras.values())
        sources = groups * (1 + len(file.propagation.field_places))
        yield _sampled(
            "sensitivity",
            f"{counted(cameras, 'camera')} at {counted(asked, 'distance')}",
            {},
            _draws(sources, _FIRST_DRAWS, asked),
            _draws(sources, _TORNADO_DRAWS, asked),
        )


def _designs(definition: StudyDefinition) -> int:
    return math.prod(len(axis.values) for axis in sweep_axes(definition))


def _exact(definition: StudyDefinition, cameras: float, distances: int) -> tuple[Mapping[str, float], ...]:
    """Fewest and most work of drawing so many exact cameras; how many draws are enough is found at a few distances."""
    propagation, scene = definition.file.propagation, definition.case.cameras.values()
    judged = max((len(camera.propagation.judged) for camera in scene), default=0)
    distributions = _WAYS * cameras
    return (
        _draws(distributions, _FIRST_DRAWS, distances + judged),
        _draws(distributions, 2.0 * max(propagation.max_draws, _FIRST_DRAWS), distances + judged),
    )


def _draws(distributions: float, draws: float, distances: int) -> Mapping[str, float]:
    """So many draws of each distribution, read at distances."""
    return {
        "distribution": distributions,
        "draw": distributions * draws,
        "draw at a distance": distributions * draws * distances,
    }


def _calibrations(definition: StudyDefinition) -> Iterator[PredictedStep]:
    """Posteriors, whose samplers stop when they have converged."""
    parts = [part for part in definition.file.cameras.values() if isinstance(part, DepthCameraDeclaration)]
    inferred = [part.calibration.target or part.calibration.corners for part in parts]
    steps = [one.max_steps for one in inferred if one is not None]
    if steps:
        yield _sampled(
            "calibration",
            f"{counted(len(steps), 'posterior')}, {_FIRST_STEPS} to {max(steps)} steps of {_ENSEMBLES} ensembles each",
            {},
            {"inference step of an ensemble": _ENSEMBLES * len(steps) * _FIRST_STEPS},
            {"inference step of an ensemble": _ENSEMBLES * sum(steps)},
        )


def _sampled(
    name: str, work: str, fixed: Mapping[str, float], least: Mapping[str, float], most: Mapping[str, float]
) -> PredictedStep:
    """Fixed work, and a range of what stops when it has converged; no range where nothing is drawn."""
    known = _seconds(fixed)
    low, high = known + _seconds(least), known + _seconds(most)
    if low == high:
        return PredictedStep(name=name, low=known, high=known, work=work)
    return PredictedStep(name=name, low=low / _UNITS_VARY, high=high * _UNITS_VARY, work=work)


def _fresnel_validity(part: FresnelValidityPart) -> Iterator[PredictedStep]:
    elements, f_numbers = len(part.elements), len(part.f_numbers.values())
    on_axis = elements * len(part.wavelengths) * (f_numbers + 2)
    yield _fixed(
        "Fresnel against Kirchhoff, on axis",
        f"{counted(on_axis, 'pair')} of point-spread functions",
        {"Fresnel against Kirchhoff on axis": on_axis},
    )
    limits = elements * len(part.lens_phases) * len(part.wavelengths) * (1 + 2 * len(part.windows))
    yield _fixed("f-numbers at the limit", counted(limits, "root"), {"root of a limit": limits})
    if part.off_axis is not None:
        off_axis = elements * (f_numbers + 1)
        yield _fixed(
            "Fresnel against Kirchhoff, off axis",
            f"{counted(off_axis, 'pair')} of point-spread functions",
            {"Fresnel against Kirchhoff off axis": off_axis},
        )


def _light_spot(part: LightSpotPart, models: Mapping[str, Models]) -> Iterator[PredictedStep]:
    """Pictures by the methods that are compared, and by the chosen models where that is another."""
    from tradestudy.analysis.spot_images import compared_models
    from tradestudy.plan.situations.light_spot import NAME, named_spot_models, picture_seconds

    asked = [compared_models(part, method) for method in part.methods]
    names = models.get(NAME)
    if names and (chosen := named_spot_models(part, names)) not in asked:
        asked.append(chosen)
    seconds = math.fsum(picture_seconds(part, models) for models in asked)
    yield PredictedStep(
        name="image of the spot",
        low=seconds,
        high=seconds,
        work=f"{counted(len(asked), 'picture')}: "
        + ", ".join(f"{models.method} to {models.tolerance:g}" for models in asked),
    )
    if part.benchmarks:
        yield _fixed(
            "benchmarks of light",
            "18 apertures, one source point",
            {"aperture of 256² targets": 18, "source point through both lenses": 1},
        )


def _points(part: PointSpreadPart) -> int:
    varied = (part.f_numbers, part.wavelengths, part.field_angles, part.defocus)
    return 2 * len(part.elements) * sum(map(len, varied))


def _hard_cases(names: tuple[str, ...]) -> PredictedStep:
    from tradestudy.verification.hard_case_families import all_families

    cases = sum(len(family.cases) for family in all_families() if family.name in names)
    return _fixed("hard cases", f"{cases} cases", {"hard case": cases})


def _claims(definition: StudyDefinition) -> PredictedStep:
    """Claims about depth under each reading, and images of the spot that a reading asks for anew."""
    file, readings = definition.file, {"": definition, **definition.readings}
    asked = [
        (claim, list(readings) if claim.under == "all" else [claim.reading or "", *claim.under])
        for claim in file.claims.values()
    ]
    answers = sum(len(names) for _, names in asked)
    seconds = _seconds({"claim about depth": answers + len(file.requirements)})
    if file.light_spot is not None:
        pictures = (
            (readings[name].file.light_spot, method)
            for claim, names in asked
            if isinstance(claim, ImageDifferenceClaim | LitPixelsClaim)
            for name, method in itertools.product(names, (claim.method, claim.reference))
        )
        seconds += _pictures_beside(file.light_spot, pictures)
    return PredictedStep(name="claims", low=seconds, high=seconds, work=f"{answers} claims under their readings")


def _pictures_beside(declared: LightSpotPart, asked: Iterable[tuple[LightSpotPart | None, MethodName]]) -> float:
    """Seconds of the pictures of spots that are none of those that the study compares, each counted once."""
    from tradestudy.analysis.spot_images import compared_models, without_comparison
    from tradestudy.plan.situations.light_spot import picture_seconds

    known = {(without_comparison(declared), declared.tolerance, method) for method in declared.methods}
    seconds = 0.0
    for spot, method in asked:
        if spot is not None and (key := (without_comparison(spot), spot.tolerance, method)) not in known:
            known.add(key)
            seconds += picture_seconds(spot, compared_models(spot, method))
    return seconds


def _report(definition: StudyDefinition) -> PredictedStep:
    """Figures are most of a report."""
    file = definition.file
    figures = (
        4 * bool(definition.case.cameras)
        + 2 * bool(file.sweep)
        + bool(file.decision)
        + 2 * (file.sensitivity is not None)
        + 3 * (file.depth_of_field is not None)
        + 4 * (file.fresnel_validity is not None)
        + 2 * (file.light_spot is not None)
        + (file.point_spread is not None)
        + (file.hard_cases is not None)
    )
    return _fixed("report", f"about {figures} figures, HTML and PDF", {"report": 1, "figure": figures})
