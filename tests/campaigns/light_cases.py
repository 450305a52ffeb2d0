"""Random light paths and sources, and what each left-out effect changes in their pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.light_slots import (
    crosstalk_in_picture,
    main_lens_diffraction_in_picture,
    microlens_diffraction_in_picture,
    pixel_integration_in_picture,
    source_extent_in_picture,
    spectrum_in_picture,
)
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import (
    EXACT_RAYS,
    FRESNEL,
    KIRCHHOFF,
    KIRCHHOFF_FRESNEL,
    ChainAccuracy,
    DiscSource,
    Legs,
    LightPath,
    Microlenses,
    PixelGrid,
    chain_image,
    separate_image,
    spectral_image,
    square_centres,
)
from tradestudy.optics.propagation import CircularLens

FRESNEL_KIRCHHOFF = Legs(to_array="fresnel", to_detector="kirchhoff")
TO_ARRAY = Legs(to_array="boundary_wave", to_detector="kirchhoff")
BEHIND_ARRAY = Legs(to_array="kirchhoff", to_detector="boundary_wave")
PHASES = ("parabolic", "stigmatic", "perfect")
_MOST_POINTS = 4  # resolved points across the source
RAYS = "diffraction: rays on both legs"
MICROLENS_EDGES = "microlens_diffraction: boundary_wave"
ALL_BY_RAYS = "all together: rays, of a point, in one colour"
ALL_BY_WAVES = "all together: Fresnel, no crosstalk, of a point, at points, in one colour"
_POINT = 1e-3
LINES = 2  # wavelengths of a spectrum


@dataclass(frozen=True, kw_only=True)
class LightCase:
    """A scene, and the wavelengths beside its own."""

    scene: LightScene
    wavelengths: FloatArray


def random_case(rng: np.random.Generator) -> LightCase:
    """Focal lengths, f-numbers, gaps, defocus, pitch, wavelength, spot and lens phases, all drawn wide."""
    wavelength = rng.uniform(0.4e-6, 0.9e-6)
    focal_length = rng.uniform(2e-3, 8e-3)
    radius = focal_length / 2 / math.exp(rng.uniform(math.log(2.0), math.log(20.0)))
    distance = focal_length * math.exp(rng.uniform(math.log(3.0), math.log(30.0)))
    image = focal_length * distance / (distance - focal_length)
    pitch = rng.uniform(15e-6, 50e-6)
    width = pitch * rng.uniform(0.7, 1.0)
    gap = pitch * image / (2 * radius) * rng.uniform(0.7, 1.5)  # f-numbers matched, or nearly
    if rng.random() < 0.1:  # unfocused: the main image lies on the array, or nearly
        micro_focal = gap
        depth = micro_focal * rng.uniform(-0.2, 0.2)
    else:
        depth = gap * rng.uniform(1.2, 6.0) * (1 if rng.random() < 0.65 else -1)
        depth = max(depth, -0.7 * image)  # the array stands behind the main lens
        defocus = rng.uniform(-2.0, 2.0) * wavelength * 8 / width**2  # waves at the rim of a microlens
        micro_focal = 1 / (1 / depth + 1 / gap - defocus)
    main_phase, micro_phase = rng.choice(PHASES, size=2)
    across = int(rng.choice([1, 2, 3], p=[0.4, 0.4, 0.2]))
    lenses = Microlenses(
        centres=square_centres(pitch=pitch, count=across),
        focal_lengths=np.full(across**2, micro_focal),
        aperture="circular" if rng.random() < 0.8 else "square",
        aperture_width=width,
        pitch=pitch,
        layout="square",
        gaps="opaque" if rng.random() < 0.93 else "clear",
        lens_phase=micro_phase,
        focus_distance=depth if micro_phase == "stigmatic" else None,
    )
    per_lens = int(rng.integers(4, 9))
    path = LightPath(
        main_lens=CircularLens(
            radius=radius,
            focal_length=focal_length,
            lens_phase=main_phase,
            focus_distance=distance if main_phase == "stigmatic" else None,
        ),
        microlenses=lenses,
        array_distance=image + depth,
        detector_distance=gap,
        pixels=PixelGrid(pitch=pitch / per_lens, shape=(across * per_lens, across * per_lens)),
    )
    # Several pitches of a steep camera hold thousands of resolved points, which no quick computation can add up.
    widest = min(3.0 * pitch, _MOST_POINTS * wavelength * image / (2.0 * radius))
    seen = distance / image * widest * math.exp(rng.uniform(math.log(0.01), 0.0))
    # Of four microlenses one is lit best, along the diagonal that leaves the scene a symmetry.
    aside = pitch / 2 * rng.uniform(0.6, 1.0) * distance / (image + depth) if across == 2 else 0.0
    spread = math.exp(rng.uniform(math.log(1e-3), math.log(0.1)))
    return LightCase(
        scene=LightScene(
            path=path,
            source=DiscSource(diameter=seen, distance=distance, x=aside, y=aside),
            wavelength=wavelength,
        ),
        wavelengths=wavelength * (1 + spread * np.linspace(-1, 1, LINES)),
    )


def bounds_of(case: LightCase) -> dict[str, float]:
    """What leaving each effect out may change at most, as its slot has it; only effects that the case has."""
    scene = case.scene
    main, micro = main_lens_diffraction_in_picture(scene), microlens_diffraction_in_picture(scene)
    edges = {MICROLENS_EDGES: _bound(micro, "boundary_wave")} if "boundary_wave" in micro.model_names else {}
    alone = edges | {
        RAYS: _bound(main, OFF) + _bound(micro, OFF),
        "main_lens_diffraction: boundary_wave": _bound(main, "boundary_wave"),
        "main_lens_diffraction: fresnel": _bound(main, "fresnel"),
        "microlens_diffraction: fresnel": _bound(micro, "fresnel"),
        "crosstalk: off": _bound(crosstalk_in_picture(scene), OFF),
        "pixel_integration: off": _bound(pixel_integration_in_picture(scene), OFF),
        "source_extent: off": _bound(source_extent_in_picture(scene), OFF),
        "spectrum: off": _bound(
            spectrum_in_picture(scene, wavelengths=case.wavelengths, weights=np.ones(LINES)), OFF
        ),
    }  # fmt: skip
    joint = alone["crosstalk: off"] + alone["source_extent: off"] + alone["spectrum: off"]
    waves = alone["main_lens_diffraction: fresnel"] + alone["microlens_diffraction: fresnel"]
    return alone | {ALL_BY_RAYS: joint + alone[RAYS], ALL_BY_WAVES: joint + waves + alone["pixel_integration: off"]}


def changes_of(case: LightCase, tolerance: float, names: Collection[str]) -> dict[str, float]:
    """What leaving each of the effects named out changes, against the picture of the complete models.

    Each is forced on, one at a time, or all together. None is named that the case does not have.
    """
    scene = case.scene
    path, accuracy = scene.path, ChainAccuracy(tolerance=tolerance)
    points = replace(path, pixels=replace(path.pixels, integrated=False))

    def picture(path: LightPath = path, legs: Legs = KIRCHHOFF, *, point: bool = False) -> FloatArray:
        return chain_image(
            path, source(point), wavelength=scene.wavelength, legs=legs, accuracy=accuracy,
            rng=np.random.default_rng(0),
        ).pixels  # fmt: skip

    def source(point: bool) -> DiscSource:
        # A disc far below any resolution is a point whose computation shares its numerical error with the disc's.
        return replace(scene.source, diameter=_POINT * scene.source.diameter) if point else scene.source

    def alone(path: LightPath = path, legs: Legs = KIRCHHOFF, *, point: bool = False) -> FloatArray:
        return separate_image(
            path, source(point), wavelength=scene.wavelength, legs=legs, accuracy=accuracy,
            rng=np.random.default_rng(0),
        ).pixels  # fmt: skip

    @cache
    def whole() -> FloatArray:
        return picture()

    @cache
    def colours() -> FloatArray:
        return spectral_image(
            path, scene.source, wavelengths=case.wavelengths, weights=np.ones(LINES), legs=KIRCHHOFF,
            accuracy=accuracy, rng=np.random.default_rng(0),
        ).pixels  # fmt: skip

    changes: dict[str, Callable[[], float]] = {
        RAYS: lambda: _relative(picture(legs=EXACT_RAYS), whole()),
        "main_lens_diffraction: boundary_wave": lambda: _relative(picture(legs=TO_ARRAY), whole()),
        "main_lens_diffraction: fresnel": lambda: _relative(picture(legs=FRESNEL_KIRCHHOFF), whole()),
        MICROLENS_EDGES: lambda: _relative(picture(legs=BEHIND_ARRAY), whole()),
        "microlens_diffraction: fresnel": lambda: _relative(picture(legs=KIRCHHOFF_FRESNEL), whole()),
        "crosstalk: off": lambda: _relative(alone(), whole()),
        "pixel_integration: off": lambda: _relative(picture(points), whole()),
        "source_extent: off": lambda: _relative(picture(point=True), whole()),
        "spectrum: off": lambda: _relative(whole(), colours()),
        ALL_BY_RAYS: lambda: _relative(picture(legs=EXACT_RAYS, point=True), colours()),
        ALL_BY_WAVES: lambda: _relative(alone(points, FRESNEL, point=True), colours()),
    }
    return {name: changes[name]() for name in names}


def _bound(slot: Slot, model: str) -> float:
    return slot.model(model).change_of("pixel_intensity")


def _relative(pixels: FloatArray, reference: FloatArray) -> float:
    return float(np.linalg.norm(pixels - reference) / np.linalg.norm(reference))
