"""Hard cases of the stereo rig: zero and negative disparity, rotated axes, vanishing baselines, parallel rays."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.triangulation import midpoint_depth, stereo_depth, stereo_disparity
from tradestudy.verification.hard_cases.case import Family, Law, NumericCase, OutcomeCase

_RIG = {"baseline": 0.1, "f": 0.0305}
_TINY = math.nextafter(0.0, 1.0)

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
    other = (b * d - a * e) / (a * c - b * b)
    return np.asarray((along + other) / 2.0)


def _midpoint(left: float, right: float, baseline: float) -> FloatArray:
    return midpoint_depth(
        np.array([left, 0.0, 1.0]),
        np.array([right, 0.0, 1.0]),
        np.array([-baseline / 2.0, 0.0, 0.0]),
        np.array([baseline / 2.0, 0.0, 0.0]),
    )


MIDPOINT: Final = Law(name="midpoint of two lines of sight", naive=_naive_midpoint, ours=_midpoint)


def _depth(name: str, disparity: float, **other: float) -> NumericCase:
    return NumericCase(name=name, law=DEPTH, inputs={"disparity": disparity, **_RIG, **other})


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
