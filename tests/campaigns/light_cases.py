"""Random light paths and spots, small enough for pictures by the most complete models."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.study.schema.wave_optics import LightSpotPart

PHASES = ("parabolic", "stigmatic", "perfect")
_MOST_POINTS = 4  # resolved points across the source


def random_part(rng: np.random.Generator) -> LightSpotPart:
    """Focal lengths, f-numbers, gaps, defocus, pitch, wavelength, spot and main lens's phase, all drawn wide."""
    wavelength = rng.uniform(0.4e-6, 0.9e-6)
    focal_length = rng.uniform(2e-3, 8e-3)
    f_number = math.exp(rng.uniform(math.log(2.0), math.log(20.0)))
    radius = focal_length / 2 / f_number
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
    if micro_focal <= 0.0:  # no array of a study spreads light
        return random_part(rng)
    # The second draw once was the microlenses' phase. It keeps the numbers of all cases, but pictures of microlenses
    # whose phase follows the source are refused.
    main_phase, _ = rng.choice(PHASES, size=2)
    across = int(rng.choice([1, 2, 3], p=[0.4, 0.4, 0.2]))
    per_lens = int(rng.integers(4, 9))
    # Several pitches of a steep camera hold thousands of resolved points, which no quick computation can add up.
    widest = min(3.0 * pitch, _MOST_POINTS * wavelength * image / (2.0 * radius))
    seen = distance / image * widest * math.exp(rng.uniform(math.log(0.01), 0.0))
    # Of four microlenses one is lit best, along the diagonal that leaves the scene a symmetry.
    aside = pitch / 2 * rng.uniform(0.6, 1.0) * distance / (image + depth) if across == 2 else 0.0
    return LightSpotPart.model_validate(
        {
            "main_lens": {"focal_length": _m(focal_length), "f_number": f_number, "lens_phase": str(main_phase)},
            "mla_distance": _m(image + depth),
            "microlenses": {
                "lenses_across": across,
                "pitch": _m(pitch),
                "focal_length": _m(micro_focal),
                "aperture": "circular" if rng.random() < 0.8 else "square",
                "aperture_width": _m(width),
                "gap": _m(gap),
                "interstices": "opaque" if rng.random() < 0.93 else "clear",
                "lens_phase": "parabolic",
            },
            "detector": {"pixels": across * per_lens, "pixel_pitch": _m(pitch / per_lens)},
            "spot": {"diameter": _m(seen), "distance": _m(distance), "x": _m(aside), "y": _m(aside)},
            "wavelength": _m(wavelength),
        }
    )


def large_part(rng: np.random.Generator) -> LightSpotPart:
    """A random part with a disc 3 to 30 times as wide, so that its image has many resolved points."""
    part = random_part(rng)
    wider = math.exp(rng.uniform(math.log(3.0), math.log(30.0)))
    return part.model_copy(update={"spot": part.spot.model_copy(update={"diameter": wider * part.spot.diameter})})


def _m(metres: float) -> str:
    return f"{metres:.12g} m"
