"""Calibrations inferred from a target: what a normal approximation and chains cost, step by step."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from tradestudy.analysis.depth_draws import outcome_model, uncertain_sources
from tradestudy.calibration.posteriors import TargetToInfer, propagated, target_problem
from tradestudy.calibration.sources import CALIBRATION, group_of_draws
from tradestudy.calibration.target.target_inference import TargetProblem, fit_target, sample_target
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cost.depth import fixed_sampling
from tradestudy.cost.entries import CostTable, nothing_measured
from tradestudy.cost.measuring import MOST_PLACES, REFERENCE_SEED, Allowance, entry_of, measure
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.monte_carlo import propagate
from tradestudy.uncertainty.sources import Group
from tradestudy.uncertainty.streams import scrambled_sobol
from tradestudy.units import significant

LAPLACE, EMCEE = "normal approximation", "emcee"
_STEPS: Final = (200, 500, 1000)
_DRAWS: Final = 2**14
_REFERENCE_RUNS: Final = (2, 4)


def posterior_cost(
    asked: TargetToInfer,
    camera: DepthCamera,
    title: str,
    distance: FloatArray,
    allowance: Allowance,
    *,
    progress: Progress,
    inferring: float,
) -> CostTable:
    """Cost of the posterior of one camera that is shown a target, by the depth uncertainty that follows from it.

    Parameters
    ----------
    asked
        The target, and what was known before.
    camera
        With the calibration as a run infers it.
    title
        Of the camera, in words.
    distance
        Of the study [m].
    allowance
        Time and repeats.
    progress
        Called with the step and the share done.
    inferring
        Seconds that one posterior takes until converged, such as that of the camera took.
    """
    step = "cost: posterior"
    progress(step, 0.0)
    fewest, most = _REFERENCE_RUNS
    if not allowance.allows((fewest + 1) * inferring):
        progress(step, 1.0)
        why = (
            f"everything: no time left: a reference of {fewest} posteriors and one beside it take about "
            f"{significant((fewest + 1) * inferring, 2)} s, {significant(max(allowance.left, 0.0), 2)} s are left; a "
            "larger --budget measures them"
        )
        says = f"Half the central 68.27 % interval of depth of {title} by a calibration inferred from its target."
        return nothing_measured("posterior", f"Posterior of {title}", says, why)
    problem, most_steps = target_problem(asked)[0], asked.part.max_steps
    width = partial(_half_width, camera, asked.name, distance[:: -(-distance.size // MOST_PLACES)])
    begin = time.perf_counter()
    widths = [width(_by_emcee(problem, most_steps, (REFERENCE_SEED, run))) for run in range(fewest)]
    # A further one takes its share of what these took, and so does what is held against them.
    while len(widths) < most and allowance.allows(2.0 * (time.perf_counter() - begin)):
        widths.append(width(_by_emcee(problem, most_steps, (REFERENCE_SEED, len(widths)))))
    reference_seconds = time.perf_counter() - begin
    seen = np.all(np.isfinite(widths), axis=0)
    bounded = np.stack(widths)[:, seen]
    reference = bounded.mean(axis=0)
    error = bounded.std(axis=0, ddof=1) / math.sqrt(len(widths)) / reference
    runs: list[tuple[str, str, Callable[[int], Group], bool]] = [
        (LAPLACE, "", lambda _run: _by_fit(problem), False),
        # First what a run does, in case the time ends.
        (EMCEE, "until converged", lambda run: _by_emcee(problem, most_steps, (run,)), True),
        *(
            (EMCEE, f"{steps} steps", lambda run, steps=steps: _by_emcee(problem, steps, (run,)), False)
            for steps in _STEPS
        ),
    ]
    entries, left_out = [], []
    for number, (model, setting, draw, chosen) in enumerate(runs):
        progress(step, number / len(runs))
        predicted = reference_seconds / len(widths) if model == EMCEE else 0.0
        if not allowance.allows(predicted):
            left_out.append(f"{model}, {setting}: {allowance.lacking(predicted)}")
            continue
        timed = measure(lambda run, draw=draw: width(draw(run)), allowance)  # type: ignore[misc]  # bound at once
        off = np.sqrt(np.mean((np.stack(timed.values)[:, seen] / reference - 1.0) ** 2, axis=0))
        entries.append(
            entry_of(
                timed,
                model=model,
                setting=setting,
                evaluations=math.nan,
                error=float(off.max()),
                typical_error=float(np.median(off)),
                chosen=chosen,
            )
        )
    progress(step, 1.0)
    return CostTable(
        name="posterior",
        title=f"Posterior of {title}",
        says=f"Half the central 68.27 % interval of depth of {title} on the axis at {int(seen.sum())} distances "
        "by a calibration inferred from its target: seconds of fit, chains and propagation, relative error at the "
        "worst.",
        reference=f"mean of {len(widths)} posteriors by emcee, each until converged, of seeds of their own",
        reference_error=float(error.max()),
        reference_seconds=reference_seconds,
        entries=tuple(entries),
        left_out=tuple(left_out),
        ways={EMCEE: f"cameras.{asked.name}.calibration.target.max_steps, which stops what has not converged"},
    )


def _by_emcee(problem: TargetProblem, steps: int, seed: tuple[int, ...]) -> Group:
    rng = np.random.default_rng((*seed, REFERENCE_SEED))
    found = sample_target(problem, fit_target(problem), rng=rng, maximum_steps=steps)
    posterior = propagated(problem.priors.names, found.sample)
    return group_of_draws(CALIBRATION, posterior.names, posterior.draws)


def _by_fit(problem: TargetProblem) -> Group:
    fit = fit_target(problem)
    names = problem.priors.names
    columns = [fit.laplace.names.index(name) for name in names]
    return JointNormal(
        name=CALIBRATION,
        parameters=names,
        mean=np.zeros(len(names)),
        covariance=fit.laplace.covariance[np.ix_(columns, columns)],
        error_class=ErrorClass.RIG,
    )


def _half_width(camera: DepthCamera, name: str, places: FloatArray, posterior: Group) -> FloatArray:
    """Of depth at places [m], with another posterior in the place of the camera's own."""
    groups = tuple(posterior if group.name == CALIBRATION else group for group in camera.calibration.groups)
    changed = replace(camera, calibration=replace(camera.calibration, groups=groups))
    return propagate(
        outcome_model(changed, places),
        uncertain_sources(changed, "both"),
        fixed_sampling(scrambled_sobol, _DRAWS),
        seed=0,
        point=f"cost/{name}",
        inverse_depth=True,
    ).half_width
