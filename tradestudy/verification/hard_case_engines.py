"""What the hard cases are asked of that lives above them: the propagation engine and the reader of study files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from tradestudy.errors import StudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.loading import load_definition
from tradestudy.uncertainty.distributions import Empirical, Normal
from tradestudy.uncertainty.evaluation import CAUSES, Model, Outcome
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.linear import linear
from tradestudy.uncertainty.monte_carlo import Sampling, propagate
from tradestudy.uncertainty.outputs import Propagated
from tradestudy.uncertainty.sensitivity import sobol_indices
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources
from tradestudy.verification.hard_cases.propagation import PropagationEngine

# A few thousand draws show what breaks; the cases bound themselves by the error that goes with that.
_SAMPLING = Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=2**15, first_draws=2**12)
_SOBOL_DRAWS = 2**9

Response = Callable[[Mapping[str, FloatArray]], FloatArray]


def propagation_engine() -> PropagationEngine:
    """The engine of `tradestudy.uncertainty`, as the hard cases ask it."""
    return PropagationEngine(
        propagate=_propagate,
        linear=_linear,
        linear_of_one=_linear_of_one,
        sobol=_sobol,
        from_draws=_from_draws,
        judge_chains=_judge_chains,
    )


def check_file(path: Path) -> str:
    """What `check` makes of a study file: a count of what it holds, or its first mistakes."""
    try:
        definition = load_definition(path)
    except StudyError as error:
        return f"refused: {'; '.join(problem.what for problem in error.problems[:2])}"
    case = definition.case
    return f"accepted: {len(case.all_cameras)} cameras, {len(case.distance)} distances"


def load_plainly(text: str) -> object:
    """What a YAML parser by itself makes of a text."""
    from ruamel.yaml import YAML

    return YAML(typ="safe", pure=True).load(text)


def _model(response: Response) -> Model:
    return lambda values: Outcome(values=np.asarray(response(values)))


def _joint(names: tuple[str, ...], means: FloatArray, covariance: FloatArray) -> Sources:
    group = JointNormal(
        name="inputs", parameters=names, mean=means, covariance=covariance, error_class=ErrorClass.MEASUREMENT
    )
    return Sources(groups=(group,))


def _propagate(
    response: Response, names: tuple[str, ...], means: FloatArray, covariance: FloatArray, *, inverse_depth: bool
) -> tuple[Propagated, str]:
    found = propagate(
        _model(response),
        _joint(names, means, covariance),
        _SAMPLING,
        seed=0,
        point="hard case",
        inverse_depth=inverse_depth,
    )
    failures = ", ".join(
        f"{cause} {100.0 * share:g} %" for cause, share in zip(CAUSES, found.failed_fraction[:, 0], strict=True)
    )
    return found, f"{found.status[0]}; {failures}"


def _linear(response: Response, names: tuple[str, ...], means: FloatArray, covariance: FloatArray) -> float:
    found = linear(_model(response), _joint(names, means, covariance), inverse_depth=False)
    return float(found.standard_uncertainty[0])


def _linear_of_one(deviation: float) -> float:
    sources = Sources(groups=(_normal("x", deviation),))
    found = linear(_model(lambda values: values["x"]), sources, inverse_depth=False)
    return float(found.standard_uncertainty[0])


def _normal(name: str, deviation: float) -> Source:
    distribution = Normal(mean=0.0, standard_deviation=deviation)
    return Source(name=name, distribution=distribution, error_class=ErrorClass.MEASUREMENT)


def _sobol(response: Response, names: tuple[str, ...], deviations: FloatArray) -> tuple[FloatArray, str]:
    groups = tuple(_normal(name, float(deviation)) for name, deviation in zip(names, deviations, strict=True))
    found = sobol_indices(
        _model(response), Sources(groups=groups), _SAMPLING, draws=_SOBOL_DRAWS, seed=0, point="hard case"
    )
    return found.first[:, 0], found.refused[0]


def _from_draws(draws: FloatArray) -> object:
    return Empirical(draws=draws)


def _judge_chains(chains: FloatArray) -> tuple[tuple[str, ...], tuple[int, ...]]:
    from tradestudy.calibration.posterior.sampling import diagnose

    acceptance = np.full(chains.shape[0], 0.3)
    found = diagnose(chains, acceptance, tuple(f"p{index}" for index in range(chains.shape[-1])))
    return found.failures, found.stuck_ensembles
