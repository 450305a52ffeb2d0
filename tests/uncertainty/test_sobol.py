import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import qmc

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.streams import MOST_DIMENSIONS, point_generator, scrambled_sobol

STUDIES = Path(__file__).parents[2] / "studies"


def generator() -> np.random.Generator:
    return point_generator(seed=3, point="sobol", replicate=1)


@pytest.mark.parametrize("dimensions", [1, 2, 3, 11, 40, MOST_DIMENSIONS])
def test_points_equal_those_of_scipy_however_they_are_requested(dimensions: int) -> None:
    ours = scrambled_sobol(dimensions, generator())
    theirs = qmc.Sobol(dimensions, bits=52, rng=generator())
    for n in (1, 1, 2, 4, 1024, 5, 700, 2048):
        np.testing.assert_array_equal(ours(n), theirs.random(n).T + 2.0**-53)


def test_no_dimension_at_all() -> None:
    assert scrambled_sobol(0, generator())(8).shape == (0, 8)


def test_more_dimensions_than_direction_numbers_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match=r"1025.*<= 1024"):
        scrambled_sobol(MOST_DIMENSIONS + 1, generator())


def test_planning_a_study_with_draws_does_not_load_scipy_stats() -> None:
    script = "import sys, tradestudy; tradestudy.load(sys.argv[1]).plan(); print('scipy.stats' in sys.modules)"
    study = STUDIES / "plenoptic_vs_stereo.yaml"
    done = subprocess.run([sys.executable, "-c", script, study], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
