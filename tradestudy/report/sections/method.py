"""The method: equations for depth and its uncertainty."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any

import xarray as xr

from tradestudy.report.document import Block, Bullets, Equation, Heading, Paragraph, say
from tradestudy.results.views.depth import declared_matchers
from tradestudy.results.views.groups import depth_methods, group, has


def describe_method(tree: xr.DataTree) -> Iterator[Block]:
    """Explain the method, for the kinds of camera in the study."""
    if not has(tree, "depth"):
        return
    yield Heading(text="Method", anchor="method")
    methods = {method["name"]: method for method in depth_methods(tree).values()}.values()
    for method in methods:
        yield Heading(text=method["title"], anchor=f"method-{method['name']}", level=2)
        yield from _statements(method["statements"])
    yield from _uncertainty()
    met = group(tree, "depth")["limit_met"]
    applied = {str(limit) for limit in met["limit"].values if bool((met.sel(limit=limit) >= 0).any())}
    if "matching" in applied:
        matchers = bool(declared_matchers(tree))
        compared = [statement for method in methods for statement in method.get("matching", ())]
        yield from _derived_disparity(str(group(tree, "depth").attrs["matching_needs"]), compared, matchers=matchers)
    yield from _ranges(applied)


def _derived_disparity(needs: str, compared: Iterable[Any], *, matchers: bool) -> Iterator[Block]:
    yield Heading(text="Disparity errors derived from the picture", anchor="method-derived", level=2)
    yield Paragraph(
        "A derived disparity error is the Cramér–Rao bound for matching two windows of the camera's pictures. They "
        "show a random texture of the declared contrast and correlation length, blurred by defocus, diffraction and "
        "pixels, with shot, read and quantisation noise; aliased texture counts as noise."
    )
    yield Equation(
        typst="1 / sigma_d^2 = W^2 integral.double (2 pi nu_x)^2 gamma^2 / (1 - gamma^2) dif^2 nu, quad "
        "gamma = (S abs(H)^2) / (S abs(H)^2 + N)",
        alt="one over sigma d squared equals W squared times the integral over the band of two pi nu x squared times "
        "gamma squared over one minus gamma squared; gamma equals S H squared over S H squared plus N",
    )
    yield Paragraph(
        say(
            "*ν* is the spatial frequency in the picture, *ν*~x~ its component along the disparity, *S* the spectrum "
            "of the texture, *N* that of the noise, and *H* the transfer function of lenses and pixels. *W* is the "
            "side of the window: as declared or, if smaller, that of the part of an object that both pictures show. "
            "A good matcher reaches the bound where the error is small compared with a pixel and the "
            "window large compared with blur and texture: this requires {needs}. Elsewhere the limit “matching” makes "
            "a distance unusable. This limit depends on the declared window as much as on the camera: a larger "
            "window moves it, and so does an estimator that compares microlenses closer together.",
            needs=needs,
        )
    )
    yield from _statements(compared)
    yield Paragraph(
        "Off the axis, the light decreases with cos⁴ of the field angle. Where the study declares a second stop, the "
        "rims of the two stops also clip the pupil, most along the radius of the field. In a stereo rig, this clipping "
        "darkens the picture. Behind a microlens, each pixel receives light from one part of the "
        "pupil. The rims therefore remove whole views from an unfocused plenoptic camera. In a focused one they narrow "
        "the micro-images, so that fewer microlenses see each point and the baselines between them are shorter. The "
        "computation uses the radial width of the clipped pupil, the smallest, for all directions."
    )
    if not matchers:
        yield Paragraph(
            "No matcher can do better than the Cramér–Rao bound. The study does not declare how much larger the "
            "error of a real matcher is."
        )
        return
    yield Equation(
        typst="sigma^2 = (k sigma_d)^2 + f^2 + A^2 / 2",
        alt="sigma squared equals k sigma d squared, plus f squared, plus half of A squared",
    )
    yield Paragraph(
        say(
            "This is the error of a declared matcher: *k* is its noise over the bound, *f* a floor that remains "
            "however much light there is, *A* the amplitude of its pixel locking. Pixel locking is a bias that is "
            "periodic in the disparity. Its phase is unknown for one measurement, so its rms of *A*/√2 adds like "
            "noise, but it does not average out at one distance. A false match measures nothing: if a fraction *m* of "
            "the matches is false and a fraction *q* of the others ends beyond infinity, 1 − (1 − *q*)(1 − *m*) of "
            "all measurements fail, and the depth uncertainty is that of the true matches."
        )
    )


def _statements(statements: Iterable[Any]) -> Iterator[Block]:
    """Paragraphs and equations on one kind of camera, from the results."""
    for statement in statements:
        if isinstance(statement, str):
            yield Paragraph(say(statement))
        else:
            yield Equation(**statement)


def _uncertainty() -> Iterator[Block]:
    yield Heading(text="What discrimination and uncertainty mean", anchor="method-uncertainty", level=2)
    yield Bullets(
        (
            say(
                "**Depth discrimination**: the change of true depth that moves the disparity of the declared "
                "estimator by the declared step, stated for nearer and farther points. It includes neither noise "
                "nor calibration errors. The change to a farther distance can be infinite."
            ),
            say(
                "**Depth uncertainty**: half the width of the interval that contains the central 68.27 % of single "
                "measurements of depth, given noise and the errors that remain after calibration. It is stated for "
                "matching noise only, calibration errors only, and both."
            ),
            say(
                "**Error radius**: the distance from the true depth within which 68.27 % of all measurements lie; "
                "failed measurements and false matches count as infinitely wrong. Cameras are judged by the larger of "
                "depth uncertainty and error radius, because the interval is that of the measurements, whose median "
                "may be off."
            ),
            say(
                "**Quantiles, not standard deviations.** Depth is the inverse of a quantity that can reach zero, so "
                "its variance may not exist. Errors are propagated to inverse depth; quantiles are taken there and "
                "mapped back. An inverse depth of zero or below counts as a depth of ∞."
            ),
        )
    )
    yield Equation(
        typst="a_p = 1 / (Q_rho (1 - p)), quad rho = rho(a, epsilon_1, epsilon_2, ...)",
        alt="The p quantile of depth is one over the one minus p quantile of inverse depth rho, which the camera "
        "measures at the distance a under all errors epsilon.",
    )
    yield Paragraph(
        say(
            "*a*~p~ is the depth that a fraction *p* of all measurements does not exceed, and *Q*~ρ~ the quantile of "
            "the inverse depth *ρ*, which the exact model gives for a point at the distance *a*, with noise and all "
            "calibration errors *ε* drawn jointly."
        )
    )
    yield Paragraph(
        say(
            "**What decides the uncertainty** is the error source with the largest share of the variance of inverse "
            "depth. Shares are Shapley shares: variance due to correlated errors is divided fairly among them, so that "
            "the shares sum to 100 % (Owen and Prieur 2017)."
        )
    )
    yield Paragraph(
        say(
            "**Linear** propagation takes the covariance of all errors through the derivatives of that model at each "
            "distance; a comparison with random draws through the model gives the error of this approximation. "
            "**Exact** propagation sends eight independently randomised sets of evenly spread (Sobol) draws through "
            "the model itself and reuses them at every distance. A result is *converged* when the eight sets "
            "determine every reported half-width to within the tolerance (95 % *t*-interval); where an interval has "
            "no far end, the fraction of failed measurements is judged instead. The program uses linear propagation "
            "where a trial shows that its error stays within the tolerance. The numerical error of a result is the "
            "standard error over the eight sets or, under linear propagation, the estimated error of linearising at "
            "that distance. What the chosen models leave out is stated separately, in “What was simulated, and what "
            "was not”: the largest change over all distances, with a safety margin where it is not computed."
        )
    )
    yield Paragraph(
        "A calibration error is drawn once per camera, matching noise once per measurement: averaging many "
        "measurements reduces the noise, never the calibration error."
    )


def _ranges(applied: Collection[str]) -> Iterator[Block]:
    """Explain the limits that apply to cameras of the study."""
    yield Heading(text="Where a camera counts as usable", anchor="method-usable", level=2)
    yield Paragraph(
        "A camera is usable at a distance where it meets all of the limits below. The report names the limit that sets "
        "each end of the usable range."
    )
    meanings = {
        "overlap": say("**Overlap**: each camera sees at least the declared fraction of the other's picture."),
        "total_covering_plane": say(
            "**Total covering plane**: the magnitude of the virtual depth is at least the declared one."
        ),
        "availability": say(
            "**Availability**: at least the declared fraction of points is seen by two or more of the microlenses that "
            "the estimator uses."
        ),
        "focus": say(
            "**Focus**: the geometric blur on the sensor, in the least sharp picture that the estimator needs, is at "
            "most the declared one; diffraction does not count."
        ),
        "last_disparity_step": say(
            "**Last disparity step**: the disparity still differs by more than one step from that of a point at "
            "infinity."
        ),
        "disparity_range": say(
            "**Search range**: the disparity, less that of a point at infinity, is at most the largest one that the "
            "matcher searches, as declared."
        ),
        "failed_fraction": say(
            "**Failed measurements**: at most the declared fraction of measurements fail. A measurement fails if noise "
            "and calibration errors put it beyond infinity"
            + (", or if it is a false match, where the study declares some." if "matching" in applied else ".")
        ),
        "relative_uncertainty": say(
            "**Relative uncertainty**: the larger of depth uncertainty and error radius is at most the declared "
            "fraction of the distance."
        ),
        "saturation": say(
            "**Saturation**: the brightest texture, three standard deviations above the mean, does not saturate the "
            "pixels."
        ),
        "matching": say(
            "**Matching**: a real matcher can come close to the bound on the disparity error: this bound is at most "
            "0.25 px, and the window is large enough for the blur and the texture."
        ),
    }
    yield Bullets(tuple(meaning for limit, meaning in meanings.items() if limit in applied))
