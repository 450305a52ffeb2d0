"""How an unfocused plenoptic camera finds depth, for the readers of a report."""

from __future__ import annotations

from typing import Final

from tradestudy.cameras.method import Formula, Method

METHOD: Final = Method(
    name="unfocused",
    title="Depth from an unfocused plenoptic camera",
    statements=(
        "The main lens images the plane of focus, at *a*~0~, onto the array at *z*, and each pixel under a "
        "microlens sees its own part of the pupil. Two views whose parts are Δ*u* apart show a point at "
        "distance *a* shifted by *d* on the array: a stereo rig inside one lens. Its samples are microlenses, not "
        "pixels; disparity errors are therefore given in microlenses.",
        Formula(
            typst="d = Delta u thin z (1/a - 1/a_0), quad 1/a = 1/f_M - 1/z + d / (Delta u thin z)",
            alt="d equals delta u times z times the quantity one over a minus one over a zero. One over a equals one "
            "over f M minus one over z plus d over delta u z.",
        ),
    ),
)
