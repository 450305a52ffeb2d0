"""Depth uncertainty of calibrated cameras: what propagation costs, and inferring a calibration, step by step."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from tradestudy.analysis.propagation import sampling_of
from tradestudy.calibration.declaration import CalibrationStudyPart, TargetPart
from tradestudy.calibration.posteriors import group_of_sample, target_problem
from tradestudy.calibration.sources import declared_groups
from tradestudy.calibration.target.target_inference import TargetProblem, fit_target, sample_target
from tradestudy.calibration.uncertain_cameras import UncertainCamera, UncertainCameras
from tradestudy.cameras.exact_model import ExactModel
from tradestudy.cost.depth import fixed_sampling, propagation_cost
from tradestudy.cost.depth_reference import DepthCase
from tradestudy.cost.entries import SOBOL, CostTable, nothing_measured
from tradestudy.cost.measuring import MOST_PLACES, REFERENCE_SEED, Allowance, entry_of, measure
from tradestudy.execution.steps import Progress
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import StudyDefinition
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.evaluation import depth_from_inverse
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.linear import linear
from tradestudy.uncertainty.monte_carlo import propagate
from tradestudy.uncertainty.sources import Group
from tradestudy.uncertainty.streams import scrambled_sobol
from tradestudy.units import significant

LAPLACE, EMCEE = "normal approximation", "emcee"
_STEPS: Final = (200, 500, 1000)
_DRAWS: Final = 2**14
_REFERENCE_RUNS: Final = (2, 4)
_GROUP: Final = "calibration"
_UNBOUNDED: Final = (
    "its errors have no covariance, or it sees no distance of the calibration with infinity three deviations away"
)


def calibration_cost(
    part: CalibrationStudyPart,
    uncertain: UncertainCameras,
    titles: Mapping[str, str],
    allowance: Allowance,
    progress: Progress,
) -> CostTable:
    """Cost of the depth uncertainty of every camera of the calibration part, on the axis, noise and calibration.

    Cameras whose interval of depth is bounded at none of its distances are left out and named.
    """
    places = np.array(part.distance_values())
    wanted = places[np.unique(np.linspace(0, places.size - 1, min(MOST_PLACES, places.size)).astype(int))]
    found = {name: _case(camera, titles[name], wanted) for name, camera in uncertain.cameras.items()}
    cases = [case for case in found.values() if case is not None]
    name, title = "calibrated_depth_uncertainty", "Depth uncertainty with all calibration errors"
    says = (
        f"Half the central 68.27 % interval of depth of {len(cases)} cameras on the axis at up to {MOST_PLACES} "
        "distances each where infinity is three deviations away, through the exact models: seconds for all of them "
        "together, relative error at the worst."
    )
    if not cases:
        return nothing_measured(name, title, says, f"everything: of each camera, {_UNBOUNDED}")
    rule = sampling_of(part.accuracy, part.budget, wanted.size)
    measured = propagation_cost(
        cases,
        allowance,
        progress,
        name=name,
        title=title,
        says=says,
        chosen=SOBOL,
        asked=part.accuracy,
        more=((SOBOL, f"until {100.0 * part.accuracy:g} %", rule),),
    )
    unbounded = tuple(f"{titles[one]}: {_UNBOUNDED}" for one, case in found.items() if case is None)
    ways = {SOBOL: "calibration.accuracy, which says how many draws, and calibration.budget, which bounds them"}
    return replace(measured, left_out=(*unbounded, *measured.left_out), ways=ways)


def _case(camera: UncertainCamera, title: str, places: FloatArray) -> DepthCase | None:
    """The camera where its interval is bounded: a line in inverse depth, three deviations to infinity, tells."""
    if camera.sources.covariance() is None:
        return None
    line = linear(camera.model(places, 0.0), camera.sources, inverse_depth=True)
    assert line.inverse_estimate is not None  # it was asked for
    assert line.inverse_uncertainty is not None
    with np.errstate(invalid="ignore"):  # where the camera does not see, everything is NaN and left out
        bounded = line.inverse_estimate > 3.0 * line.inverse_uncertainty
    seen = places[bounded & np.isfinite(depth_from_inverse(line.inverse_estimate))]
    if seen.size == 0 or not math.isfinite(float(seen[0])):
        return None
    return DepthCase(
        name=camera.name,
        title=title,
        model=camera.model(seen, 0.0),
        sources=camera.sources,
        distance=seen,
        closed_form=None,
    )


def posterior_cost(
    definition: StudyDefinition,
    part: CalibrationStudyPart,
    camera: UncertainCamera,
    allowance: Allowance,
    progress: Progress,
    *,
    inferring: float,
) -> CostTable:
    """Cost of the posterior of one camera that is shown a target, by the depth uncertainty that follows from it.

    Parameters
    ----------
    definition, part
        The study.
    camera
        With the posterior as a run infers it.
    allowance
        Time and repeats.
    progress
        Called with the step and the share done.
    inferring
        Seconds that one posterior takes until converged, such as that of the camera took.
    """
    step = "cost: posterior"
    progress(step, 0.0)
    target = part.cameras[camera.name].target
    assert target is not None  # the caller's promise
    words = definition.file.cameras[camera.name].title
    title = f"Posterior of {words}"
    fewest, most = _REFERENCE_RUNS
    if not allowance.allows((fewest + 1) * inferring):
        progress(step, 1.0)
        why = (
            f"everything: no time left: a reference of {fewest} posteriors and one beside it take about "
            f"{significant((fewest + 1) * inferring, 2)} s, {significant(max(allowance.left, 0.0), 2)} s are left; a "
            "larger --budget measures them"
        )
        says = f"Half the central 68.27 % interval of depth of {words} by a calibration inferred from its target."
        return nothing_measured("posterior", title, says, why)
    problem = _problem(definition, part, camera.name, target)
    places = np.array(part.distance_values())
    width = partial(_half_width, camera, places[:: -(-places.size // MOST_PLACES)])
    begin = time.perf_counter()
    widths = [width(_by_emcee(problem, target.maximum_steps, (REFERENCE_SEED, run))) for run in range(fewest)]
    # A further one takes its share of what these took, and so does what is held against them.
    while len(widths) < most and allowance.allows(2.0 * (time.perf_counter() - begin)):
        widths.append(width(_by_emcee(problem, target.maximum_steps, (REFERENCE_SEED, len(widths)))))
    reference_seconds = time.perf_counter() - begin
    seen = np.all(np.isfinite(widths), axis=0)
    bounded = np.stack(widths)[:, seen]
    reference = bounded.mean(axis=0)
    error = bounded.std(axis=0, ddof=1) / math.sqrt(len(widths)) / reference
    runs: list[tuple[str, str, Callable[[int], Group], bool]] = [
        (LAPLACE, "", lambda _run: _by_fit(problem), False),
        # First what a run does, in case the time ends.
        (EMCEE, "until converged", lambda run: _by_emcee(problem, target.maximum_steps, (run,)), True),
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
        title=title,
        says=f"Half the central 68.27 % interval of depth of {words} on the axis at {int(seen.sum())} distances "
        "by a calibration inferred from its target: seconds of fit, chains and propagation, relative error at the "
        "worst.",
        reference=f"mean of {len(widths)} posteriors by emcee, each until converged, of seeds of their own",
        reference_error=float(error.max()),
        reference_seconds=reference_seconds,
        entries=tuple(entries),
        left_out=tuple(left_out),
        ways={EMCEE: f"calibration.cameras.{camera.name}.target.maximum_steps, which stops what has not converged"},
    )


def _problem(definition: StudyDefinition, part: CalibrationStudyPart, name: str, target: TargetPart) -> TargetProblem:
    """The same observations as those of a run."""
    camera = definition.case.cameras[name]
    assert isinstance(camera, ExactModel)  # the schema lets no other kind in
    folder = definition.folder_of(("calibration", "cameras", name))
    groups = declared_groups(camera, part.cameras[name], folder)
    return target_problem(name, camera, groups, target, seed=part.seed)[0]


def _by_emcee(problem: TargetProblem, steps: int, seed: tuple[int, ...]) -> Group:
    rng = np.random.default_rng((*seed, REFERENCE_SEED))
    posterior = sample_target(problem, fit_target(problem), rng=rng, maximum_steps=steps)
    return group_of_sample(problem.priors.names, posterior.sample)


def _by_fit(problem: TargetProblem) -> Group:
    fit = fit_target(problem)
    names = problem.priors.names
    columns = [fit.laplace.names.index(name) for name in names]
    return JointNormal(
        name=_GROUP,
        parameters=names,
        mean=np.zeros(len(names)),
        covariance=fit.laplace.covariance[np.ix_(columns, columns)],
        error_class=ErrorClass.RIG,
    )


def _half_width(camera: UncertainCamera, places: FloatArray, calibration: Group) -> FloatArray:
    """Of depth at places [m], with another calibration in the place of the camera's own."""
    groups = tuple(calibration if group.name == _GROUP else group for group in camera.groups)
    changed = replace(camera, groups=groups)
    return propagate(
        changed.model(places, 0.0),
        changed.sources,
        fixed_sampling(scrambled_sobol, _DRAWS),
        seed=0,
        point=f"cost/{camera.name}",
        inverse_depth=True,
    ).half_width
