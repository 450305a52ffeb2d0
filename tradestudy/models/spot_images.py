"""Images of a study's light spot, each computed once, and the times that their parts take."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import product
from typing import Any, Final

import numpy as np

from tradestudy.errors import NotConvergedError, TradestudyError, UnaffordableError
from tradestudy.execution import Steps
from tradestudy.execution.steps import timed
from tradestudy.light_methods import legs_of
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage, ComputeParts, Part, call, in_turn
from tradestudy.optics.chain.arriving_light import point_wave
from tradestudy.optics.chain.image import (
    mean_image,
    refuse_following_microlenses,
    unguarded_image,
    unguarded_separate_image,
)
from tradestudy.optics.chain.point_image import plan_point
from tradestudy.optics.chain.scene import (
    EXACT_RAYS,
    KIRCHHOFF,
    LegMethod,
    Legs,
    LightPath,
    Microlenses,
    PixelGrid,
    hexagonal_centres,
    square_centres,
)
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.chain.spot_image import refuse_large_disc
from tradestudy.optics.propagation.aperture import aperture_field
from tradestudy.optics.propagation.lens import LENS_PHASES, CircularLens, LensPhase, PointSource
from tradestudy.optics.propagation.targets import TargetGrid
from tradestudy.optics.propagation.wave_optics import FieldAccuracy
from tradestudy.study.schema.wave_optics import LightSpotPart, MethodName

_LEGS: Final[Mapping[str, LegMethod]] = {
    "geometric": "geometric",
    "boundary-wave": "boundary_wave",
    "fresnel": "fresnel",
    "kirchhoff": "kirchhoff",
}
STEP: Final = "image of the spot"
RAYS: Final[tuple[MethodName, ...]] = ("geometric", "exact-rays")
_REPEATS: Final = 3  # the shortest time counts, because other load on the machine only adds time
_OFF_AXIS: Final = 2e-3
_TARGETS, _TARGET_PITCH = 256, 0.25e-6
_APERTURE_TOLERANCE: Final = 1e-6
_POINT_TOLERANCE: Final = 1e-4
_ROUNDS: Final = 4  # of ever finer sampling
_MORE_POINTS: Final = 1.4  # factor on their density; the error of the mean over them falls exponentially with it
_FINER: Final = 0.5  # factor on the tolerance of everything else
_FINEST: Final = 1e-6  # tolerance
_GAIN: Final = 0.8  # a round that lowers the error by less is the last


def legs(method: MethodName) -> Legs:
    """Law of each leg."""
    if method == "exact-rays":
        return EXACT_RAYS
    to_array, to_detector = (_LEGS[law] for law in legs_of(method))
    return Legs(to_array=to_array, to_detector=to_detector)


def light_path(part: LightSpotPart) -> LightPath:
    """Main lens, microlenses and pixels as declared; stigmatic lenses are focused on the spot."""
    lens = part.main_lens
    return LightPath(
        main_lens=CircularLens(
            radius=lens.focal_length / lens.f_number / 2,
            focal_length=lens.focal_length,
            lens_phase=lens.lens_phase,
            focus_distance=part.spot.distance if lens.lens_phase == "stigmatic" else None,
        ),
        microlenses=_microlenses(part),
        array_distance=part.mla_distance,
        detector_distance=part.microlenses.gap,
        pixels=PixelGrid(pitch=part.detector.pixel_pitch, shape=(part.detector.pixels, part.detector.pixels)),
    )


def _microlenses(part: LightSpotPart) -> Microlenses:
    array = part.microlenses
    if array.layout == "square":
        centres, row_pitch, shift = square_centres(pitch=array.pitch, count=array.lenses_across), array.pitch, 0.0
    else:
        centres = hexagonal_centres(pitch=array.pitch, rings=array.lenses_across // 2)
        row_pitch, shift = array.pitch * math.sqrt(3.0) / 2.0, 0.5
    # In lattice coordinates; with three types on a hexagonal array, no two neighbours have the same.
    rows = centres[:, 1] / row_pitch
    columns = centres[:, 0] / array.pitch - shift * rows
    types = np.rint(columns - rows).astype(int) % len(array.focal_lengths)
    return Microlenses(
        centres=centres,
        focal_lengths=np.asarray(array.focal_lengths)[types],
        aperture=array.aperture,
        aperture_width=array.width,
        pitch=array.pitch,
        layout=array.layout,
        gaps=array.interstices,
        lens_phase=array.lens_phase,
        focus_distance=part.mla_distance - part.main_image_distance if array.lens_phase == "stigmatic" else None,
    )


def light_source(part: LightSpotPart) -> DiscSource | PointSource:
    """The spot as declared: a disc, or a point where it has no diameter."""
    spot = part.spot
    if spot.is_point:
        return PointSource(x=spot.x, y=spot.y, distance=spot.distance)
    return DiscSource(diameter=spot.diameter, distance=spot.distance, x=spot.x, y=spot.y, coherent=spot.coherent)


@dataclass(frozen=True, kw_only=True)
class SpotModels:
    """The models that compute a picture of the spot.

    Parameters
    ----------
    method
        Laws of both legs.
    tolerance
        Target for the relative numerical error.
    separate
        Whether every pixel receives light from its own microlens only.
    integrated
        Whether pixels integrate the light; otherwise they take the value at their centre times their area.
    point
        Whether all light comes from the middle of the spot.
    monochromatic
        Whether all light has the mean wavelength.
    """

    method: MethodName
    tolerance: float
    separate: bool = False
    integrated: bool = True
    point: bool = False
    monochromatic: bool = False


def compared_models(part: LightSpotPart, method: MethodName) -> SpotModels:
    """The models for one of the compared methods, with every other effect as declared."""
    return SpotModels(
        method=method, tolerance=part.tolerance, point=part.spot.is_point, monochromatic=len(part.lines) == 1
    )


def spot_image(part: LightSpotPart, method: MethodName) -> ChainImage:
    """Image of the declared spot by one of the compared methods, with every other effect as declared."""
    return spot_picture(part, compared_models(part, method))


def spot_picture(
    part: LightSpotPart,
    models: SpotModels,
    done: Callable[[float], None] = lambda _share: None,
    steps: Steps | None = None,
) -> ChainImage:
    """Image of the declared spot by any models; cached by all inputs that affect it.

    Parameters
    ----------
    part, models
        The spot, and the models that compute its picture.
    done
        Called with the fraction done, if the picture takes long.
    steps
        What computes independent parts; without it, they are computed here one after another.
    """
    return _spot_picture(without_comparison(part), models, _Surroundings(done=done, steps=steps))


@dataclass(frozen=True, kw_only=True)
class _Surroundings:
    """What receives a picture's progress and computes its parts; all compare equal, since none affects the picture."""

    done: Callable[[float], None] = field(compare=False)
    steps: Steps | None = field(compare=False)

    def compute(self, parts: Sequence[Part], progress: Callable[[float], None]) -> list[Any]:
        """Compute parts of the picture as `ComputeParts` says."""
        if self.steps is None:
            return in_turn(parts, progress)
        steps = replace(self.steps, progress=lambda _step, share: progress(share))
        return steps.map(STEP, call, parts, [f"part {number}" for number in range(1, len(parts) + 1)])


def refuse_large_picture(part: LightSpotPart, models: SpotModels) -> None:
    """Refuse a picture that the memory could not hold, before anything is computed.

    Raises
    ------
    UnaffordableError
        If the picture needs too much memory, or too many points.
    """
    path, source, wavelength = light_path(part), light_source(part), part.mean_wavelength
    if models.method in RAYS or models.separate:
        return  # rays need little, and so does each microlens alone
    used, accuracy = legs(models.method), ChainAccuracy(tolerance=models.tolerance)
    if isinstance(source, DiscSource) and not (source.coherent or models.point):
        refuse_large_disc(path, source, wavelength=wavelength, legs=used, accuracy=accuracy)
    else:
        point = source.centre if isinstance(source, DiscSource) else source
        plan_point(point_wave(path, point, wavelength=wavelength, legs=used), used.to_detector, accuracy)


def without_comparison(part: LightSpotPart) -> LightSpotPart:
    """The inputs that affect the image of a spot: the part without compared methods and published values."""
    return part.model_copy(update={"methods": (), "tolerance": 1.0, "published": (), "benchmarks": False})


@lru_cache(maxsize=64)
def _spot_picture(part: LightSpotPart, models: SpotModels, surroundings: _Surroundings) -> ChainImage:
    return picture_of(part, models, seed=part.seed, done=surroundings.done, compute=surroundings.compute)


def picture_of(
    part: LightSpotPart,
    models: SpotModels,
    *,
    seed: int,
    done: Callable[[float], None] = lambda _share: None,
    compute: ComputeParts = in_turn,
) -> ChainImage:
    """Image of the declared spot; not cached.

    Its sampling is refined until the stated error is within the tolerance of the models. Where that is unaffordable, or
    takes more than four rounds, the stated error exceeds it.

    Raises
    ------
    OutOfRangeError
        The phase of the microlenses follows the source, which changes the picture by more than the tolerance; see
        `chain_image`.
    NotConvergedError
        By every sampling, the images of points disagree with independent computations.
    UnaffordableError
        The picture takes too much memory, or too many points.
    """
    path, source = light_path(part), light_source(part)
    path = replace(path, pixels=replace(path.pixels, integrated=models.integrated))
    if models.point and isinstance(source, DiscSource):
        source = source.centre

    def image(wavelength: float, first: float = 0.0, last: float = 1.0) -> ChainImage:
        def sampled(accuracy: ChainAccuracy, path: LightPath = path) -> ChainImage:
            return (unguarded_separate_image if models.separate else unguarded_image)(
                path,
                source,
                wavelength=wavelength,
                legs=legs(models.method),
                accuracy=accuracy,
                rng=np.random.default_rng(seed),
                done=lambda share: done(first + (last - first) * share),
                compute=compute,
            )

        refined = _refined(sampled, models.tolerance)
        once = partial(sampled, ChainAccuracy(tolerance=models.tolerance))
        refuse_following_microlenses(refined, path, source, legs(models.method), models.tolerance, once)
        return refined

    if models.monochromatic or models.method in RAYS:  # rays are the same at every wavelength
        return image(part.mean_wavelength)
    wavelengths, shares = np.array(part.lines).T
    steps = np.linspace(0.0, 1.0, wavelengths.size + 1).tolist()
    images = [image(*span) for span in zip(wavelengths.tolist(), steps[:-1], steps[1:], strict=True)]
    return mean_image(images, wavelengths, shares)


def _refined(sampled: Callable[[ChainAccuracy], ChainImage], tolerance: float) -> ChainImage:
    """The image by the coarsest sampling whose stated error is within a tolerance, or else the most accurate one."""
    best: ChainImage | None = None
    failure: TradestudyError | None = None
    accuracy = ChainAccuracy(tolerance=tolerance)
    for _ in range(_ROUNDS):
        try:
            image = sampled(accuracy)
        except NotConvergedError as disagreement:
            failure = disagreement
            # The images of single points disagree: more of them would not help, but finer sampling of each may.
            accuracy = _finer(accuracy, {"sampling": math.inf})
            continue
        except UnaffordableError as refusal:
            failure = refusal
            break
        gained = best is None or image.numerical_error < _GAIN * best.numerical_error
        if best is None or image.numerical_error < best.numerical_error:
            best = image
        if best.numerical_error <= tolerance or not gained:
            break
        accuracy = _finer(accuracy, {term: error / tolerance for term, error in image.error_terms.items()})
    if best is None:
        assert failure is not None
        raise failure
    return replace(best, tolerance=tolerance)


def _finer(accuracy: ChainAccuracy, terms: Mapping[str, float]) -> ChainAccuracy:
    """Refine what contributes most of the error; `terms` are relative to the tolerance."""
    points = math.hypot(*(error for term, error in terms.items() if term.startswith("source")))
    others = math.hypot(*(error for term, error in terms.items() if not term.startswith("source")))
    return replace(
        accuracy,
        source_sampling=accuracy.source_sampling * (_MORE_POINTS if points > 0.5 else 1.0),
        tolerance=max(_FINEST, accuracy.tolerance * (_FINER if others > 0.5 else 1.0)),
    )


def image_difference(image: FloatArray, reference: FloatArray) -> float:
    """Sum of absolute differences, relative to the sum of the reference."""
    return float(np.sum(np.abs(image - reference)) / np.sum(reference))


def lit_pixels(image: FloatArray, above: float) -> int:
    """Number of pixels with more than a given share of the brightest pixel's light."""
    return int(np.sum(image > above * image.max()))


def light_benchmarks(part: LightSpotPart, seconds: MutableMapping[str, float]) -> dict[str, float]:
    """Stated errors (relative L2) by name of the case; the computing times go to ``seconds`` under the same names."""
    errors: dict[str, float] = {}
    places = (("on axis", 0.0), (f"{_OFF_AXIS * 1e3:g} mm off axis", _OFF_AXIS))
    for phase, (where, x) in product(LENS_PHASES, places):
        name = f"main lens alone, {_TARGETS} × {_TARGETS} points, Kirchhoff, {phase}, {where}"
        runs = [_aperture(part, phase, x) for _ in range(_REPEATS)]
        errors[name] = runs[0][1]
        seconds[name] = min(took for took, _ in runs)
    name = "one source point, both lenses, Kirchhoff on both legs"
    with timed(seconds, name):
        errors[name] = unguarded_image(
            light_path(part),
            PointSource(distance=part.spot.distance),
            wavelength=part.mean_wavelength,
            legs=KIRCHHOFF,
            accuracy=ChainAccuracy(tolerance=_POINT_TOLERANCE),
            rng=np.random.default_rng(part.seed),
        ).numerical_error
    return errors


def _aperture(part: LightSpotPart, phase: LensPhase, x: float) -> tuple[float, float]:
    """Computing time [s] without the error check, and the stated error, in the plane of the thin-lens image."""
    lens, distance = part.main_lens, part.spot.distance
    image = lens.focal_length * distance / (distance - lens.focal_length)
    field = aperture_field(
        source=PointSource(x=x, distance=distance),
        lens=CircularLens(
            radius=lens.focal_length / lens.f_number / 2,
            focal_length=lens.focal_length,
            lens_phase=phase,
            focus_distance=distance if phase == "stigmatic" else None,
        ),
        targets=TargetGrid.centred(
            centre=(-x * image / distance, 0.0), pitch=_TARGET_PITCH, count=_TARGETS, distance=image
        ),
        wavelength=part.mean_wavelength,
        method="kirchhoff",
        accuracy=FieldAccuracy(tolerance=_APERTURE_TOLERANCE),
    )
    return field.effort.seconds, field.error.intensity
