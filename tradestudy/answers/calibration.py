"""Infer the calibrations that a study needs before it can predict depth."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from tradestudy.calibration.calibration_file import CalibrationDraws
from tradestudy.calibration.corners.real_rig import RigFit
from tradestudy.calibration.corners.trust import DISTANCES, CalibrationTrust, ComparedLens
from tradestudy.calibration.corners.view_blocks import TRANSLATION, cameras_of
from tradestudy.calibration.posteriors import InferredCalibration
from tradestudy.calibration.projection import intrinsic_names, lens_of_text, text_of_lens
from tradestudy.errors import NotConvergedError, OutOfRangeError, Problem, StudyError, TradestudyError
from tradestudy.execution import Steps
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.varying import Varying, calibrations_to_infer, point_labels, sweep_axes, sweep_points
from tradestudy.units import ANGLE, LENGTH, PIXELS, pretty, significant, with_deviation

if TYPE_CHECKING:
    from tradestudy.calibration.corners.rig_measurement import GeometryContradictionError


def infer_calibrations(
    study: PreparedStudy, steps: Steps
) -> tuple[PreparedStudy, Mapping[str, InferredCalibration], str]:
    """Infer every calibration from a target or corners, for the study, its readings and the designs of its sweep.

    Returns
    -------
    PreparedStudy
        The study, with the inferred calibrations of its cameras.
    mapping of str to InferredCalibration
        Calibrations of the study as declared, by camera.
    str
        The cameras of which other calibrations, for readings or designs, did not converge, with their number and the
        failed checks of the first; empty if all converged.

    Raises
    ------
    TradestudyError
        A calibration cannot be inferred, or contradicts the declared geometry.
    """
    requests = calibrations_to_infer(study)
    if not requests:
        return study, {}, ""
    from tradestudy.calibration.corners.rig_measurement import GeometryContradictionError
    from tradestudy.calibration.posteriors import infer

    names = [request.name for request in requests.values()]
    try:
        inferred = dict(zip(requests, steps.map("calibration", infer, list(requests.values()), names), strict=True))
    except (GeometryContradictionError, NotConvergedError, OutOfRangeError):
        refuse_calibrations(study, corners="all views")  # in the words of `plan`, with the place in the study
        raise
    posteriors = {key: result.calibration for key, result in inferred.items()}
    calibrated = replace(study, choices=replace(study.choices, posteriors=posteriors))
    declared = {key: camera_name for camera_name, key in study.definition.posterior_keys.items() if key in requests}
    others: dict[str, list[InferredCalibration]] = {}
    for key, result in inferred.items():
        if key not in declared:
            others.setdefault(study.file.cameras[requests[key].name].title, []).append(result)
    failed = [
        f"{title} under {len(failures)} of {len(calibrations)} other sets of values ({failures[0]})"
        for title, calibrations in others.items()
        if (failures := ["; ".join(calibration.failures) for calibration in calibrations if calibration.failures])
    ]
    return calibrated, {camera_name: inferred[key] for key, camera_name in declared.items()}, "\n".join(failed)


Corners = Literal["not fitted", "few views", "all views"]
"""How far a check of a study fits detected corners."""


def refuse_calibrations(study: PreparedStudy, *, corners: Corners) -> None:
    """Refuse targets and corners of a study, its readings, designs and inverse questions that a run would refuse.

    A fit to a few views of corners takes a second. All views take some seconds and show every contradiction.

    Raises
    ------
    StudyError
        A target is visible in too few views or does not determine the camera, no rig fits the corners, or they
        contradict the declared geometry.
    """
    requests = calibrations_to_infer(study)
    if not requests:
        return
    from tradestudy.calibration.camera_target import TargetToInfer, fit_target, target_problem
    from tradestudy.calibration.corners.rig_measurement import GeometryContradictionError
    from tradestudy.calibration.posteriors import check_corners

    declared = {key for form in (study, *study.readings.values()) for key in form.definition.posterior_keys.values()}
    problems = []
    for key, request in requests.items():
        try:
            if isinstance(request, TargetToInfer):
                fit_target(target_problem(request)[0])
            elif corners != "not fitted":
                check_corners(request, few=corners == "few views")
        except GeometryContradictionError as error:
            problems += _located(study, error)
        except TradestudyError as error:
            source = "target" if isinstance(request, TargetToInfer) else "corners"
            path = ("cameras", request.name, "calibration", source) if key in declared else ("sweep",)
            design = "" if key in declared else f"{_design_with(study, key)}: "
            problems.append(study.document.locate(path).problem(path, f"{design}{error}"))
    if problems := problems or list(_unseen_plans(study)):
        raise StudyError(problems)


def _design_with(study: PreparedStudy, key: str) -> str:
    """The first design of a sweep with a calibration, in words."""
    axes = sweep_axes(study)
    designs = zip(point_labels(axes), sweep_points(study, axes), strict=True)
    return next(label for label, design in designs if key in design.definition.posterior_keys.values())


def _unseen_plans(study: PreparedStudy) -> Iterator[Problem]:
    """Ends of inverse questions at which too few views of a planned calibration show the target."""
    from tradestudy.answers.solutions import PLANS, varied_calibrations
    from tradestudy.calibration.camera_target import TargetToInfer, planned_problem

    for name, question in study.file.solve.items():
        varying = Varying.of(study, question)
        varied = varied_calibrations(study, varying)
        for end, value in (("low", varying.low), ("high", varying.high)):
            path, changed = ("solve", name, end), study.with_values(varying.changes(value))
            for request in changed.definition.calibrations_to_infer().values() if varied else ():
                if (
                    not isinstance(request, TargetToInfer)
                    or study.definition.posterior_keys[request.name] not in varied
                ):
                    continue
                try:
                    # Verdicts on requirements use only the first plan; the others give the scatter of a solution.
                    for plan in PLANS if question.requirement is None else PLANS[:1]:
                        planned_problem(request, plan)
                except TradestudyError as error:
                    yield study.document.locate(path).problem(path, str(error))


def _located(study: PreparedStudy, error: GeometryContradictionError) -> list[Problem]:
    """Every contradiction between corners and geometry, located at the calibration key of its camera."""
    problems = []
    for line in str(error).splitlines():
        camera_name = next(camera_name for camera_name in study.file.cameras if f"cameras.{camera_name}." in line)
        path = ("cameras", camera_name, "calibration", "corners")
        problems.append(study.document.locate(path).problem(path, line))
    return problems


def rig_rows(inferred: Mapping[str, InferredCalibration]) -> dict[str, list[str]]:
    """Camera, quantity and value for the cameras calibrated from corners; empty if there are none."""
    rows = [
        (camera_name, *row)
        for camera_name, calibration in inferred.items()
        if calibration.fit is not None and calibration.trust is not None
        for row in (*_rows(calibration.fit), *_trust_rows(calibration.fit, calibration.trust))
    ]
    if not rows:
        return {}
    cameras, quantities, values = (list(column) for column in zip(*rows, strict=True))
    return {"rig_camera": cameras, "rig_quantity": quantities, "rig_value": values}


def rig_trust(inferred: Mapping[str, InferredCalibration]) -> dict[str, FloatArray]:
    """Cross-checks by halves of the views, and residual maps; NaN for cameras without corners, empty if all are."""
    trusts = {name: calibration.trust for name, calibration in inferred.items() if calibration.trust is not None}
    if not trusts:
        return {}

    def of_each(get: Callable[[CalibrationTrust], FloatArray]) -> FloatArray:
        nothing = np.full_like(get(next(iter(trusts.values()))), np.nan)
        return np.stack([get(trusts[name]) if name in trusts else nothing for name in inferred])

    return {
        "rig_claimed": of_each(lambda trust: trust.claimed),
        "rig_halves_difference": of_each(lambda trust: trust.halves_difference),
        "rig_halves_claim": of_each(lambda trust: trust.halves_claim),
        "rig_residual": of_each(lambda trust: trust.residual_map),
    }


def rig_lenses(inferred: Mapping[str, InferredCalibration]) -> tuple[dict[str, FloatArray], list[str]]:
    """Changes that other lens models would make, over calibrations and lens models; NaN where none was compared."""
    compared = [calibration.trust.lenses if calibration.trust is not None else {} for calibration in inferred.values()]
    names = list(dict.fromkeys(lens for lenses in compared for lens in lenses))
    if not names:
        return {}, []

    def of_each(get: Callable[[ComparedLens], FloatArray | float]) -> FloatArray:
        nothing = np.full_like(get(next(lenses[names[0]] for lenses in compared if names[0] in lenses)), np.nan)
        return np.array([[get(lenses[lens]) if lens in lenses else nothing for lens in names] for lenses in compared])

    return {
        "rig_lens_support": of_each(lambda lens: lens.support),
        "rig_lens_support_deviation": of_each(lambda lens: lens.support_deviation),
        "rig_lens_change": of_each(lambda lens: lens.depth_change),
        "rig_lens_change_deviation": of_each(lambda lens: lens.depth_change_deviation),
    }, names


def _rows(fit: RigFit) -> Iterator[tuple[str, str]]:
    yield "views and corners", f"{len(fit.corners.views)} views, {fit.corners.corner_count} corners"
    for side, camera in (("left", fit.left), ("right", fit.right)):
        yield f"residual of the {side} camera alone", pretty(camera.corner_rms_px, PIXELS)
        for k, parameter in enumerate(intrinsic_names(fit.corners.lens.free)):
            deviation = float(np.sqrt(camera.covariance[k, k]))
            unit = " px" if parameter.endswith("_px") else ""
            words = parameter.removesuffix("_px").replace("_", " ")
            yield f"{side} {words}", f"{with_deviation(float(camera.intrinsics[k]), deviation)}{unit}"
    lens, cameras = fit.corners.lens, cameras_of(fit.explained.shared)
    for side, values in zip(("left", "right"), cameras, strict=True):
        yield (
            f"field angle up to which the {side} lens model is valid",
            pretty(float(lens.at(values[4:]).valid_field), ANGLE),
        )
    yield "residual of the pair with one relative pose", pretty(fit.pair.corner_rms_px, PIXELS)
    yield "correlation of the views' mean residuals, left with right", f"{fit.means.correlation:.4f}".replace("-", "−")
    yield "motion of the board that explains this correlation", pretty(fit.explained.motion_scale, LENGTH)
    yield (
        "residual with this motion, left and right",
        f"{pretty(fit.explained.left_rms_px, PIXELS)}, {pretty(fit.explained.right_rms_px, PIXELS)}",
    )
    yield "noise of one corner coordinate, root mean square over views", pretty(fit.explained.noise_px, PIXELS)
    yield "gain in log likelihood from this motion", significant(fit.explained.log_likelihood_gain)
    shared, covariance = fit.explained.shared, fit.covariance
    # To first order, only errors of the translation along the baseline change its length.
    baseline = float(np.linalg.norm(shared[TRANSLATION]))
    direction = shared[TRANSLATION] / baseline
    deviation = float(np.sqrt(direction @ covariance[TRANSLATION, TRANSLATION] @ direction))
    yield "baseline", f"{with_deviation(1e3 * baseline, 1e3 * deviation)} mm"
    for angle, k in (("pitch", -6), ("yaw", -5), ("roll", -4)):
        spread = float(np.sqrt(covariance[k, k]))
        yield f"relative {angle}", f"{with_deviation(float(np.degrees(shared[k])), float(np.degrees(spread)))}°"


def _trust_rows(fit: RigFit, trust: CalibrationTrust) -> Iterator[tuple[str, str]]:
    for z, good, claimed in zip(trust.distances, trust.good_to, trust.claimed, strict=True):
        where, to, says = (pretty(float(length), LENGTH, digits=3) for length in (z, good, claimed))
        yield f"accuracy of this calibration at {where}", f"{to} (claimed: {says})"
    for lens_name, other in trust.lenses.items():
        if other.failure:
            yield f"lens model {lens_name}", f"cannot be fitted: {other.failure}"
    yield (
        f"difference between random halves of the views, divided by the claimed difference ({trust.halves} splits)",
        ", ".join(
            f"{ratio:.2f} at {pretty(float(z), LENGTH)}" for z, ratio in zip(trust.distances, trust.ratio, strict=True)
        ),
    )
    rms = trust.view_rms
    yield "smallest and largest residual of a view", f"{pretty(rms.min(), PIXELS)}, {pretty(rms.max(), PIXELS)}"
    along = trust.neighbour_correlation.mean(axis=0)
    yield "correlation of neighbouring residuals, along rows and columns", f"{along[0]:.2f}, {along[1]:.2f}"
    noise = fit.corners.noise
    assert noise is not None
    yield (
        "share of the noise variance that neighbours have in common, and its correlation length",
        f"{100.0 * noise.share:.0f} %, {pretty(noise.length, LENGTH)}",
    )
    yield "ratio of the largest to the smallest noise of a view", f"{noise.deviation.max() / noise.deviation.min():.2g}"
    yield from _outlier_rows(fit)
    names = ("bowl", "saddle along the edges", "saddle along the diagonals")
    for shape, value, deviation in zip(names, fit.warp, fit.warp_deviation, strict=True):
        yield f"warp of the board, {shape}", f"{with_deviation(1e6 * float(value), 1e6 * float(deviation))} µm"


def _outlier_rows(fit: RigFit) -> Iterator[tuple[str, str]]:
    """Corners excluded as outliers, and the number of corners with reduced weight."""
    present = fit.present
    low = (fit.weights < 1.0) & present[:, None]
    yield (
        "corners with a weight below 1, in the left and right pictures together",
        f"{int(low.sum())} of {2 * int(present.sum())}",
    )
    for view, side, corner in zip(*np.nonzero((fit.weights == 0.0) & present[:, None]), strict=True):
        yield f"excluded outlier: view {fit.corners.views[view]}, {('left', 'right')[side]}", f"corner {corner + 1}"


_SHOWN_STEPS = 300


def calibration_group(inferred: Mapping[str, InferredCalibration]) -> xr.Dataset:
    """/calibration: the posterior of every camera with an inferred calibration, and the results of the fits."""
    posterior, names = _posteriors(inferred.values())
    lenses, lens_names = rig_lenses(inferred)
    values = posterior | rig_rows(inferred) | rig_trust(inferred) | lenses
    distances: dict[str, Any] = {"rig_distance": list(DISTANCES)} if "rig_claimed" in values else {}
    models = {"lens_model": lens_names} if lenses else {}
    return dataset("calibration", values, {"posterior": list(inferred), "parameter": names, **distances, **models})


def _posteriors(calibrations: Collection[InferredCalibration]) -> tuple[dict[str, Any], list[str]]:
    """Variables of the inferred calibrations, padded with NaN over all parameters."""
    names = list(dict.fromkeys(parameter for inferred in calibrations for parameter in inferred.sample.names))
    most = max(len(inferred.posterior.draws) for inferred in calibrations)
    ensembles = max(inferred.sample.chains.shape[0] for inferred in calibrations)

    def over_parameters(get: Any) -> FloatArray:
        return np.stack([_spread(inferred, names, np.asarray(get(inferred))) for inferred in calibrations])

    def of_each(get: Any) -> list[Any]:
        return [get(inferred) for inferred in calibrations]

    # The last five sampled parameters (warp of the board, noise, motion) are not among those of the linear fit.
    overconfidence = [
        np.full(len(inferred.sample.names), np.nan)
        if inferred.fit is None
        else np.concatenate([inferred.fit.explained.overconfidence, np.full(5, np.nan)])
        for inferred in calibrations
    ]
    return {
        "posterior_converged": of_each(lambda inferred: not inferred.failures),
        "posterior_verdict": of_each(lambda inferred: "; ".join(inferred.failures)),
        "posterior_kind": of_each(
            lambda inferred: "simulated target" if inferred.fit is None else "corners of a board"
        ),
        "posterior_lengths": of_each(lambda inferred: inferred.sample.diagnostics.lengths),
        "posterior_acceptance": np.stack(
            of_each(
                lambda inferred: np.pad(
                    inferred.sample.diagnostics.acceptance,
                    (0, ensembles - len(inferred.sample.diagnostics.acceptance)),
                    constant_values=np.nan,
                )
            )
        ),
        "posterior_marginal_efficiency": of_each(lambda inferred: inferred.check.efficiency),
        "posterior_evaluations": of_each(lambda inferred: inferred.sample.evaluations),
        "posterior_seconds": of_each(lambda inferred: inferred.sample.seconds),
        "laplace_seconds": of_each(lambda inferred: inferred.laplace_seconds),
        "posterior_mean": over_parameters(lambda inferred: inferred.sample.draws.mean(axis=0)),
        "posterior_mean_error": over_parameters(
            lambda inferred: (
                inferred.sample.draws.std(axis=0) / np.sqrt(inferred.sample.diagnostics.bulk_effective_size)
            )
        ),
        "posterior_deviation": over_parameters(lambda inferred: inferred.sample.draws.std(axis=0)),
        "prior_deviation": over_parameters(lambda inferred: inferred.prior_deviation),
        "laplace_deviation": over_parameters(lambda inferred: inferred.laplace_deviation),
        "posterior_autocorrelation": over_parameters(
            lambda inferred: inferred.sample.diagnostics.autocorrelation_steps
        ),
        "posterior_r_hat": over_parameters(lambda inferred: inferred.sample.diagnostics.r_hat),
        "posterior_bulk_size": over_parameters(lambda inferred: inferred.sample.diagnostics.bulk_effective_size),
        "posterior_tail_size": over_parameters(lambda inferred: inferred.sample.diagnostics.tail_effective_size),
        "posterior_best": over_parameters(_best),
        "posterior_lens_model": of_each(lambda inferred: text_of_lens(inferred.posterior.lens)),
        "posterior_pixels": of_each(lambda inferred: inferred.posterior.pixels or (0, 0)),
        "posterior_draw": over_parameters(lambda inferred: _draws(inferred, most)),
        "posterior_trace": over_parameters(lambda inferred: _trace(inferred, ensembles)),
        "rig_overconfidence": np.stack(
            [_spread(inferred, names, row) for inferred, row in zip(calibrations, overconfidence, strict=True)]
        ),
    }, names


def _draws(inferred: InferredCalibration, most: int) -> FloatArray:
    """The propagated draws, over the parameters of the sample; NaN for parameters without draws."""
    draws = np.full((most, len(inferred.sample.names)), np.nan)
    columns = [inferred.sample.names.index(parameter) for parameter in inferred.posterior.names]
    draws[: len(inferred.posterior.draws), columns] = inferred.posterior.draws
    return draws


def _best(inferred: InferredCalibration) -> FloatArray:
    """The best fit of a rig calibrated from corners, over the parameters of the sample; NaN for others."""
    values = np.full(len(inferred.sample.names), np.nan)
    if inferred.posterior.best is not None:
        values[[inferred.sample.names.index(parameter) for parameter in inferred.posterior.names]] = (
            inferred.posterior.best
        )
    return values


def _trace(inferred: InferredCalibration, ensembles: int) -> FloatArray:
    """The first walker of each ensemble at evenly spaced steps, shape (ensembles, steps, parameters)."""
    chains = inferred.sample.chains[:, :, 0]
    steps = (np.arange(_SHOWN_STEPS) * chains.shape[1]) // _SHOWN_STEPS
    padded = np.full((ensembles, _SHOWN_STEPS, chains.shape[-1]), np.nan)
    padded[: len(chains)] = chains[:, steps]
    return padded


def _spread(inferred: InferredCalibration, names: list[str], values: FloatArray) -> FloatArray:
    """Place values over a calibration's own parameters (last axis) among the parameters of all calibrations."""
    placed = np.full((*values.shape[:-1], len(names)), np.nan)
    placed[..., [names.index(parameter) for parameter in inferred.sample.names]] = values
    return placed


def saved_posteriors(tree: xr.DataTree) -> dict[str, CalibrationDraws]:
    """The posteriors of a run, by camera, as written beside its results."""
    if "calibration" not in tree.children:
        return {}
    group, posteriors = tree["calibration"].to_dataset(), {}
    for camera_name in group["posterior"].values:
        entry = group.sel(posterior=camera_name)
        of_rig = bool(np.isfinite(entry["posterior_best"].values).any())
        # The group pads every posterior with NaN to the parameters and draws of all; only its own are wanted.
        drawn = entry["parameter"].values[np.isfinite(entry["posterior_draw"].values).any(axis=0)]
        posterior = entry.sel(parameter=drawn)
        draws = posterior["posterior_draw"].values
        draws = draws[np.isfinite(draws).all(axis=1)]
        columns, rows = (int(count) for count in posterior["posterior_pixels"].values)
        posteriors[str(camera_name)] = CalibrationDraws(
            names=tuple(map(str, posterior["parameter"].values)),
            draws=draws,
            reference=None if of_rig else draws.mean(axis=0),
            best=posterior["posterior_best"].values if of_rig else None,
            pixels=(columns, rows) if of_rig else None,
            lens=lens_of_text(str(entry["posterior_lens_model"].item())),
        )
    return posteriors
