"""Pilots: small samples of every kind of work in a run, which are timed and scaled by their counts."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from tradestudy import study
from tradestudy.analysis.depth_draws import (
    DRAWN,
    expected_rounds,
    outcome_model,
    trial_distribution,
    uncertain_groups,
    uncertain_sources,
)
from tradestudy.analysis.depth_points import DepthPoint, depth_table
from tradestudy.analysis.ranks import DRAWS_OF_A_RANK, RANK_ERROR_SOURCES
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.errors import TradestudyError
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.document import Place
from tradestudy.study.source import compose

if TYPE_CHECKING:
    from tradestudy.calibration.posteriors import CornersToInfer
    from tradestudy.calibration.target.camera_target import TargetToInfer
    from tradestudy.imaging.kirchhoff import LatticePoint
    from tradestudy.study.schema.wave_optics import ElementPart, FresnelValidityPart, PointSpreadPart

Value = TypeVar("Value")
Clocks = Sequence[Callable[[], float]]

_FEWEST, _FEW = 3, 12  # distances in two samples of a camera's table, whose time grows linearly beyond
_HALF_STEPS_OF_A_PILOT: Final = 6
# Moving the walkers and diagnosing the chains is mixed interpreter work, like parsing a study; see `parsing_seconds`.
_PARSED_IN_A_TARGET: Final = 290
_PARSED_IN_A_RIG: Final = 390  # with the loading of the libraries
_FITS_OF_A_RIG: Final = 250  # first fits of one of its cameras; it is refitted, and so are its views to check draws
_DRAWS_OF_A_PILOT: Final = 2**8
_ROUNDS_OF_A_PILOT: Final = 4
_DRAWS_OF_A_BAR: Final = 2**12  # of a tornado, and of each of the sets from which Sobol indices are computed
_SMALLER: Final = 4.0  # factor by which the windows of a pilot off the axis are smaller than the requested ones
_GROWTH: Final = 1.1  # exponent of the time of a field in its number of targets


def timed(work: Callable[[], Value], clocks: Clocks = (time.process_time, time.perf_counter)) -> tuple[Value, float]:
    """The value of one call, and its time [s].

    It is processor time, since wall time of so short a call would depend on other programs, unless several threads
    share the work; then it is wall time, which is too long beside other programs.
    """
    begin = [clock() for clock in clocks]
    value = work()
    return value, min(clock() - before for clock, before in zip(clocks, begin, strict=True))


def seconds_of(work: Callable[[], object]) -> float:
    """Time of one call [s]; see `timed`."""
    return timed(work)[1]


def parsing_seconds() -> float:
    """Time to parse a small study: mixed interpreter work, like drawing figures and typesetting pages."""
    text = Path(study.__file__).with_name("starter.yaml").read_text(encoding="utf-8")
    # Parsed texts are cached, so every one must differ.
    return min(seconds_of(partial(compose, f"{text}# {time.perf_counter_ns()}\n", Place("", 1, 1))) for _ in range(2))


def table_seconds(camera: DepthCamera, criteria: UsableCriteria, distance: FloatArray) -> float:
    """Time for one camera's table over its distances [m], without draws; scaled from a few if its error is derived."""
    model = "off" if camera.propagation.model == "exact" else camera.propagation.model
    plain = _without_kirchhoff(replace(camera, propagation=replace(camera.propagation, model=model)))

    def at(count: int) -> float:
        some = distance[np.unique(np.linspace(0, distance.size - 1, count).round().astype(int))]
        return seconds_of(lambda: depth_table(DepthPoint(camera=plain, criteria=criteria, distance=some)))

    if not isinstance(camera.disparity_error_px, PictureDisparityError) or distance.size <= _FEW:
        return at(distance.size)
    fewest, few = at(_FEWEST), at(_FEW)
    return few + max(0.0, few - fewest) * (distance.size - _FEW) / (_FEW - _FEWEST)


def _without_kirchhoff(camera: DepthCamera) -> DepthCamera:
    """The camera with Fresnel instead of Kirchhoff, whose corrections `correction_seconds` covers."""
    law = camera.disparity_error_px
    if not isinstance(law, PictureDisparityError):
        return camera
    models = law.models
    if models.main_lens_diffraction == "kirchhoff":
        models = replace(models, main_lens_diffraction="fresnel")
    if models.microlens_diffraction == "kirchhoff":
        models = replace(models, microlens_diffraction="fresnel")
    return replace(camera, disparity_error_px=replace(law, models=models))


def drawing_seconds(camera: DepthCamera, distances: int, fields: tuple[FieldPosition, ...] = (0.0,)) -> float:
    """Additional time for the draws of an exact calibration at field positions, from the first draws."""
    if camera.propagation.model != "exact" or not camera.calibration.groups:
        return 0.0
    camera = _without_kirchhoff(camera)
    fixed, drawn, read = _seconds_of_rounds(camera)
    wider = distances / max(1, len(camera.propagation.judged))
    expected = [expected_rounds(camera, field, error_source) for field in fields for error_source in DRAWN]
    # The first draws are known. Draws double until there are enough of them; then depth is read at every distance.
    return math.fsum(
        fixed * (math.log2(rounds) + wider) + drawn * 2.0 * (rounds - 1.0) + read * rounds * wider
        for rounds in expected
    )


@lru_cache(maxsize=1024)
def _seconds_of_rounds(camera: DepthCamera) -> tuple[float, float, float]:
    """Time of a distribution at the judged distances without its draws, and the times that each round of draws adds.

    A round has as many draws as the first ones. It adds time to draw and to read depth, or only to read it if the draws
    are known.
    """
    judged = np.array(camera.propagation.judged, dtype=np.float64)

    def timed_rounds(rounds: int) -> float:
        return seconds_of(lambda: trial_distribution(camera, judged, 0.0, DRAWN[-1], rounds))

    first = min(timed_rounds(1), timed_rounds(1))  # the second call knows the draws
    drawn, read = ((timed_rounds(_ROUNDS_OF_A_PILOT) - first) / (_ROUNDS_OF_A_PILOT - 1) for _ in range(2))
    return max(0.0, first - read), max(0.0, drawn), max(0.0, read)


def seconds_per_draw(camera: DepthCamera, distance: FloatArray) -> float:
    """Time to draw a camera's errors once and to measure depth with them at distances [m]."""
    camera = _without_kirchhoff(camera)
    model, sources = outcome_model(camera, distance), uncertain_sources(camera, "both")
    scores = np.random.default_rng(0).standard_normal((sources.dimensions, _DRAWS_OF_A_PILOT))
    seconds = min(seconds_of(lambda: model(sources.draw(scores))) for _ in range(2))  # the first fills caches
    return seconds / _DRAWS_OF_A_PILOT


def ranking_seconds(camera: DepthCamera, distance: FloatArray) -> float:
    """Time for one camera's part in the ranks of a pair at distances [m]."""
    return len(RANK_ERROR_SOURCES) * DRAWS_OF_A_RANK * seconds_per_draw(camera, distance)


def sensitivity_seconds(
    camera: DepthCamera, distance: FloatArray, fields: Sequence[float], *, inferred: bool = False
) -> float:
    """Time to find how much each error source contributes to a camera's depth uncertainty.

    If the run has yet to infer the calibration, it becomes one source besides the noise, whatever its priors are.
    """
    parameters = [2, 1] if inferred else [len(group.parameters) for group in uncertain_groups(camera, "both")]
    bars = 2 if max(parameters) == 1 else 1  # of each source, and of each parameter unless parameters are correlated
    sets = bars * len(parameters) + len(parameters) + 2
    return len(fields) * sets * _DRAWS_OF_A_BAR * seconds_per_draw(camera, distance)


def correction_seconds(points: Sequence[LatticePoint]) -> float:
    """Time for Kirchhoff's corrections at all points of a lattice, from some of them, whose results are cached."""
    from tradestudy.imaging.kirchhoff import kirchhoff_correction

    some = [points[k] for k in sorted({len(points) // 4, len(points) // 2, 3 * len(points) // 4})]
    return len(points) * _mean(seconds_of(partial(kirchhoff_correction, *point)) for point in some)


def inference_seconds(asked: TargetToInfer | CornersToInfer, parsing: float) -> float:
    """Time to infer a calibration by sampling, with the time to parse a small study [s]."""
    from tradestudy.calibration.posterior.sampling import FIRST_ROUND, MINIMUM_ENSEMBLES
    from tradestudy.calibration.posteriors import CornersToInfer

    if isinstance(asked, CornersToInfer):
        return _FITS_OF_A_RIG * _first_fit_seconds(asked) + _PARSED_IN_A_RIG * parsing
    steps = min(FIRST_ROUND, asked.part.max_steps)
    half_steps = MINIMUM_ENSEMBLES * 2 * steps
    return half_steps * _half_step_seconds(asked) + steps / FIRST_ROUND * _PARSED_IN_A_TARGET * parsing


def _first_fit_seconds(asked: CornersToInfer) -> float:
    """Time to find a first guess of one camera of a rig."""
    from tradestudy.calibration.corners.corner_file import read_corners
    from tradestudy.calibration.corners.initial_values import first_intrinsics, first_poses

    corners = read_corners(asked.folder / asked.part.file)
    board, image, present = corners.board, corners.left, corners.present

    def fit() -> None:
        with suppress(TradestudyError):  # a wide lens is no pinhole; what was tried takes as long
            first_poses(first_intrinsics(board, image, present), board, image, present)

    return min(seconds_of(fit) for _ in range(2))  # the first loads modules


def _half_step_seconds(asked: TargetToInfer) -> float:
    """Time to evaluate the posterior for half of the walkers, as samplers do twice in each step."""
    from tradestudy.calibration.target.camera_target import target_problem
    from tradestudy.calibration.target.target_inference import log_probability_about, walkers_of

    problem, _ = target_problem(asked)
    design = problem.priors.mean
    log_probability = log_probability_about(problem, design, problem.target.poses)
    walkers = np.tile(design, (walkers_of(problem) // 2, 1))
    return statistics.median(seconds_of(lambda: log_probability(walkers)) for _ in range(_HALF_STEPS_OF_A_PILOT))


def pair_seconds(part: FresnelValidityPart, element: ElementPart, *, field_angle: float = 0.0) -> float:
    """Time to compare Fresnel with Kirchhoff behind a lens at its own f-number, over all windows and lens phases.

    Off the axis, the pilot uses smaller windows: wider ones have more targets, and the rank of the sum over the
    aperture grows with their radius.
    """
    from tradestudy.optics.psf_difference import fresnel_psf_difference, target_count

    smaller = _SMALLER if field_angle else 1.0
    windows = tuple(window / smaller for window in part.windows)
    wavelength = part.off_axis.wavelength if part.off_axis and field_angle else part.wavelengths[0]

    def compare() -> None:
        fresnel_psf_difference(
            focal_length=element.focal_length,
            object_distance=element.object_distance,
            f_number=element.f_number,
            field_angle=field_angle,
            wavelength=wavelength,
            lens_phases=part.lens_phases,
            windows=windows,
            tolerance=part.tolerance,
        )

    seconds = min(seconds_of(compare) for _ in range(2))  # the first loads modules
    counts = [target_count(one, symmetric=field_angle == 0.0) for one in (part.windows, windows)]
    return float(seconds * (counts[0] / counts[1]) ** _GROWTH)


def spread_seconds(part: PointSpreadPart) -> float:
    """Time to compute and measure one image of a point, the middle one of those requested."""
    from tradestudy.analysis.point_spreads import every_case, spread_measures

    cases = every_case(part)
    return seconds_of(
        lambda: spread_measures(
            cases[len(cases) // 2],
            method="fresnel",
            window=part.window,
            rms_radius=part.rms_radius,
            pixel_pitch=part.pixel_pitch,
            tolerance=part.tolerance,
        )
    )


def _mean(seconds: Iterable[float]) -> float:
    known = list(seconds)
    return math.fsum(known) / len(known)
