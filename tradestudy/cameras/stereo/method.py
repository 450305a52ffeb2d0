"""How a stereo rig finds depth, for the readers of a report."""

from __future__ import annotations

from typing import Final

from tradestudy.cameras.method import Formula, Method

METHOD: Final = Method(
    name="stereo",
    title="Depth from a stereo rig",
    statements=(
        "Two cameras of principal distance *c*, a baseline *B* apart, see a point at distance *Z* with disparity "
        "*d*. A yaw ψ between them changes the disparity by about *c* (1 + *x*²/*c*²) ψ where the point appears a "
        "distance *x* from the middle of the picture.",
        Formula(
            typst="Z = (c B) / d, quad delta Z approx Z^2 / (c B) thin delta d, quad "
            "delta Z approx Z^2 / B (1 + x^2 / c^2) psi",
            alt="Z equals c times B over d. The change of Z is about Z squared over c B times the change of d. A yaw "
            "psi changes Z by about Z squared over B, times one plus x squared over c squared, times psi.",
        ),
        "The last two are linear approximations, which show how the errors scale. The numbers come from the exact "
        "expression, in which depth becomes infinite where the yaw cancels the disparity: on the axis, at *Z* = "
        "*B*/|ψ|. The overlap of the two fields of view limits how near the rig can measure; for parallel axes the "
        "overlap is 1 − *B*/*W*, where *W* = 2 *Z* tan(FOV/2) is the width of each field of view at the distance *Z*.",
        "The principal distance *c* is the distance from the lens to the sensor. By default it equals the focal length "
        "*f*, which is right if *f* comes from a camera calibration that gives the focal length in pixels, and thus "
        "the principal distance. If the study declares `principal_distance: focused`, it is "
        "*f* *a*/(*a*\u00a0−\u00a0*f*), the image distance of a thin lens focused at *a*, and exceeds *f* by the "
        "fraction *f*/(*a*\u00a0−\u00a0*f*).",
    ),
    baseline_note="The reference rig has parallel axes. A rig with converging axes and baseline *B* measures as well "
    "as a parallel one with baseline *B* (1 + *x*²/*c*²)/(1 + *B*²/4*Z*²), where *x* is half the disparity. Where "
    "the axes meet, *x* = 0, this is less than *B*, because the lines of sight are longer than the distance *Z*.",
)
