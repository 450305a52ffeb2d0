"""Rigs fitted to simulated corners: how often intervals of depth cover, and stated against true deviations.

    python -m tests.campaigns.corner_trust --sets 200 --seed 1

Twelve views of white noise, and twelve of noise like that of a real rig: shared by neighbours, different between views.
Each set takes about six seconds of processor time. Figures go to corner_trust.md beside this file.

The true deviation of a set follows from its error e and from the error c of a fit that knows noise and motion and has
the known variance v: E[e²] = v (1 + E[(e² − c²)/v]). That mean varies several times less between samples than E[e²].
"""

from __future__ import annotations

import argparse
from typing import Final

import numpy as np

from tests.calibration.known_scales import errors_and_covariance
from tests.calibration.noisy_corners import TRUTH, simulated
from tests.campaigns import record
from tradestudy.calibration.corners.real_rig import fit_rig, inverse_depth, observe_pair, points_midway
from tradestudy.optics.arrays import FloatArray

DISTANCES: Final = np.array([0.3, 0.5, 1.0, 2.0, 5.0])
VIEWS: Final = 12
HEADER: Final = ("Noise", "distance", "68 % intervals cover", "stated over true", "stated over spread of errors")


def score(rng: np.random.Generator, *, white: bool) -> FloatArray:
    """Error, stated deviation, error with known scales and its deviation, of inverse depth [1/m], shape (4, D)."""
    seen = simulated(VIEWS, rng, white=white)
    found = fit_rig(seen.corners)
    points = observe_pair(TRUTH, points_midway(TRUTH, DISTANCES))
    size = 1e-2 * np.sqrt(np.diag(found.covariance))
    error = inverse_depth(found.explained.shared, points) - 1.0 / DISTANCES
    stated = _deviation(_slopes(found.explained.shared, points, size), found.covariance)
    ideal, covariance = errors_and_covariance(seen)
    slopes = _slopes(TRUTH, points, size)
    return np.stack([error, stated, ideal @ slopes, _deviation(slopes, covariance)])


def _slopes(shared: FloatArray, points: FloatArray, size: FloatArray) -> FloatArray:
    """Derivatives of inverse depth by the shared parameters, shape (P, D), by differences of these steps."""
    up, down = (inverse_depth(shared + sign * np.diag(size), points) for sign in (1.0, -1.0))
    return (up - down) / (2.0 * size[:, None])


def _deviation(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    return np.sqrt(np.einsum("id,ij,jd->d", slopes, covariance, slopes))


def ratios(scores: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Median stated over true deviation, its standard error, and median stated over the spread of errors, each (D,).

    Parameters
    ----------
    scores : array (K, 4, D)
        Of K sets; see `score`.
    """
    error, stated, ideal, known = np.moveaxis(scores, 1, 0)
    gain = (error**2 - ideal**2) / known**2
    variance = 1.0 + np.mean(gain, axis=0)
    ratio = np.median(stated / known, axis=0) / np.sqrt(variance)
    uncertain = 0.5 * ratio * np.std(gain, axis=0) / (variance * np.sqrt(len(scores)))
    return ratio, uncertain, np.median(stated, axis=0) / np.std(error, axis=0)


def rows(name: str, scores: FloatArray) -> list[tuple[str, ...]]:
    """Lines of the table."""
    covered = 100.0 * np.mean(np.abs(scores[:, 0]) < scores[:, 1], axis=0)
    columns = zip(DISTANCES, covered, *ratios(scores), strict=True)
    return [
        (name, f"{z:g} m", f"{cover:.0f} %", f"{ratio:.2f} ± {error:.2f}", f"{plain:.2f}")
        for z, cover, ratio, error, plain in columns
    ]


def main() -> None:
    """Run and record the campaign."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    table = []
    for name, white in (("white", True), ("like a real rig's", False)):
        scores = []
        for k in range(asked.sets):
            scores.append(score(np.random.default_rng([asked.seed, k]), white=white))
            print(f"{name}: {k + 1} of {asked.sets}", end="\r", flush=True)
        table += rows(name, np.array(scores))
    command = f"python -m tests.campaigns.corner_trust --sets {asked.sets} --seed {asked.seed}"
    print(record.write("corner_trust", "Rigs fitted to simulated corners", command, HEADER, table).read_text())


if __name__ == "__main__":
    main()
