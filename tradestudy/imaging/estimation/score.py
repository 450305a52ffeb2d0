"""An estimated depth map held against the true one, and against what the camera was predicted to reach."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.cameras.depth_map import DepthMap, TrueDepth
from tradestudy.optics.arrays import Samples
from tradestudy.optics.window_matching import Reason
from tradestudy.units import FRACTION, LENGTH, pretty, significant

_CENTRAL = (15.865, 50.0, 84.135)  # percentiles: half their width is one standard deviation of a normal distribution


@dataclass(frozen=True, kw_only=True)
class DepthScore:
    """How a depth map compares with the truth.

    Parameters
    ----------
    seen
        Points that the estimator can measure: it has two pictures of them, and nothing hides them.
    measured
        How many of these have a depth.
    elsewhere
        Depths that it gives to points that it cannot measure, such as hidden ones.
    bias, spread
        Median of estimated less true depth, and half its central 68.27 % interval [m].
    own
        Median standard deviation that the map states from its texture [m].
    predicted
        Median of the camera's predicted depth uncertainty at the true distances [m]; NaN where there is none.
    relative_bias, relative_spread
        Those of the errors over the prediction at their distances.
    within
        Share of the errors within three predictions.
    reasons
        Seen points without a depth, by reason.
    matcher
        What a study may declare as the matcher that these errors show, or why that cannot be told; see `fit_matcher`.
    """

    seen: int
    measured: int
    elsewhere: int
    bias: float
    spread: float
    own: float
    predicted: float
    relative_bias: float
    relative_spread: float
    within: float
    reasons: dict[str, int]
    matcher: str = ""

    def line(self, name: str) -> str:
        """One sentence or two for the terminal."""
        if not self.seen:
            return (
                f"{name}: no point of the scene lies where its estimator has two pictures of it within scene.distances"
            )
        share = pretty(self.measured / self.seen, FRACTION)
        text = f"{name}: {share} of {self.seen} unoccluded points measured"
        if not self.measured:
            return f"{text}; none has a depth: {_most(self.reasons)}"
        text += f"; error {pretty(self.bias, LENGTH)} ± {pretty(self.spread, LENGTH)} (median, standard deviation)"
        if math.isnan(self.predicted):
            return f"{text}; nothing is predicted for this kind of camera"
        return (
            f"{text}, predicted {pretty(self.predicted, LENGTH)}; in predicted standard deviations "
            f"{significant(self.relative_bias, 2)} ± {significant(self.relative_spread, 2)}, "
            f"{pretty(self.within, FRACTION)} of the errors within 3"
        )


def score(found: DepthMap, truth: TrueDepth, predicted: Samples) -> DepthScore:
    """Hold a map against the truth.

    Parameters
    ----------
    found, truth
        In the same pixels.
    predicted
        Depth uncertainty at the true depth of each pixel [m]; NaN where there is none.
    """
    measured = found.reason == Reason.MEASURED
    both = measured & truth.measurable
    error, scale = (found.depth - truth.depth)[both], predicted[both]
    low, middle, high = _percentiles(error)
    known = np.isfinite(scale) & (scale > 0.0)
    relative = error[known] / scale[known]
    below, centre, above = _percentiles(relative)
    missing = found.reason[truth.measurable & ~measured]
    return DepthScore(
        seen=int(np.count_nonzero(truth.measurable)),
        measured=int(np.count_nonzero(both)),
        elsewhere=int(np.count_nonzero(measured & ~truth.measurable)),
        bias=middle,
        spread=(high - low) / 2.0,
        own=_percentiles(found.deviation[both])[1],
        predicted=_percentiles(scale[known])[1],
        relative_bias=centre,
        relative_spread=(above - below) / 2.0,
        within=float(np.mean(np.abs(relative) <= 3.0)) if relative.size else math.nan,
        reasons={
            Reason(code).name.lower().replace("_", " "): int(count)
            for code, count in zip(*np.unique(missing, return_counts=True), strict=True)
        },
    )


def _percentiles(values: Samples) -> tuple[float, float, float]:
    values = values[np.isfinite(values)]
    if not values.size:
        return math.nan, math.nan, math.nan
    low, middle, high = (float(one) for one in np.percentile(values, _CENTRAL))
    return low, middle, high


def _most(reasons: dict[str, int]) -> str:
    """The most frequent reason."""
    return max(reasons, key=lambda name: reasons[name])
