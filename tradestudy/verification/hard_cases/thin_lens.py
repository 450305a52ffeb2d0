"""Hard cases of the thin lens and the relay behind it: far objects, the focal plane, an image on the array."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.microlens_projection import microlens_object_distance, project_to_detector
from tradestudy.optics.thin_lens import blur_diameter, focus_shift, image_distance, object_distance
from tradestudy.optics.triangulation import plenoptic_depth
from tradestudy.verification.hard_cases.case import Family, Law, NumericCase, OutcomeCase

_F: Final = 0.05
_AFTER_F, _BEFORE_F = math.nextafter(_F, 1.0), math.nextafter(_F, 0.0)

IMAGE_DISTANCE: Final = Law(
    name="image distance b = a f/(a − f)",
    naive=lambda a, f: 1.0 / (1.0 / np.float64(f) - 1.0 / np.float64(a)),
    ours=lambda a, f: image_distance(a, f),
    magnified=False,
)
FOCUS_SHIFT: Final = Law(
    name="focus shift s = b − f",
    naive=lambda a, f: np.float64(a) * f / (np.float64(a) - f) - f,
    ours=lambda a, f: focus_shift(a, f),
    magnified=False,
)


def _naive_round_trip(a: float, f: float) -> FloatArray:
    b = np.float64(a) * f / (np.float64(a) - f)
    return np.asarray(b * f / (b - f))


ROUND_TRIP: Final = Law(
    name="object → image → object",
    naive=_naive_round_trip,
    ours=lambda a, f: object_distance(focus_shift(a, f), f),
    magnified=False,
)
BLUR: Final = Law(
    name="blur circle A |b − b₀|/b",
    naive=lambda a, focus, f, pupil: pupil * abs(a * f / (a - f) - focus * f / (focus - f)) / (a * f / (a - f)),
    ours=lambda a, focus, f, pupil: blur_diameter(a, focus, f, pupil),
)
RELAY_DISTANCE: Final = Law(
    name="distance from array to image a_L = z − b",
    naive=lambda a, z, f: z - 1.0 / (1.0 / np.float64(f) - 1.0 / np.float64(a)),
    ours=lambda a, z, f: microlens_object_distance(a, z, f),
    magnified=False,
)
RELAY_DISTANCE_TO_SCALE: Final = Law(
    name="distance from array to image a_L, error relative to z − f",
    naive=lambda a, z, f: z - 1.0 / (1.0 / np.float64(f) - 1.0 / np.float64(a)),
    ours=lambda a, z, f: microlens_object_distance(a, z, f),
)
MICRO_IMAGE: Final = Law(
    name="position under a microlens (x_off − x′) b_L/a_L",
    naive=lambda x, a, z, f, gap: (x * gap) / (z - 1.0 / (1.0 / np.float64(f) - 1.0 / np.float64(a))),
    ours=lambda x, a, z, f, gap: project_to_detector(0.0, a, x, mla_distance=z, microlens_gap=gap, focal_length=f),
    magnified=False,
)


def _naive_eq8(disparity: float, baseline: float, z: float, gap: float, f: float) -> FloatArray:
    b = z - gap * baseline / np.float64(disparity)
    return np.asarray(f * b / (b - f))


def _eq8(disparity: float, baseline: float, z: float, gap: float, f: float) -> FloatArray:
    return plenoptic_depth(disparity, baseline, mla_distance=z, microlens_gap=gap, focal_length=f)


EQUATION_8: Final = Law(name="depth from two micro-images, eq. 8", naive=_naive_eq8, ours=_eq8)

_R5 = {"baseline": 126.5e-6, "z": 14.773e-3, "gap": 0.568e-3, "f": 12.5e-3}
# The image distance of an infinitely distant point, at s = 0.
_INFINITE = _R5["gap"] * _R5["baseline"] / (_R5["z"] - _R5["f"])
# Lengths that are exact in binary, so that the image is exactly one ulp from the array.
_ON_ARRAY = {"a": 3.0 * 0.078125, "z": 1.5 * 0.078125, "f": 0.078125}


def _lens(name: str, law: Law, a: float, f: float = _F) -> NumericCase:
    return NumericCase(name=name, law=law, inputs={"a": a, "f": f})


def _of_eq8(name: str, disparity: float) -> NumericCase:
    return NumericCase(name=name, law=EQUATION_8, inputs={"disparity": disparity, **_R5})


def _relay(name: str, law: Law, z: float, **more: float) -> NumericCase:
    return NumericCase(name=name, law=law, inputs={**_ON_ARRAY, "z": z, **more})


def _beyond_infinity(disparity: float) -> OutcomeCase:
    steps = {
        0: "at the disparity of infinity",
        1: "one ulp above the disparity of infinity",
        -1: "one ulp below the disparity of infinity",
    }
    step = int(np.sign(disparity - _INFINITE))
    return OutcomeCase(
        name=f"eq. 8 {steps[step]}",
        law="depth is never negative",
        naive=lambda: _signed(float(_naive_eq8(disparity, **_R5))),
        ours=lambda: _signed(float(_eq8(disparity, **_R5))),
        expected=("in front of the camera",),
    )


def _signed(depth: float) -> str:
    return f"{depth:.3g} m, {'in front of' if depth > 0.0 else 'behind'} the camera"


_TINY = math.nextafter(0.0, 1.0)
_Z = _ON_ARRAY["z"]

THIN_LENS: Final = Family(
    name="thin-lens",
    title="Thin lens and relay",
    cases=(
        _lens("object at infinity", IMAGE_DISTANCE, math.inf),
        _lens("object at 10⁸ m", IMAGE_DISTANCE, 1e8),
        _lens("object in the focal plane", IMAGE_DISTANCE, _F),
        _lens("object one ulp outside the focal plane", IMAGE_DISTANCE, _AFTER_F),
        _lens("object one ulp inside the focal plane", IMAGE_DISTANCE, _BEFORE_F),
        _lens("object inside the focal length", IMAGE_DISTANCE, _F / 2.0),
        _lens("object almost at the lens", IMAGE_DISTANCE, 1e-12),
        _lens("shift for an object at infinity", FOCUS_SHIFT, math.inf),
        _lens("shift for an object at 10⁸ m", FOCUS_SHIFT, 1e8),
        _lens("shift for an object in the focal plane", FOCUS_SHIFT, _F),
        _lens("shift for an object one ulp outside the focal plane", FOCUS_SHIFT, _AFTER_F),
        _lens("shift for an object one ulp inside the focal plane", FOCUS_SHIFT, _BEFORE_F),
        _lens("shift for an object inside the focal length", FOCUS_SHIFT, _F / 3.0),
        _lens("there and back from infinity", ROUND_TRIP, math.inf),
        _lens("there and back from 10⁸ m", ROUND_TRIP, 1e8),
        _lens("there and back one ulp outside the focal plane", ROUND_TRIP, _AFTER_F),
        _lens("there and back one ulp inside the focal plane", ROUND_TRIP, _BEFORE_F),
        _lens("there and back inside the focal length", ROUND_TRIP, _F / 2.0),
        NumericCase(
            name="blur a billionth out of focus",
            law=BLUR,
            inputs={"a": 1.0 + 1e-9, "focus": 1.0, "f": _F, "pupil": 0.0125},
        ),
        NumericCase(
            name="blur of a point at 10⁸ m, focused at 10⁷ m",
            law=BLUR,
            inputs={"a": 1e8, "focus": 1e7, "f": _F, "pupil": 0.0125},
        ),
        _relay("image on the array", RELAY_DISTANCE, _Z),
        _relay("image one ulp in front of the array", RELAY_DISTANCE, math.nextafter(_Z, 1.0)),
        _relay("image one ulp behind the array", RELAY_DISTANCE, math.nextafter(_Z, 0.0)),
        NumericCase(
            name="image on the array, with all lengths in round numbers",
            law=RELAY_DISTANCE_TO_SCALE,
            inputs={"a": 0.15, "z": 0.15 * 0.0125 / (0.15 - 0.0125), "f": 0.0125},
        ),
        NumericCase(
            name="image 5 µm in front of the array, object at 10⁸ m",
            law=RELAY_DISTANCE_TO_SCALE,
            inputs={"a": 1e8, "z": 0.012505, "f": 0.0125},
        ),
        _relay("micro-image, image on the array", MICRO_IMAGE, _Z, x=1e-4, gap=5e-4),
        _relay(
            "micro-image, image one ulp in front of the array", MICRO_IMAGE, math.nextafter(_Z, 1.0), x=1e-4, gap=5e-4
        ),
        _relay("micro-image, image one ulp behind the array", MICRO_IMAGE, math.nextafter(_Z, 0.0), x=1e-4, gap=5e-4),
        _of_eq8("eq. 8 at disparity 0", 0.0),
        _of_eq8("eq. 8 one ulp above disparity 0", _TINY),
        _of_eq8("eq. 8 one ulp below disparity 0", -_TINY),
        _of_eq8("eq. 8 at a negative disparity", -20e-6),
        _of_eq8("eq. 8 at 1 km", 31.610994e-6 * (1.0 + 6.875e-5)),
        _of_eq8("eq. 8 at 10⁸ m", _INFINITE * (1.0 + 6.9e-10)),
        *(_beyond_infinity(d) for d in (_INFINITE, math.nextafter(_INFINITE, 1.0), math.nextafter(_INFINITE, 0.0))),
    ),
)
