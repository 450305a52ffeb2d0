"""How near a real matcher comes to the Cramér–Rao bound, and where it leaves it: outliers, pixel locking.

``python -m tests.campaigns.matching`` draws pairs of pictures, matches them as a program would that knows the disparity
to a few pixels (whole pixels by the least squared difference, then Lucas and Kanade), and writes ``matching.md``.
Errors of another match are counted and left out; they are left out of the normal distribution of the bound as well.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np
from scipy.stats import norm, truncnorm

from tests.campaigns import record
from tests.imaging.matcher import Scene, best_integer, lucas_kanade, picture_pairs
from tests.imaging.scenes import bound_of

REACH = 5  # whole pixels that are searched to either side
OUTLIER = 0.5  # an error of half a pixel or more is another match, not a worse one
MOST_TAILS = 0.1
FRACTIONS = np.arange(8) / 8.0
SMOOTHING = 0.7

HEADER = (
    "what is tried", "electrons", "contrast", "correlation px", "blur px", "noise e", "window px", "pairs",
    "bound px", "applies", "without tails px", "rms px", "rms / bound", "±", "outliers", "of the bound", "locking px",
)  # fmt: skip


def scene(**changes: float) -> Scene:
    """A fair picture, with some of it changed."""
    values = {"electrons": 5000.0, "contrast": 0.1, "length_px": 3.0, "blur_px": 2.0, "noise": 75.0, "window": 15}
    return Scene(**(values | changes))  # type: ignore[arg-type]  # the window alone is a whole number


TRIED: tuple[tuple[str, Scene], ...] = (
    ("a fair picture", scene()),
    ("more contrast", scene(contrast=0.3)),
    ("less contrast", scene(contrast=0.05)),
    ("less contrast still", scene(contrast=0.03)),
    ("hardly any contrast", scene(contrast=0.02)),
    ("barely any contrast", scene(contrast=0.0175)),
    ("lost in noise", scene(contrast=0.01)),
    ("less light", scene(electrons=500.0, noise=26.0)),
    ("little light", scene(electrons=100.0, noise=16.0)),
    ("blur of 4 px", scene(blur_px=4.0)),
    ("blur of 8 px", scene(blur_px=8.0)),
    ("blur of 10 px", scene(blur_px=10.0, contrast=0.3)),
    ("blur as wide as the window", scene(blur_px=15.0, contrast=0.3)),
    ("blur of 8 px in a wide window", scene(blur_px=8.0, window=31)),
    ("a window of 9 px", scene(window=9)),
    ("a window of 5 px", scene(window=5)),
    ("a window of 5 px, much contrast", scene(window=5, contrast=0.3)),
    ("a wide window", scene(window=31)),
    ("coarse texture", scene(length_px=10.0)),
    ("texture coarser than the window", scene(length_px=30.0)),
    ("texture much coarser than the window", scene(length_px=60.0)),
    ("fine texture, sharp: aliased", scene(length_px=0.5, blur_px=0.0)),
    ("fine texture, sharp and bright: aliased", scene(length_px=0.5, blur_px=0.0, contrast=0.3)),
    ("sharp and bright: aliased", scene(blur_px=0.0, contrast=0.3)),
    ("the same, blurred by 2 px", scene(blur_px=2.0, contrast=0.3, length_px=0.5)),
)


def measured(tried: Scene, pairs: int, rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Root mean square of the errors that are none of another match and its standard error, share of those, locking.

    Lengths in px. Locking is half the spread of the mean error over the fractions of a pixel, less what chance would
    make of it.
    """
    whole = rng.integers(-2, 3, FRACTIONS.size)
    disparity = whole + FRACTIONS
    each = pairs // FRACTIONS.size
    left, right = picture_pairs(tried, disparity, each, rng)
    errors = np.empty((FRACTIONS.size, each))
    for k, (a, b) in enumerate(zip(left, right, strict=True)):
        start = best_integer(a, b, tried.window, REACH)
        found = lucas_kanade(a, b, tried.window, smoothing=SMOOTHING, start=float(start))
        errors[k // each, k % each] = found - disparity[k // each]
    lost = ~(np.abs(errors) < OUTLIER)
    kept = np.where(lost, np.nan, errors)
    counts = np.sum(~lost, axis=1)
    if np.any(counts < each // 4):
        return np.nan, np.nan, float(lost.mean()), np.nan
    means = np.nanmean(kept, axis=1)
    chance = float(np.mean(np.nanvar(kept, axis=1, ddof=1) / counts))
    locking = np.sqrt(2.0 * max(float(np.var(means, ddof=1)) - chance, 0.0))  # amplitude of a sinusoid of that variance
    rms = float(np.sqrt(np.nanmean(kept**2)))
    uncertain = float(np.nanstd(kept**2) / np.sqrt(counts.sum()) / (2.0 * rms))
    return rms, uncertain, float(lost.mean()), float(locking)


def row(words: str, tried: Scene, pairs: int, rng: np.random.Generator) -> Sequence[object]:
    """One line of the record."""
    bound = bound_of(tried)
    rms, uncertain, lost, locking = measured(tried, pairs, rng)
    broken = [name for name, where in bound.violated.items() if where[0]]
    value = float(bound.value[0])
    # Normal errors as small as the bound would lose some of their tails as outliers, too. Where many do, what is left
    # is as wide as the window for outliers, whatever it is: no ratio says anything there.
    ends = (-OUTLIER / value, OUTLIER / value)
    least, tails = value * float(truncnorm.std(*ends)), 2.0 * float(norm.cdf(ends[0]))
    reported = tails < MOST_TAILS
    return (
        words, f"{tried.electrons:g}", f"{tried.contrast:g}", f"{tried.length_px:g}", f"{tried.blur_px:g}",
        f"{tried.noise:g}", tried.window, pairs, f"{value:.4f}", "; ".join(broken) or "yes", f"{least:.4f}",
        f"{rms:.4f}", f"{rms / least:.2f}" if reported else "—", f"{uncertain / least:.2f}" if reported else "—",
        f"{100 * lost:.1f} %", f"{100 * tails:.1f} %", f"{locking:.4f}",
    )  # fmt: skip


def main() -> None:
    """Run the campaign and write its record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=3200, help="pairs of pictures for each line")
    parser.add_argument("--seed", type=int, default=20240612)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    rows = [row(words, tried, given.pairs, rng) for words, tried in TRIED]
    title = "A matcher against its bound"
    command = f"python -m tests.campaigns.matching --pairs {given.pairs} --seed {given.seed}"
    print(record.write("matching", title, command, HEADER, rows))


if __name__ == "__main__":
    main()
