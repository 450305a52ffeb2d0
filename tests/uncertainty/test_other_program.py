"""Sobol indices against SALib's, which draws and estimates on its own."""

from __future__ import annotations

import warnings

import numpy as np

from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.sensitivity import sobol_indices
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources

DEVIATIONS = {"baseline": 1e-2, "focal_length": 8e-4, "disparity": 4e-5}
F, B, D = 8e-3, 0.1, 4e-4


def depth(baseline: np.ndarray, focal_length: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """Stereo depth with errors of a tenth, so that products of errors count too."""
    return (F + focal_length) * (B + baseline) / (D + disparity)


def test_indices_of_stereo_depth_are_those_of_another_program() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own imports
        from SALib.analyze import sobol as analyse
        from SALib.sample import sobol as sample

    problem = {
        "num_vars": 3,
        "names": list(DEVIATIONS),
        "bounds": [[0.0, deviation] for deviation in DEVIATIONS.values()],
        "dists": ["norm"] * 3,
    }
    drawn = sample.sample(problem, 2**13, calc_second_order=False, seed=5)
    theirs = analyse.analyze(problem, depth(*drawn.T), calc_second_order=False, seed=5)
    ours = sobol_indices(
        lambda v: depth(v["baseline"], v["focal_length"], v["disparity"]),
        Sources(
            groups=tuple(
                Source(
                    name=name,
                    distribution=Normal(mean=0.0, standard_deviation=deviation),
                    error_class=ErrorClass.RIG,
                )
                for name, deviation in DEVIATIONS.items()
            )
        ),
        draws=2**13,
        seed=0,
        point="salib",
    )
    assert theirs["S1"].sum() < 0.995  # the errors do interact
    np.testing.assert_allclose(np.ravel(ours.first), theirs["S1"], atol=3 * theirs["S1_conf"].max())
    np.testing.assert_allclose(np.ravel(ours.total), theirs["ST"], atol=3 * theirs["ST_conf"].max())
    assert theirs["ST_conf"].max() < 0.05
    assert theirs["S1"].min() > 0.2
