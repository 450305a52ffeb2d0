"""Hard cases of geometrical optics: the thin lens and the relay behind it, triangulation, and depth of field."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import (
    blur_allowance,
    depth_of_field,
    diffraction_inclusive_depth_of_field,
    hyperfocal_distance,
)
from tradestudy.optics.thin_lens import (
    blur_diameter,
    focus_shift,
    image_distance,
    microlens_object_distance,
    object_distance,
    project_to_detector,
)
from tradestudy.optics.triangulation import midpoint_depth, plenoptic_depth, stereo_depth, stereo_disparity
from tradestudy.verification.case import Family, Law, NumericCase, OutcomeCase

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


_RIG = {"baseline": 0.1, "f": 0.0305}

DEPTH: Final = Law(
    name="depth f B/d",
    naive=lambda disparity, baseline, f: f * baseline / np.float64(disparity),
    ours=lambda disparity, baseline, f: stereo_depth(disparity, baseline, f),
)
# Textbooks add f θ to the disparity for a yaw of θ between the axes.
TURNED_DEPTH: Final = Law(
    name="depth with axes at an angle",
    naive=lambda disparity, baseline, f, angle: f * baseline / (np.float64(disparity) + f * angle),
    ours=lambda disparity, baseline, f, angle: stereo_depth(disparity, baseline, f, convergence_angle=angle),
)
TURNED_DISPARITY: Final = Law(
    name="disparity with axes at an angle",
    naive=lambda distance, baseline, f, angle: 2 * f * np.tan(np.arctan(baseline / 2 / distance) - angle / 2),
    ours=lambda distance, baseline, f, angle: stereo_disparity(distance, baseline, f, convergence_angle=angle),
)


def _naive_midpoint(left: float, right: float, baseline: float) -> FloatArray:
    """The textbook solution of the normal equations, by scalar products."""
    u, v = np.array([left, 0.0, 1.0]), np.array([right, 0.0, 1.0])
    offset = np.array([baseline, 0.0, 0.0])
    a, b, c, d, e = u @ u, u @ v, v @ v, u @ offset, v @ offset
    along = (c * d - b * e) / (a * c - b * b)
    along_other = (b * d - a * e) / (a * c - b * b)
    return np.asarray((along + along_other) / 2.0)


def _midpoint(left: float, right: float, baseline: float) -> FloatArray:
    return midpoint_depth(
        np.array([left, 0.0, 1.0]),
        np.array([right, 0.0, 1.0]),
        np.array([-baseline / 2.0, 0.0, 0.0]),
        np.array([baseline / 2.0, 0.0, 0.0]),
    )


MIDPOINT: Final = Law(name="midpoint of two lines of sight", naive=_naive_midpoint, ours=_midpoint)


def _depth(name: str, disparity: float, **changed: float) -> NumericCase:
    return NumericCase(name=name, law=DEPTH, inputs={"disparity": disparity, **_RIG, **changed})


def _turned(name: str, disparity: float, angle: float) -> NumericCase:
    return NumericCase(name=name, law=TURNED_DEPTH, inputs={"disparity": disparity, **_RIG, "angle": angle})


def _rays(name: str, left: float, right: float) -> NumericCase:
    return NumericCase(name=name, law=MIDPOINT, inputs={"left": left, "right": right, "baseline": 0.1})


def _pole(step: float) -> OutcomeCase:
    """Depth at the yaw at which the rays are parallel, and one ulp to either side of it."""
    angle = {0: _POLE, 1: math.nextafter(_POLE, 0.0), -1: math.nextafter(_POLE, -1.0)}[int(step)]
    disparity, baseline, f = _AT_TEN_METRES, _RIG["baseline"], _RIG["f"]
    return OutcomeCase(
        name=f"yaw at the pole{ {0: '', 1: ', one ulp inside', -1: ', one ulp outside'}[int(step)] }",
        law="rays that do not meet have infinite depth, never negative depth",
        naive=lambda: _words(f * baseline / (disparity + f * angle)),
        ours=lambda: _words(float(stereo_depth(disparity, baseline, f, convergence_angle=angle))),
        expected=("in front",),
    )


def _words(depth: float) -> str:
    return f"{depth:.3g} m, {'in front' if depth > 0.0 else 'behind'}"


_AT_TEN_METRES = _RIG["f"] * _RIG["baseline"] / 10.0
_POLE = -2.0 * math.atan(_AT_TEN_METRES / (2.0 * _RIG["f"]))
_CONVERGING = 2.0 * math.atan(0.05)  # the axes cross at 1 m

TRIANGULATION: Final = Family(
    name="triangulation",
    title="Stereo depth near its poles",
    cases=(
        _depth("disparity 0", 0.0),
        _depth("one ulp above disparity 0", _TINY),
        _depth("one ulp below disparity 0", -_TINY),
        _depth("negative disparity", -1e-6),
        _depth("point at 10⁸ m", _RIG["f"] * _RIG["baseline"] / 1e8),
        _depth("baseline of 10⁻³⁰⁰ m", _RIG["f"] * 1e-300, baseline=1e-300),
        _depth("baseline of 1 nm", _RIG["f"] * 1e-9 / 3.0, baseline=1e-9),
        _turned("converging axes at their crossing", 0.0, _CONVERGING),
        _turned("converging axes near their crossing", 1e-9, _CONVERGING),
        _turned("diverging axes", 5e-3, -0.05),
        _turned("diverging axes, rays that diverge", 1e-4, -0.05),
        _turned("parallel axes", _AT_TEN_METRES, 0.0),
        _turned("yaw a billionth before the pole, where the rays are parallel", _AT_TEN_METRES, _POLE * (1.0 - 1e-9)),
        _turned("yaw a billionth beyond the pole", _AT_TEN_METRES, _POLE * (1.0 + 1e-9)),
        *(_pole(step) for step in (0, 1, -1)),
        NumericCase(
            name="disparity near the crossing of the axes",
            law=TURNED_DISPARITY,
            inputs={"distance": 1.0 + 1e-9, **_RIG, "angle": _CONVERGING},
        ),
        NumericCase(
            name="disparity of a point at infinity",
            law=TURNED_DISPARITY,
            inputs={"distance": math.inf, **_RIG, "angle": _CONVERGING},
        ),
        _rays("rays that meet at 10⁶ m", 5e-8, -5e-8),
        _rays("oblique rays that meet at 10⁵ m", 0.3, 0.3 - 1e-6),
        _rays("parallel rays", 0.3, 0.3),
        _rays("diverging rays", -1e-9, 1e-9),
    ),
)


_LENS = {"f": 0.05, "pupil": 0.0125}


def _naive_near(focus: float, f: float, pupil: float, blur: float) -> FloatArray:
    hyperfocal = f * pupil / np.float64(blur) + f
    return np.asarray(focus * (hyperfocal - f) / (hyperfocal + focus - 2 * f))


def _naive_far(focus: float, f: float, pupil: float, blur: float) -> FloatArray:
    hyperfocal = f * pupil / np.float64(blur) + f
    return np.asarray(focus * (hyperfocal - f) / (hyperfocal - focus))


NEAR: Final = Law(
    name="near limit",
    naive=_naive_near,
    ours=lambda focus, f, pupil, blur: depth_of_field(focus, f, pupil, blur).near,
)
FAR: Final = Law(
    name="far limit",
    naive=_naive_far,
    ours=lambda focus, f, pupil, blur: depth_of_field(focus, f, pupil, blur).far,
)
EXTENT: Final = Law(
    name="far − near, error relative to the focus distance",
    naive=lambda focus, f, pupil, blur: _naive_far(focus, f, pupil, blur) - _naive_near(focus, f, pupil, blur),
    ours=lambda focus, f, pupil, blur: depth_of_field(focus, f, pupil, blur).extent,
)
ALLOWANCE: Final = Law(
    name="blur √(c² − d²) left by diffraction d within criterion c",
    naive=lambda criterion, spot: np.sqrt(np.float64(criterion) ** 2 - np.float64(spot) ** 2),
    ours=lambda criterion, spot: blur_allowance(criterion, spot).geometric_diameter,
    magnified=False,
)

_BLUR: Final = 25e-6
_HYPERFOCAL = float(hyperfocal_distance(_LENS["f"], _LENS["pupil"], _BLUR))


def _limit(name: str, law: Law, focus: float, blur: float = _BLUR) -> NumericCase:
    return NumericCase(name=name, law=law, inputs={"focus": focus, **_LENS, "blur": blur})


def _around_hyperfocal(name: str, focus: float, expected: str) -> OutcomeCase:
    return OutcomeCase(
        name=f"far limit, focused {name}",
        law="infinite from the hyperfocal distance on, positive before it",
        naive=lambda: _far_in_words(float(_naive_far(focus, **_LENS, blur=_BLUR))),
        ours=lambda: _far_in_words(float(depth_of_field(focus, _LENS["f"], _LENS["pupil"], _BLUR).far)),
        expected=(expected,),
    )


def _far_in_words(far: float) -> str:
    if far == math.inf:
        return "infinite"
    return f"{'finite and positive' if far > 0.0 else 'negative'}, {far:.3g} m"


def _more_diffraction_than_allowed() -> str:
    limits = diffraction_inclusive_depth_of_field(
        0.15, 0.0125, 0.0125 / 22.0, 5.5e-6, wavelength=550e-9, measure="airy-diameter"
    )
    return f"empty: {limits.reason}" if limits.empty else f"{limits.near} … {limits.far} m"


def _naive_diffraction() -> str:
    spot = 2.44 * 550e-9 * 22.0 * (1.0 + 0.0125 / 0.1375)
    return f"√(c² − d²) = {np.sqrt(np.float64(5.5e-6) ** 2 - spot**2):g}"


DEPTH_OF_FIELD: Final = Family(
    name="depth-of-field",
    title="Depth of field",
    cases=(
        _limit("near limit, focused at the hyperfocal distance", NEAR, _HYPERFOCAL),
        _limit("near limit, focused at infinity", NEAR, math.inf),
        _limit("far limit, focused a millionth before the hyperfocal distance", FAR, _HYPERFOCAL * (1.0 - 1e-6)),
        _limit("far limit, focused beyond the hyperfocal distance", FAR, _HYPERFOCAL * 1.5),
        _limit("far limit, focused at infinity", FAR, math.inf),
        _around_hyperfocal("at the hyperfocal distance", _HYPERFOCAL, "infinite"),
        _around_hyperfocal("one ulp beyond the hyperfocal distance", math.nextafter(_HYPERFOCAL, 99.0), "infinite"),
        _around_hyperfocal("one ulp before the hyperfocal distance", math.nextafter(_HYPERFOCAL, 0.0), "positive"),
        _limit("near limit for a blur of 0", NEAR, 2.0, 0.0),
        _limit("far limit for a blur of 0", FAR, 2.0, 0.0),
        _limit("near limit for a blur of 10⁻³⁰⁰ m", NEAR, 2.0, 1e-300),
        _limit("far limit for a blur of 10⁻³⁰⁰ m", FAR, 2.0, 1e-300),
        _limit("depth of field for a blur of 1 pm", EXTENT, 2.0, 1e-12),
        _limit("near limit for a blur wider than the pupil", NEAR, 2.0, 0.02),
        _limit("near limit, focused one ulp outside the focal plane", NEAR, math.nextafter(0.05, 1.0)),
        _limit("far limit, focused one ulp outside the focal plane", FAR, math.nextafter(0.05, 1.0)),
        NumericCase(
            name="blur criterion a trillionth larger than diffraction",
            law=ALLOWANCE,
            inputs={"criterion": 5.5e-6 * (1.0 + 1e-12), "spot": 5.5e-6},
        ),
        OutcomeCase(
            name="diffraction larger than the blur criterion",
            law="no depth of field, and the reason",
            naive=_naive_diffraction,
            ours=_more_diffraction_than_allowed,
            expected=("empty", "32.2 µm", "5.5 µm", "open the aperture"),
        ),
    ),
)
