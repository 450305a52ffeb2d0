import subprocess
import sys
import threading

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty import streams
from tradestudy.uncertainty.streams import BATCH_DRAWS, each_scramble, point_generator, scramble_scores, scrambled_sobol


def test_scores_are_those_of_one_scrambled_sequence():
    uniform = scrambled_sobol(3, point_generator(seed=4, point="common", replicate=2))(4 * BATCH_DRAWS)
    found = scramble_scores(3, 4 * BATCH_DRAWS, seed=4, point="common", scramble=2)
    np.testing.assert_array_equal(found, ndtri(uniform))
    # Every cell of the unit interval has its point: no plain random numbers would do that.
    counts = np.histogram(ndtr(found[1]), bins=1024, range=(0.0, 1.0))[0]
    np.testing.assert_array_equal(counts, 4 * BATCH_DRAWS // 1024)


def test_fewer_draws_are_the_first_of_more_and_scrambles_differ():
    few = scramble_scores(2, 64, seed=0, point="a", scramble=0)
    np.testing.assert_array_equal(few, scramble_scores(2, 256, seed=0, point="a", scramble=0)[:, :64])
    for other in ({"scramble": 1}, {"seed": 1}, {"point": "b"}):
        given = {"seed": 0, "point": "a", "scramble": 0} | other
        assert np.all(scramble_scores(2, 64, **given) != few)
    assert scramble_scores(0, 64, seed=0, point="a", scramble=0).shape == (0, 64)


@pytest.mark.parametrize("seed", [2**63, 2**64 - 1, 2**64, 10**40])
def test_seeds_have_no_upper_bound(seed):
    found = scramble_scores(2, 64, seed=seed, point="a", scramble=0)
    assert np.all(np.isfinite(found))
    assert np.all(found != scramble_scores(2, 64, seed=seed - 1, point="a", scramble=0))


def test_cached_scores_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        scramble_scores(2, 64, seed=0, point="a", scramble=0)[0, 0] = 0.0


def test_a_negative_scramble_is_refused():
    with pytest.raises(OutOfRangeError, match=">= 0"):
        scramble_scores(2, 64, seed=0, point="a", scramble=-1)


def test_threads_change_nothing_and_results_come_in_order():
    threads = set()

    def task(scramble):
        threads.add(threading.get_ident())
        return scramble, np.sum(scramble_scores(3, 4096, seed=7, point="threads", scramble=scramble), axis=1)

    found = each_scramble(task, 8)
    streams._few.cache_clear()
    assert [number for number, _ in found] == list(range(8))
    for number, total in found:
        np.testing.assert_array_equal(total, task(number)[1])


def test_declaring_errors_needs_no_scipy():
    program = """
import sys
import numpy as np
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.sources import ErrorClass
from tradestudy.uncertainty.evaluation import Model
from tradestudy.uncertainty.joint import GaussianCopula, JointNormal
from tradestudy.uncertainty.sources import Source, Sources
rig, names = ErrorClass.RIG, ("a", "b")
normal, uniform = Normal(mean=0.0, standard_deviation=1.0), Uniform(low=-1.0, high=1.0)
tied = np.array([[1.0, 0.5], [0.5, 1.0]])
Sources(
    groups=(
        Source(name="c", distribution=uniform, error_class=rig),
        Source(name="d", distribution=normal, error_class=rig).under("left_"),
        GaussianCopula(name="t", parameters=names, marginals=(normal, uniform), correlation=tied, error_class=rig),
        JointNormal(name="j", parameters=("e", "f"), mean=np.zeros(2), covariance=tied, error_class=rig),
    )
).nominal()
assert not any(name.split(".")[0] == "scipy" for name in sys.modules)
"""
    subprocess.run([sys.executable, "-c", program], check=True)
