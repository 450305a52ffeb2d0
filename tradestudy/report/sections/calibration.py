"""Calibration: what it rests on, how far averaging helps, which camera has the smaller error, and posteriors."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import (
    Block,
    Callout,
    Column,
    Heading,
    Paragraph,
    Table,
    Text,
    pictures_of,
    say,
    with_subscripts,
)
from tradestudy.report.words import or_dash, parameter_dimension, share
from tradestudy.results.views.depth import table_depth, table_distances
from tradestudy.results.views.groups import camera_titles, group, has, titles_in
from tradestudy.units import FRACTION, Dimension, pretty, significant, with_deviation
from tradestudy.wording import distance, in_words, lens_in_words

_CLEARLY = 2.0  # standard errors
_NAMES: Final[Mapping[str, str]] = {
    "board_bowl": "warp of the board, bowl",
    "board_edge_saddle": "warp of the board, saddle along the edges",
    "board_diagonal_saddle": "warp of the board, saddle along the diagonals",
    "log_noise_px": "logarithm of the noise in px",
    "relative_rotation_x": "relative pitch (rotation about x)",
    "relative_rotation_y": "relative yaw (rotation about y)",
    "relative_rotation_z": "relative roll (rotation about z)",
    "motion_scale": "standard deviation of the board's motion",
}


def describe_posteriors(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the fitted calibrations; nothing for a study without any."""
    if not has(tree, "calibration", "posterior_mean"):
        return
    data, titles = group(tree, "calibration"), camera_titles(tree)
    yield Heading(text="Fitted calibrations", anchor="posterior", level=2)
    yield Paragraph(
        say(
            "The parameters are fitted to pictures of a board, and the pose of the board in each view is marginalised; "
            "{priors}. The sampler emcee runs four independent ensembles; a result counts as converged if it meets "
            "every limit below. The spread of the draws about their mean is propagated to depth.",
            priors=_priors(data),
        )
    )
    for camera in data["posterior"].values:
        if not bool(data["posterior_converged"].sel(posterior=camera)):
            yield Callout(
                title=say("{title} did not converge", title=titles[str(camera)]),
                blocks=(Paragraph(str(data["posterior_verdict"].sel(posterior=camera).item())),),
                tone="warning",
            )
    yield _chains(data, titles)
    for camera in map(str, data["posterior"].values):
        yield _parameters(data.sel(posterior=camera), camera, titles[camera])
        yield from pictures_of(drawings, f"corner-{camera}", f"trace-{camera}", f"trust-{camera}")
    if "rig_value" in data:
        yield _rig(data, titles)
    if "rig_lens_support" in data:
        yield from _lenses(data, titles)


def _priors(data: xr.Dataset) -> str:
    flat = np.isinf(data["prior_deviation"].values).any(axis=-1)  # by posterior
    if flat.all():
        return "the priors are flat"
    return "the declared errors are the priors" + (", but fits to corner files have flat priors" if flat.any() else "")


def _chains(data: xr.Dataset, titles: Mapping[str, str]) -> Table:
    rows: list[tuple[Text, ...]] = []
    for camera in map(str, data["posterior"].values):
        posterior = data.sel(posterior=camera)
        acceptance = posterior["posterior_acceptance"].values
        laplace = or_dash(float(posterior["laplace_seconds"]), lambda seconds: significant(seconds, 2))
        rows.append(
            (
                titles[camera],
                "yes" if bool(posterior["posterior_converged"]) else "no",
                significant(float(posterior["posterior_lengths"])),
                f"{np.nanmax(posterior['posterior_r_hat'].values):.4f}",
                f"{np.nanmin(posterior['posterior_bulk_size'].values):.0f}",
                f"{np.nanmin(posterior['posterior_tail_size'].values):.0f}",
                f"{np.nanmin(acceptance):.2f} – {np.nanmax(acceptance):.2f}",
                f"{float(posterior['posterior_marginal_efficiency']):.3f}",
                f"{significant(float(posterior['posterior_seconds']), 2)} / {laplace}",
            )
        )
    return Table(
        name="posterior-table",
        caption="Convergence of the chains. N/τ, R-hat and ESS are those of the worst parameter.",
        columns=(
            Column(title="Camera", weight=1),
            Column(title="Converged"),
            Column(title="N/τ", align="right"),
            Column(title="R-hat", align="right"),
            Column(title="Bulk ESS", align="right"),
            Column(title="Tail ESS", align="right"),
            Column(title="Acceptance", align="right"),
            Column(title="Poses", align="right"),
            Column(title="emcee / Laplace [s]", align="right"),
        ),
        rows=tuple(rows),
        notes=(
            "Limits: N/τ, the length of the chains in autocorrelation times, at least 50; R-hat, the disagreement of "
            "the chains, at most 1.01; ESS, the effective sample size, at least 400; acceptance, the fraction of "
            "accepted steps in each ensemble, 0.2 to 0.5; poses, the effective fraction of the draws after reweighting "
            "with board poses fitted anew for each draw, at least 0.9. Last column: computing times of the sampler and "
            "of Laplace's normal approximation. The number of draws makes standard deviations, and depth uncertainties "
            "based on them, uncertain by 1/√(2 tail ESS): at most "
            f"{share(1.0 / np.sqrt(2.0 * np.nanmin(data['posterior_tail_size'].values)))} here.",
        ),
    )


def _parameters(posterior: xr.Dataset, camera: str, title: str) -> Table:
    places = np.flatnonzero(np.isfinite(posterior["posterior_mean"].values))
    inferred = posterior.isel(parameter=places)
    with_term = bool(np.isfinite(inferred["rig_overconfidence"].values).any())

    def number(variable: str, k: int) -> str:
        return or_dash(float(inferred[variable].values[k]))

    def quantity(variable: str, k: int) -> str:
        value, dimension = (
            float(inferred[variable].values[k]),
            parameter_dimension(str(inferred["parameter"].values[k])),
        )
        return pretty(value, dimension) if np.isfinite(value) else "—"

    last = "rig_overconfidence" if with_term else "prior_deviation"
    return Table(
        name=f"parameters-{camera}",
        caption=say(
            "Parameters of {title}{errors}: mean and standard deviation of the draws, {compared}. τ: autocorrelation "
            "time in steps of the chain.",
            title=title,
            errors="" if with_term else ", each as an error of its declared value",
            compared="standard deviation by Laplace's normal approximation, and the ratio of the standard deviation to "
            "that of a fit in which the board does not move between the two exposures of a view"
            if with_term
            else "standard deviation by Laplace's normal approximation, and that of the prior",
        ),
        columns=(
            Column(title="Parameter", weight=1),
            Column(title="Mean", align="right"),
            Column(title="Std. dev.", align="right"),
            Column(title="Laplace", align="right"),
            Column(title="Ratio" if with_term else "Prior", align="right"),
            Column(title="τ", align="right"),
            Column(title="R-hat", align="right"),
        ),
        rows=tuple(
            (
                _NAMES.get(parameter := str(inferred["parameter"].values[k])) or in_words(parameter),
                _to_the_digit(
                    float(inferred["posterior_mean"].values[k]),
                    float(inferred["posterior_deviation"].values[k]),
                    parameter_dimension(parameter),
                ),
                quantity("posterior_deviation", k),
                quantity("laplace_deviation", k),
                number(last, k) if with_term else quantity(last, k),
                number("posterior_autocorrelation", k),
                f"{float(inferred['posterior_r_hat'].values[k]):.4f}",
            )
            for k in range(places.size)
        ),
    )


def _to_the_digit(value: float, deviation: float, dimension: Dimension) -> str:
    """Write a value as far as the second digit of its standard deviation."""
    if not (np.isfinite(value) and deviation > 0.0):
        return pretty(value, dimension)
    digits = 2 + max(0, int(np.floor(np.log10(abs(value) / deviation)))) if value else 2
    return pretty(value, dimension, digits)


def _rig(data: xr.Dataset, titles: Mapping[str, str]) -> Table:
    entries = list(zip(data["rig_camera"].values, data["rig_quantity"].values, data["rig_value"].values, strict=True))
    rows: list[tuple[Text, ...]] = []
    for rig in dict.fromkeys(camera for camera, _, _ in entries):
        rows.append((titles[str(rig)],))
        rows += [(with_subscripts(str(quantity)), str(value)) for camera, quantity, value in entries if camera == rig]
    return Table(
        name="rig-table",
        caption="Fits to the corners of the board: each camera alone, the pair with one relative pose, and the pair "
        "with a board that may move a little between the two exposures of a view. Opposite mean residuals of a view in "
        "the two cameras suggest such a motion.",
        columns=(
            Column(title="Quantity", weight=1),
            Column(title="Value", weight=1, align="right"),
        ),
        rows=tuple(rows),
        notes=(
            "Residuals are root mean square lengths per corner. A fit without motion counts its effect as noise "
            "of the corners, and its standard deviations of the relative pose are too small by the factors in the "
            "column “Ratio” above.",
            "Values of one camera with ± come from the fit of this camera alone, baseline and rotation from the pair "
            "with the moving board; ± is the standard deviation by generalised least squares. The noise differs from "
            "view to view, and neighbouring corners share part of it, both as estimated by restricted maximum "
            "likelihood; the fitted poses absorb some of the shared part, which shortens the residuals. "
            "Outlying corners have little or no weight, and the fit includes a warp of the board. Accuracy: the "
            "claimed depth uncertainty of a point midway between the cameras, multiplied by the ratio of the found to "
            "the claimed difference between random halves where that ratio exceeds 1. Corners cannot reveal the size "
            "of the squares: an error of 0.1 % in their size is an error of 0.1 % in depth, 0.3 mm at 0.3 m.",
        ),
    )


def _lenses(data: xr.Dataset, titles: Mapping[str, str]) -> Iterator[Block]:
    """Say which lens model the corners support, and how each would change depth."""
    rows: list[tuple[Text, ...]] = []
    for camera in map(str, data["posterior"].values):
        compared = data.sel(posterior=camera).dropna("lens_model", subset=["rig_lens_support"])
        if not compared.sizes["lens_model"]:  # none was compared, or none could be fitted
            continue
        yield Paragraph(_supported(compared, titles[camera]))
        rows += [
            (titles[camera], str(model), *_lens_cells(compared, str(model))) for model in compared["lens_model"].values
        ]
    if not rows:
        return
    yield Table(
        name="lens-model-table",
        caption="Other lens models and the coefficients fitted, named as in study files. Support: gain over the model "
        "in use in the log likelihood of views left out of the fit one at a time, ± standard error over views. Under "
        "each distance: the change in mm of the depth of a point midway between the cameras, ± standard error by "
        "the jackknife over views.",
        columns=(
            Column(title="Rig", weight=1),
            Column(title="Lens model", weight=2),
            Column(title="Support", align="right"),
            *(Column(title=distance(float(place)), align="right") for place in data["rig_distance"].values),
        ),
        rows=tuple(rows),
    )


def _supported(compared: xr.Dataset, title: str) -> Text:
    support = compared["rig_lens_support"]
    best = compared.isel(lens_model=int(np.argmax(support.values)))
    used = lens_words(str(compared["posterior_lens_model"].item()))
    if float(best["rig_lens_support"]) > _CLEARLY * float(best["rig_lens_support_deviation"]):
        template = "The corners of {title} clearly favour another lens model, {model}, over the one in use, {used}."
        return say(template, title=title, model=str(best["lens_model"].item()), used=used)
    template = "The corners of {title} do not clearly favour a lens model other than the one in use, {used}."
    return say(template, title=title, used=used)


def lens_words(stored: str) -> str:
    """A fitted lens model as stored in results, in words."""
    if not stored:
        return lens_in_words()
    lens = json.loads(stored)
    return lens_in_words(lens["model"], lens["free"])


def _lens_cells(compared: xr.Dataset, model: str) -> Iterator[str]:
    lens = compared.sel(lens_model=model)
    yield with_deviation(float(lens["rig_lens_support"]), float(lens["rig_lens_support_deviation"]), sign="+")
    for change, error in zip(lens["rig_lens_change"].values, lens["rig_lens_change_deviation"].values, strict=True):
        yield with_deviation(1e3 * float(change), 1e3 * float(error), sign="+")


def _rank_table(tree: xr.DataTree) -> Table:
    """List the probabilities of the ranks of every pair at the declared distances."""
    data, titles = group(tree, "decision"), camera_titles(tree)
    places = [float(place) for place in table_distances(tree)]

    def cell(ranks: xr.Dataset, place: float) -> str:
        here = ranks.sel(rank_distance=place, method="nearest")
        first, error = float(here["rank_first"]), 2.0 * float(here["rank_first_error"])
        if first + float(here["rank_second"]) == 0.0:
            return "—"
        if 100.0 * error < 0.05:  # it would read ± 0.0
            return pretty(first, FRACTION)
        return f"{100 * first:.1f} ± {100 * error:.1f}\N{NO-BREAK SPACE}%"

    rows: list[tuple[Text, ...]] = []
    for error_source in data["rank_error_source"].values:
        rows.append(
            ("Calibration alone" if error_source == "calibration" else "Single measurements, noise and calibration",)
        )
        for pair in data["pair"].values:
            ranks = data.sel(pair=pair, rank_error_source=error_source)
            names = [titles[str(ranks[member].item())] for member in ("pair_first", "pair_second")]
            rows.append((*names, *(cell(ranks, place) for place in places)))
    return Table(
        name="rank-table",
        caption="Probability that the depth error of the first camera is smaller than that of the second; ± twice the "
        "standard error of this probability. A camera that does not see the point loses.",
        columns=(
            Column(title="First", weight=1),
            Column(title="Second", weight=1),
            *(Column(title=distance(place), align="right") for place in places),
        ),
        rows=tuple(rows),
    )


_TWO_DIGITS = 100.0


def describe_calibration(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the calibrations of the cameras and their effect on depth; nothing for a study without depth."""
    if not has(tree, "depth"):
        return
    yield Heading(text="Calibration", anchor="calibration")
    yield from describe_posteriors(tree, drawings)
    yield Heading(text="How far averaging helps", anchor="averaging", level=2)
    yield _averaging(tree)
    if has(tree, "sensitivity", "source_uncertainty"):
        yield Heading(text="Uncertainty from each source alone", anchor="sensitivity", level=2)
        yield from pictures_of(drawings, "tornado", "sobol-indices")
        yield from _refusals(tree)
    if has(tree, "decision", "rank_first"):
        yield Heading(text="Which camera has the smaller error", anchor="ranks", level=2)
        yield _rank_table(tree)
        yield from pictures_of(drawings, "rank-probability")


def _averaging(tree: xr.DataTree) -> Table:
    """List how many measurements it takes until noise equals calibration error, at the declared distances."""
    places = table_distances(tree)
    uncertainty = table_depth(tree)["depth_uncertainty_by_error_source"].sel(distance=places, method="nearest")
    noise, calibration = (uncertainty.sel(error_source=error_source) for error_source in ("noise", "calibration"))
    rows = tuple(
        (
            title,
            *map(_readings_worth, noise.sel(camera=key).values.tolist(), calibration.sel(camera=key).values.tolist()),
        )
        for key, title in titles_in(tree, "depth").items()
    )
    meanings = {
        "< 1": "< 1: the noise of one measurement is already below the calibration error.",
        "∞": "∞: calibration errors have no effect there, or one too small to be simulated.",
    }
    notes = " ".join(says for sign, says in meanings.items() if any(sign in row[1:] for row in rows))
    return Table(
        name="averaging-table",
        caption="Number of measurements of one point whose mean has as much noise as the calibration error. Averaging "
        "more gains little, because calibration errors do not average out.",
        columns=(
            Column(title="Camera", weight=1),
            *(Column(title=distance(float(place)), align="right") for place in places),
        ),
        rows=rows,
        notes=(notes,) if notes else (),
    )


def _readings_worth(noise: float, calibration: float) -> str:
    """Write the number of measurements with two digits; a dash if noise or calibration error has no bound."""
    if not np.isfinite([noise, calibration]).all():
        return "—"
    if calibration == 0.0:
        return "∞"
    worth = (noise / calibration) ** 2
    return "< 1" if worth < 1.0 else f"{worth:.0f}" if worth < _TWO_DIGITS else significant(worth, 2)


def _refusals(tree: xr.DataTree) -> Iterator[Block]:
    """List results that are withheld because they would mislead, with the reason for each."""
    data, rows = group(tree, "sensitivity"), []
    for key, title in titles_in(tree, "sensitivity").items():
        reason = str(data["parameter_refused"].sel(camera=key).item())
        if reason:
            rows.append((title, "one bar for each parameter", reason.replace(" -", " −")))
        why = sorted({str(text) for text in data["index_refused"].sel(camera=key, field=0.0).values} - {""})
        if why:
            rows.append((title, "Sobol indices at some distances", "; ".join(why)))
    if rows:
        yield Table(
            name="refused-table",
            caption="Results withheld because they would mislead.",
            columns=(
                Column(title="Camera", weight=1),
                Column(title="Result", weight=1),
                Column(title="Reason", weight=4),
            ),
            rows=tuple(rows),
        )
