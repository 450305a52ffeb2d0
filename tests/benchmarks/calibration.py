"""Measures calibration by hand: coverage campaigns, the real rig, and what each tier costs.

    python -m tests.benchmarks.calibration coverage --trials 2000 --sampled 20
    python -m tests.benchmarks.calibration depth --trials 2000 --sampled 20
    python -m tests.benchmarks.calibration rig

The campaigns draw every truth from the prior, calibrate on a synthetic target held by hand (poses unknown), and ask
whether the 95 % depth intervals cover and whether the truths rank uniformly. All cells are judged together (Holm).
``depth`` asks it of every source and kind, near linear and far from it, of the 68 and 95 % intervals by the program's
own readings against plain numpy.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from tests.calibration.coverage import coverage_verdict, rank_verdict, run_trials
from tests.calibration.depth_coverage import CASES, COVERAGES, by_corners, by_errors, by_target
from tests.calibration.radial_rig import SHARED_NAMES
from tests.calibration.random_poses import tilted_poses
from tests.calibration.rig_draws import depth_of_draws
from tests.calibration.trials import CalibrationTrial, normal_priors
from tradestudy.calibration.corners.corner_file import read_corners
from tradestudy.calibration.corners.real_rig import fit_rig, observe_pair
from tradestudy.calibration.laplace import LaplaceFit
from tradestudy.calibration.posteriors import sample_rig
from tradestudy.calibration.synthetic_target import SyntheticTarget, flat_grid
from tradestudy.optics.arrays import BoolArray, FloatArray

FILE = Path(__file__).parents[2] / "studies" / "data" / "stereo_chessboard_corners.csv"
PITCH, PIXEL = 126.5e-6, 5.5e-6


def stereo_trial() -> CalibrationTrial:
    """The rig of the paper's table read as f = 30.5 mm on 10 µm pixels, baseline 100 mm, 0.2° on each rotation."""
    centre = np.array([3050.0, 3050, 0, 0, 0, 0] * 2 + [0, 0, 0, -0.1, 0, 0])
    deviation = np.array([30.0, 30, 10, 10, 0.05, 0.2] * 2 + [np.radians(0.2)] * 3 + [1e-3] * 3)
    poses = tilted_poses(8, (0.8, 2.5), 0.05, 0.3, np.random.default_rng(0))
    return CalibrationTrial(
        target=SyntheticTarget(points=flat_grid(5, 4, 0.04), poses=poses, noise=np.full(4, 0.1)),
        model=observe_pair,
        priors=normal_priors(SHARED_NAMES, centre, deviation),
        measurement=depth_of_draws,
        distances=np.array([0.3, 0.5, 1.0, 3.0, 10.0]),
    )


def plenoptic(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Disparity of adjacent microlenses and place of the central micro-image [px], from the thin lens."""
    z, f, gap = (parameters[..., k, None] for k in range(3))
    a = points[..., 2]
    disparity = PITCH * gap / (z - f * a / (a - f)) / PIXEL
    return np.concatenate([disparity[..., None], -points[..., :2] * (z / a)[..., None] / PIXEL], axis=-1)


def plenoptic_depth(truth: FloatArray, draws: FloatArray, distances: FloatArray) -> FloatArray:
    """Depths that drawn cameras read of the true disparity: a = f b/(b − f), b = z − b_L p/Δσ; inf beyond b = f."""
    disparity = plenoptic(truth, distances[:, None] * np.array([0.0, 0.0, 1.0]))[..., 0]
    z, f, gap = (draws[:, k, None] for k in range(3))
    shift = z - f - gap * PITCH / (disparity * PIXEL)
    return np.where(shift > 0.0, f + f * f / np.where(shift > 0.0, shift, 1.0), np.inf)


def plenoptic_trial() -> CalibrationTrial:
    """The camera of the paper's section 6 with a pair of adjacent lenses."""
    poses = tilted_poses(12, (0.15, 0.5), 0.1, 0.2, np.random.default_rng(0))
    centre = np.array([14.773e-3, 12.5e-3, 0.568e-3])
    return CalibrationTrial(
        target=SyntheticTarget(points=flat_grid(4, 3, 0.01), poses=poses, noise=np.full(3, 0.1)),
        model=plenoptic,
        priors=normal_priors(("mla_distance", "focal_length", "microlens_gap"), centre, np.full(3, 20e-6)),
        measurement=plenoptic_depth,
        distances=np.array([0.15, 0.3, 0.5, 1.0, 3.0]),
    )


def judge(title: str, trial: CalibrationTrial, shares: FloatArray, seconds: float, bins: int) -> None:
    """Print the verdicts of one campaign."""
    count = len(trial.distances)
    depths = shares[:, :count]
    verdict = coverage_verdict((depths > 0.025) & (depths < 0.975))
    print(f"{title}: {len(shares)} calibrations, {seconds:.0f} s")
    for distance, covered, p in zip(trial.distances, verdict.covered, verdict.adjusted_p_values, strict=True):
        print(f"  {distance:5.2f} m  covered {covered / len(shares):.4f}  adjusted p {p:.3f}")
    print(f"  95 % depth intervals cover: {verdict.passed} (family level {verdict.level:g})")
    if len(shares) >= 5 * bins:
        ranks = rank_verdict(shares, bins=bins)
        print(f"  ranks uniform: {ranks.passed}, smallest adjusted p {ranks.adjusted_p_values.min():.3f}")


def coverage(trials: int, sampled: int, seed: int) -> None:
    """Both cameras, Laplace draws for all trials, sampled posteriors for some."""
    for name, trial in (("stereo", stereo_trial()), ("plenoptic", plenoptic_trial())):
        begin = time.perf_counter()
        shares = run_trials(trial.by_laplace, trials, seed)
        judge(f"{name}, Laplace", trial, shares, time.perf_counter() - begin, bins=20)
        if sampled:
            begin = time.perf_counter()
            posterior = run_trials(trial.by_sampling, sampled, seed)
            judge(f"{name}, emcee", trial, posterior, time.perf_counter() - begin, bins=4)
            apart = np.abs(posterior - shares[:sampled]).max()
            print(f"  largest difference of a rank to the Laplace draws on the same data: {apart:.3f}", flush=True)


def depth(trials: int, sampled: int, seed: int, sources: Sequence[str]) -> None:
    """Every kind by declared errors, target and saved posterior, and the stereo rig by corners; some by emcee."""
    asked: dict[str, Callable[[int], BoolArray]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind, made in CASES.items():
            case, saved = made(), partial(by_target, made(), folder=Path(folder))
            asked[f"errors {kind}"] = partial(by_errors, case, max(trials, 2000))
            asked[f"target {kind}"] = partial(_repeat, partial(by_target, case), trials)
            asked[f"target {kind}, emcee"] = partial(_repeat, partial(by_target, case, sampled=True), sampled)
            asked[f"posterior {kind}"] = partial(_repeat, saved, trials)
        asked["corners stereo"] = partial(_repeat, by_corners, trials)
        asked["corners stereo, emcee"] = partial(_repeat, partial(by_corners, sampled=True), sampled)
        for title, compute in asked.items():
            if title.split()[0] in sources:
                begin = time.perf_counter()
                covered = compute(seed)
                _judge_depth(title, covered, time.perf_counter() - begin)


def _repeat(trial: Callable[[np.random.Generator], BoolArray], trials: int, seed: int) -> BoolArray:
    return run_trials(trial, trials, seed).astype(bool)


def _judge_depth(title: str, covered: BoolArray, seconds: float) -> None:
    """Print the verdict of one source and kind: both contents, near linear and far from it."""
    print(f"{title}: {len(covered)} calibrations, {seconds:.0f} s")
    for k, coverage in enumerate(COVERAGES):
        cells = covered[:, 2 * k : 2 * k + 2]
        verdict = coverage_verdict(cells, nominal=coverage)
        near, far = cells.mean(axis=0)
        p = verdict.adjusted_p_values.min()
        print(f"  {coverage:.2%}: near {near:.4f}, far {far:.4f}; smallest adjusted p {p:.3f}, passed {verdict.passed}")
    sys.stdout.flush()


def rig(seed: int) -> None:
    """The measured pair: fits, explanation of its residual, posterior, depth."""
    begin = time.perf_counter()
    fit = fit_rig(read_corners(FILE))
    print(f"fits: {time.perf_counter() - begin:.2f} s")
    sizes = (fit.left.corner_rms_px, fit.right.corner_rms_px, fit.pair.corner_rms_px)
    print("residuals left, right, pair: {:.4f} {:.4f} {:.4f} px".format(*sizes))
    explained = fit.explained
    print(f"view means: correlation left-right {fit.means.correlation:.4f}")
    print(
        f"with the term: {explained.left_rms_px:.4f} {explained.right_rms_px:.4f} px, motion "
        f"{1e3 * explained.motion_scale:.3f} mm, log likelihood +{explained.log_likelihood_gain:.0f}"
    )
    for name, value, factor in zip(SHARED_NAMES, explained.shared, explained.overconfidence, strict=True):
        print(f"  {name:34s} {value:12.6g}  overconfident without the term by {factor:.2f}")
    posterior = sample_rig(fit, rng=np.random.default_rng(seed))
    diagnostics = posterior.sample.diagnostics
    print(
        f"emcee: {posterior.sample.seconds:.1f} s, {posterior.sample.evaluations} evaluations, "
        f"converged {posterior.converged}, N/τ {diagnostics.lengths:.0f}, R-hat {diagnostics.r_hat.max():.4f}, "
        f"ESS {diagnostics.bulk_effective_size.min():.0f}/{diagnostics.tail_effective_size.min():.0f}, "
        f"acceptance {diagnostics.acceptance.mean():.2f}, efficiency at exact points {posterior.check.efficiency:.3f}"
    )
    distances = np.array([0.3, 0.5, 1.0, 2.0, 3.0, 5.0])
    draws = {
        "posterior": posterior.sample.thinned(4000)[:, :18],
        "Laplace, without the term": _normal(fit.pair.shared, fit.pair.covariance).draw(
            np.random.default_rng(seed), 4000
        ),
    }
    for name, sample in draws.items():
        quantiles = np.quantile(
            depth_of_draws(explained.shared, sample, distances), [0.025, 0.15865, 0.84135, 0.975], axis=0
        )
        print(name)
        for distance, row in zip(distances, quantiles.T, strict=True):
            print(
                f"  {distance:4.1f} m: 95 % {row[0]:.4f} to {row[3]:.4f} m, half 68 % {500 * (row[2] - row[1]):.2f} mm"
            )


def _normal(mean: FloatArray, covariance: FloatArray) -> LaplaceFit:
    """A fit as a distribution to draw from."""
    return LaplaceFit(names=SHARED_NAMES, mean=mean, covariance=covariance)


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["coverage", "depth", "rig"])
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--sampled", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sources", nargs="+", default=["errors", "target", "posterior", "corners"])
    arguments = parser.parse_args()
    if arguments.what == "coverage":
        coverage(arguments.trials, arguments.sampled, arguments.seed)
    elif arguments.what == "depth":
        depth(arguments.trials, arguments.sampled, arguments.seed, arguments.sources)
    else:
        rig(arguments.seed)


if __name__ == "__main__":
    main()
