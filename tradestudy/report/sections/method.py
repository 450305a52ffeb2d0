"""How depth and its uncertainty are computed: the equations, once for both output formats."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from tradestudy.report.document import Block, Bullets, Equation, Heading, Paragraph, say
from tradestudy.results.views.groups import group, has

if TYPE_CHECKING:
    import xarray as xr


def describe_method(tree: xr.DataTree) -> Iterator[Block]:
    """Write the method, for the kinds of camera that the study has."""
    if not has(tree, "depth"):
        return
    kinds = {str(kind) for kind in group(tree, "cameras")["kind"].values}
    yield Heading(text="Method", anchor="method")
    if "focused-plenoptic" in kinds:
        yield from _plenoptic()
    if "unfocused-plenoptic" in kinds:
        yield from _unfocused_plenoptic()
    if "stereo" in kinds:
        yield from _stereo()
    yield from _uncertainty()
    derived = "matching" in _limits_in_use(tree)
    if derived:
        yield from _derived_disparity(str(group(tree, "depth").attrs["matching_needs"]))
    yield from _ranges(derived=derived)


def _limits_in_use(tree: xr.DataTree) -> set[str]:
    """Names of the limits that some camera has."""
    met = group(tree, "depth")["limit_met"]
    used = (met >= 0).any([dim for dim in met.dims if dim != "limit"])
    return {str(name) for name, there in zip(used["limit"].values, used.values, strict=True) if there}


def _derived_disparity(needs: str) -> Iterator[Block]:
    yield Heading(text="Disparity errors that are derived from the picture", anchor="method-derived", level=2)
    yield Paragraph(
        "A derived disparity error is the Cramér–Rao bound of matching two windows of the camera's picture: "
        "a random texture of the declared contrast and correlation length, blurred by defocus, diffraction and pixels, "
        "in the noise of its electrons, their reading and their rounding, with what the samples alias counted as noise."
    )
    yield Equation(
        typst="1 / sigma_d^2 = W^2 integral.double (2 pi nu_x)^2 gamma^2 / (1 - gamma^2) dif^2 nu, quad "
        "gamma = (S abs(H)^2) / (S abs(H)^2 + N)",
        alt="one over sigma d squared equals W squared times the integral over the band of two pi nu x squared times "
        "gamma squared over one minus gamma squared; gamma equals S H squared over S H squared plus N",
    )
    yield Paragraph(
        "S is the spectrum of the texture in the picture, H the transfer of lenses and pixels, N the noise, W the side "
        "of the window. The bound is what a good matcher reaches where the error is small against a pixel and the "
        f"window large against blur and texture: it takes {needs}. Where that is not so the distance is not usable, "
        "limit “matching”: the declared window decides it as much as the camera does."
    )


def _plenoptic() -> Iterator[Block]:
    yield Heading(text="Depth from a focused plenoptic camera", anchor="method-plenoptic", level=2)
    yield Paragraph(
        say(
            "The main lens (focal length *f*~M~) images a point at distance *a*~M~ in front of or behind the "
            "microlens array at distance *z*; every microlens that sees this image repeats it on the detector, a "
            "gap *b*~L~ behind the array. The virtual depth *v* = *a*~L~/*b*~L~ is positive for a Keplerian relay "
            "(image before the array) and negative for a Galilean one. Micro-image coordinates σ count from the "
            "centre of their own microlens."
        )
    )
    yield Equation(
        typst='a_M = f_M [1 + f_M / ((z - f_M) - b_L (x_"off"^1 - x_"off"^2) / (sigma^1 - sigma^2))]',
        alt="a M equals f M times one plus f M over the quantity z minus f M minus b L times the difference of the "
        "two microlens centres over the difference of the two micro-image coordinates.",
        reference="paper, eq. 8",
    )
    yield Paragraph(
        say(
            "It is evaluated through the focus shift *s* = *f*~M~²/(*a*~M~ − *f*~M~), an inverse depth that loses "
            "no digits at large distances. An error of the virtual depth and errors of *z* and *f*~M~ move depth by"
        )
    )
    yield Equation(
        typst="sigma_(a_M) = ((a_M - f_M) / f_M)^2 b_L sigma_v, quad"
        " (partial a_M) / (partial z) = -((a_M - f_M) / f_M)^2, quad"
        " (partial a_M) / (partial f_M) = (a_M / f_M)^2",
        alt="The standard deviation of a M equals the square of a M minus f M over f M, times b L, times the "
        "standard deviation of v. The derivative of a M with respect to z is minus the square of a M minus f M over "
        "f M; with respect to f M it is the square of a M over f M.",
    )
    yield Paragraph(
        say(
            "The last two have opposite signs: what matters is *z* − *f*~M~, so both are drawn jointly. How the "
            "error of one disparity becomes that of *v* depends on the declared estimator: it grows with *v*² for "
            "an adjacent pair (of any lenses, or of the same type), with *v* for the widest pair, and stays flat "
            "for all lenses in least squares."
        )
    )


def _unfocused_plenoptic() -> Iterator[Block]:
    yield Heading(text="Depth from an unfocused plenoptic camera", anchor="method-unfocused", level=2)
    yield Paragraph(
        say(
            "The main lens images the plane of focus, at *a*~0~, onto the array at *z*, and each pixel under a "
            "microlens sees through its own part of the pupil. Two views whose parts are Δ*u* apart show a point at "
            "distance *a* shifted by *d* on the array: a stereo rig inside one lens, whose sample is a microlens and "
            "not a pixel. Errors of disparity count in microlenses accordingly."
        )
    )
    yield Equation(
        typst="d = Delta u thin z (1/a - 1/a_0), quad 1/a = 1/f_M - 1/z + d / (Delta u thin z)",
        alt="d equals delta u times z times the quantity one over a minus one over a zero. One over a equals one over "
        "f M minus one over z plus d over delta u z.",
    )


def _stereo() -> Iterator[Block]:
    yield Heading(text="Depth from a stereo rig", anchor="method-stereo", level=2)
    yield Paragraph(
        say(
            "Two cameras of principal distance *c*, a baseline *B* apart, see a point at distance *Z* with disparity "
            "*d*; a yaw ψ between them adds *c*ψ to the disparity."
        )
    )
    yield Equation(
        typst="Z = (c B) / d, quad delta Z = Z^2 / (c B) thin delta d, quad delta Z approx Z^2 / B (1 + x^2 / c^2) psi",
        alt="Z equals c times B over d. The change of Z equals Z squared over c B times the change of d. A yaw psi "
        "changes Z by about Z squared over B, times one plus x squared over c squared, times psi.",
    )
    yield Paragraph(
        say(
            "These linear forms explain the sizes; the numbers come from the exact law, which has a pole where the "
            "yaw eats the whole disparity, at *Z* = *B*/ψ. The overlap of the two fields of view, 1 − *B*/*W* with "
            "*W* = 2 *Z* tan(FOV/2), bounds the near range. *c* is the distance of the sensor behind the lens: the "
            "focal length *f*, as where that comes from a calibration in pixels, or, where the study says “focused”, "
            "the image distance of a thin lens focused at *a*, *c* = *f* *a*/(*a*\u00a0−\u00a0*f*). The table of the "
            "cameras states *c* beside that image distance, which is longer than *f* by the share *f*/(*a* − *f*)."
        )
    )


def _uncertainty() -> Iterator[Block]:
    yield Heading(text="What discrimination and uncertainty mean", anchor="method-uncertainty", level=2)
    yield Bullets(
        (
            say(
                "**Depth discrimination**: the change of true depth that moves the disparity of the declared "
                "estimator by the declared step, nearer and farther. There is no noise and no calibration in it, "
                "and the step farther can be infinite."
            ),
            say(
                "**Depth uncertainty**: half the central 68.27 % interval of the depth from one measurement by a "
                "rig drawn from its calibration. It is stated three ways: pixel noise only, calibration only, and "
                "both."
            ),
            say(
                "**Quantiles, not standard deviations.** Depth is one over something that can reach zero, so its "
                "variance may not exist. Errors add up in disparity, an inverse depth; quantiles are taken there "
                "and mapped back by the exact law. A disparity beyond that of infinity is a depth of ∞ and stays in "
                "the quantiles."
            ),
        )
    )
    yield Equation(
        typst="a_p = a (d - Q_epsilon (p)), quad epsilon = sum_i epsilon_i",
        alt="The p quantile of depth is the depth that belongs to the disparity d minus the p quantile of the error "
        "epsilon of disparity; epsilon is the sum of the errors epsilon i of all parts.",
    )
    yield Paragraph(
        say(
            "*Q*~ε~ is the quantile of the sum of all parts, normal and uniform ones each in their own shape; "
            "*a*~p~ is ∞ where the disparity falls to that of infinity or below."
        )
    )
    yield Paragraph(
        "A calibration error is one draw per rig, pixel noise one draw per measurement: averaging many measurements "
        "shrinks the second, never the first."
    )


def _ranges(*, derived: bool) -> Iterator[Block]:
    yield Heading(text="Where a camera counts as usable", anchor="method-usable", level=2)
    yield Paragraph(
        "A distance is usable where every limit that the study declares holds. At each end of the range the limit that "
        "binds is named."
    )
    yield Bullets(
        (
            say("**Overlap**: the share of each stereo picture that the other camera sees too."),
            say(
                "**Total covering plane**: the image of the main lens lies at least that virtual depth from the array."
            ),
            say("**Availability**: the share of points that two of the microlenses which the estimator uses do see."),
            say("**Focus**: the geometric blur of the sharpest picture that the estimator needs, on the sensor."),
            say("**Last disparity step**: the disparity still differs from that of infinity by more than one step."),
            say("**Failed measurements**: the share that noise and calibration put beyond infinity."),
            say("**Relative uncertainty**: the depth uncertainty as a share of the distance."),
            *(
                (
                    say("**Saturation**: the brightest texture, three deviations above the mean, fits the pixels."),
                    say("**Matching**: the derived disparity error is one that a matcher can reach, at most 0.25 px."),
                )
                if derived
                else ()
            ),
        )
    )
