"""Hard cases of depth of field: around the hyperfocal distance, without blur, with too much diffraction."""

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
from tradestudy.verification.hard_cases.case import Family, Law, NumericCase, OutcomeCase

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
    found = diffraction_inclusive_depth_of_field(
        0.15, 0.0125, 0.0125 / 22.0, 5.5e-6, wavelength=550e-9, measure="airy-diameter"
    )
    return f"empty: {found.reason}" if found.empty else f"{found.near} … {found.far} m"


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
