"""How a focused plenoptic camera finds depth, for the readers of a report."""

from __future__ import annotations

from typing import Final

from tradestudy.cameras.method import Formula, Method

METHOD: Final = Method(
    name="plenoptic",
    title="Depth from a focused plenoptic camera",
    statements=(
        "The main lens (focal length *f*~M~) images a point at distance *a*~M~ in front of or behind the "
        "microlens array at distance *z*; every microlens that sees this image repeats it on the detector, a "
        "gap *b*~L~ behind the array. The virtual depth *v* = *a*~L~/*b*~L~ is positive for a Keplerian relay "
        "(image in front of the array) and negative for a Galilean one. Micro-image coordinates σ are measured "
        "from the centre of their own microlens.",
        Formula(
            typst='a_M = f_M [1 + f_M / ((z - f_M) - b_L (x_"off"^1 - x_"off"^2) / (sigma^1 - sigma^2))]',
            alt="a M equals f M times one plus f M over the quantity z minus f M minus b L times the difference of the "
            "two microlens centres over the difference of the two micro-image coordinates.",
            reference="paper, eq. 8",
        ),
        "The program evaluates it through the focus shift *s* = *f*~M~²/(*a*~M~ − *f*~M~), an inverse depth that "
        "loses no digits at large distances. An error of the virtual depth and errors of *z* and *f*~M~ move depth by",
        Formula(
            typst="sigma_(a_M) = ((a_M - f_M) / f_M)^2 b_L sigma_v, quad"
            " (partial a_M) / (partial z) = -((a_M - f_M) / f_M)^2, quad"
            " (partial a_M) / (partial f_M) = (a_M / f_M)^2",
            alt="The standard deviation of a M equals the square of a M minus f M over f M, times b L, times the "
            "standard deviation of v. The derivative of a M with respect to z is minus the square of a M minus f M "
            "over f M; with respect to f M it is the square of a M over f M.",
        ),
        "The last two have opposite signs: what matters is *z* − *f*~M~, and thus the correlation of both errors. "
        "How the error of one disparity becomes that of *v* depends on the declared estimator: it "
        "grows with *v*² for an adjacent pair (of any lenses, or of the same type), with *v* for the widest pair, "
        "and is constant for least squares over all lenses.",
        "A derived disparity error compares two micro-images of diameter *n* on the sensor in the part of the object "
        "that both show. With the textures aligned, micro-images of microlenses a distance *D* apart lie *d* apart, "
        "and the largest square in both has the side *w*:",
        Formula(
            typst="w = (sqrt(2 n^2 - d^2) - d) / 2, quad d = D / abs(v) thin b_M / z",
            alt="w equals half of the square root of two n squared minus d squared, less d, where d is D over the "
            "absolute value of v, times b M over z.",
        ),
        "A pair uses that window or the declared one, whichever is smaller; the widest pair has the longest baseline "
        "that sees a point, and the smallest window. Least squares adds the information of all pairs, each with its "
        "own window.",
    ),
)
