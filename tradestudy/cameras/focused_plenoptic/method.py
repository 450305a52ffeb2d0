"""How a focused plenoptic camera finds depth, for the readers of a report."""

from __future__ import annotations

from typing import Final

from tradestudy.cameras.method import Formula, Method

METHOD: Final = Method(
    name="plenoptic",
    title="Depth from a focused plenoptic camera",
    statements=(
        "The main lens (focal length *f*~M~) forms the image of a point at distance *a*~M~. The microlens array is a "
        "distance *z* behind the main lens, and the image lies *a*~L~ in front of the array (Keplerian), or behind it "
        "(Galilean), where *a*~L~ is negative. Every microlens that sees this image forms an image of it on the "
        "sensor, a gap *b*~L~ behind the array. The virtual depth is *v* = *a*~L~/*b*~L~; the total covering plane "
        "is the object distance at which its magnitude is 2. Two microlenses whose centres are at *x*~off~ show the "
        "point at the position σ, measured in each micro-image from the centre of its microlens; superscripts "
        "distinguish the two:",
        Formula(
            typst='a_M = f_M [1 + f_M / ((z - f_M) - b_L (x_"off"^1 - x_"off"^2) / (sigma^1 - sigma^2))]',
            alt="a M equals f M times one plus f M over the quantity z minus f M minus b L times the difference of the "
            "two microlens centres over the difference of the two micro-image coordinates.",
            reference="paper, eq. 8",
        ),
        "A calibration may correct this depth by a quadratic function of it (`depth.scaling`). Its derivative then "
        "multiplies the depth uncertainty.",
        "The standard deviation σ~v~ of the virtual depth, and errors of *z* and *f*~M~, affect depth as follows:",
        Formula(
            typst="sigma_(a_M) = ((a_M - f_M) / f_M)^2 b_L sigma_v, quad"
            " (partial a_M) / (partial z) = -((a_M - f_M) / f_M)^2, quad"
            " (partial a_M) / (partial f_M) = (a_M / f_M)^2",
            alt="The standard deviation of a M equals the square of a M minus f M over f M, times b L, times the "
            "standard deviation of v. The derivative of a M with respect to z is minus the square of a M minus f M "
            "over f M; with respect to f M it is the square of a M over f M.",
        ),
        "The two derivatives have opposite signs: depth depends mainly on the error of *z* − *f*~M~, and therefore on "
        "how the errors of *z* and *f*~M~ are correlated. For a given disparity error, the error of *v* depends on "
        "the declared estimator: it grows with *v*² for the nearest pair of microlenses (of any type, or of "
        "one type), with *v* for the widest pair, and is constant for least squares over all microlenses.",
    ),
    matching=(
        "A focused plenoptic camera compares two micro-images, each *n* in diameter, over the part of the object that "
        "both show. If their microlenses are *D* apart, the micro-images are offset by *d* once their textures are "
        "aligned. If the image lies a distance *b*~M~ behind the main lens, the largest square that fits into both "
        "has the side *w*:",
        Formula(
            typst="w = (sqrt(2 n^2 - d^2) - d) / 2, quad d = D / abs(v) thin b_M / z",
            alt="w equals half of the square root of two n squared minus d squared, less d, where d is D over the "
            "absolute value of v, times b M over z.",
        ),
        "The matching window of a pair is this square or the declared window, whichever is smaller. Of the pairs that "
        "see a point, the widest one has the longest baseline and the smallest window. Least squares adds the "
        "information of all pairs, each with its own window.",
    ),
)
