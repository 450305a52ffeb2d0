"""Figures about calibration, with captions and alt texts."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr

from tradestudy.figures import calibration_trust, posterior, ranks, sensitivity
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import selection_words, traces
from tradestudy.figures.value_tables import residual_tables, source_tables
from tradestudy.results.views.depth import largest_source
from tradestudy.results.views.groups import camera_titles, group
from tradestudy.units import LENGTH, pretty, significant
from tradestudy.wording import in_words


def calibration_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """The figures on error sources, ranks and posteriors that the study allows."""
    if "sensitivity" in tree.children:
        yield from _sensitivity(tree)
    if "decision" in tree.children and "rank_first" in tree["decision"].data_vars:
        yield _ranks(tree)
    if "calibration" in tree.children and "posterior_draw" in tree["calibration"].data_vars:
        for name in tree["calibration"].to_dataset()["posterior"].values:
            yield from _posterior(tree, str(name))
            if "rig_claimed" in tree["calibration"].data_vars:
                yield from _trust(tree, str(name))


def _sensitivity(tree: xr.DataTree) -> Iterator[Drawing]:
    place = sensitivity.tornado_distance(tree)
    selection = selection_words(tree, "sensitivity")
    shown = {camera.key: camera.title for camera in traces(tree, "sensitivity")}
    sentences = [
        f"{title}: {in_words(largest)}, {_source_words(tree, key, largest, place)}. "
        for key, title in shown.items()
        if (largest := largest_source(tree, key, place)) is not None
    ]
    yield Drawing(
        name="tornado",
        caption=f"Depth uncertainty at {pretty(place, LENGTH)} (half the width of the central 68.27 % interval) from "
        "each source alone. Correlated parameters, such as those of a joint calibration, count as one source: moving "
        "one of them alone would describe cameras that the calibration rules out." + selection,
        alt="Bar charts of depth uncertainty by source, one per camera. The largest on the axis: " + "".join(sentences),
        draw=partial(sensitivity.draw_tornado, tree),
        values=partial(source_tables, tree, place),
    )
    yield Drawing(
        name="sobol-indices",
        caption="Total (lines) and first-order (rings) Sobol indices of inverse depth on the axis, of the "
        "independent sources whose total index reaches 0.02. A line above its ring shows interaction with other "
        "sources; total indices then sum to more than 1, so they are not shares." + selection,
        alt="One chart per camera of total and first-order Sobol indices against distance. Largest total index at "
        f"{pretty(place, LENGTH)}: " + _index_words(tree, place),
        draw=partial(sensitivity.draw_indices, tree),
    )


def _source_words(tree: xr.DataTree, camera: str, source: str, place: float) -> str:
    """The uncertainty of depth from one source alone, on the axis at a distance [m]."""
    alone = group(tree, "sensitivity")["source_uncertainty"].sel(
        camera=camera, field=0.0, distance=place, source=source
    )
    return pretty(float(alone), LENGTH)


def _index_words(tree: xr.DataTree, place: float) -> str:
    """The largest total index of each camera on the axis at a distance [m]."""
    there = group(tree, "sensitivity")["total_index"].sel(field=0.0, distance=place)
    sentences = []
    for camera in traces(tree, "sensitivity"):
        values = np.asarray(there.sel(camera=camera.key).values, dtype=np.float64)
        if np.isfinite(values).any():
            first = int(np.nanargmax(values))
            source = in_words(str(there["source"].values[first]))
            sentences.append(f"{camera.title}: {source} {significant(float(values[first]), 2)}. ")
        else:
            sentences.append(f"{camera.title}: none is known. ")
    return "".join(sentences)


def _tie_words(tree: xr.DataTree, name: str) -> str:
    """The two parameters of a posterior with the strongest correlation."""
    if (tie := posterior.closest_tie(tree, name)) is None:
        return ""
    first, second, correlation = tie
    return f"Strongest correlation: {in_words(first)} and {in_words(second)}, {significant(correlation, 2)}."


def _ranks(tree: xr.DataTree) -> Drawing:
    decision = tree["decision"].to_dataset().sel(rank_error_source="calibration")
    titles = camera_titles(tree)
    sentences = []
    for pair in decision["pair"].values:
        there = decision.sel(pair=pair).sel(rank_distance=1.0, method="nearest")
        first, second = (titles[str(there[name].item())] for name in ("pair_first", "pair_second"))
        sentences.append(
            f"{first} more accurate than {second} at {pretty(float(there['rank_distance']), LENGTH)}: "
            f"{significant(100.0 * float(there['rank_first']))} %. "
        )
    return Drawing(
        name="rank-probability",
        caption="Probability that the depth error of the first camera is smaller than that of the second. Calibration "
        "alone: calibration errors and drift vary, and all noise is averaged out. Single measurements: noise as well. "
        "Shaded: 2 Monte Carlo standard errors. Drift with temperature or pressure that both cameras declare alike is "
        "drawn once for both.",
        alt="Probability against distance, one chart for each pair of cameras. Calibration alone: "
        + "".join(sentences),
        draw=partial(ranks.draw_rank_probability, tree),
    )


def _posterior(tree: xr.DataTree, name: str) -> Iterator[Drawing]:
    titles = camera_titles(tree)
    data = tree["calibration"].to_dataset().sel(posterior=name)
    count = int(np.isfinite(data["posterior_mean"].values).sum())
    shown = posterior.shown_parameters(tree, name)
    which = (
        f"the {len(shown)} most strongly correlated of {count} parameters" if len(shown) < count else "all parameters"
    )
    yield Drawing(
        name=f"corner-{name}",
        caption=f"Posterior of {titles[name]}: {which}, in standard deviations from the mean. Contours contain 39 "
        f"and 86 % of the draws, as one and two standard deviations of a bivariate normal do. Dashed: Laplace's normal "
        "approximation.",
        alt=f"Corner plot of the posterior draws of {titles[name]}: {', '.join(map(in_words, shown))}. "
        + _tie_words(tree, name),
        draw=partial(posterior.draw_corner, tree, name),
        values=partial(posterior.corner_values, tree, name),
    )
    yield Drawing(
        name=f"trace-{name}",
        caption=f"Chains behind the posterior of {titles[name]}: the first walker of each independent ensemble, one "
        "colour each, after the warm-up, in standard deviations from the mean.",
        alt=f"Trace plot of the chains of {titles[name]}, one row per parameter. "
        + (
            "All ensembles cover the same range: "
            if bool(data["posterior_converged"])
            else "The chains did not converge: "
        )
        + f"the largest R-hat is {float(np.nanmax(data['posterior_r_hat'].values)):.4f}.",
        draw=partial(posterior.draw_trace, tree, name),
        values=partial(posterior.trace_values, tree, name),
    )


def _trust(tree: xr.DataTree, name: str) -> Iterator[Drawing]:
    data = tree["calibration"].to_dataset().sel(posterior=name)
    if not np.isfinite(data["rig_claimed"].values).any():
        return
    ratio = data["rig_halves_difference"].values / data["rig_halves_claim"].values
    distances = [pretty(float(one), LENGTH) for one in data["rig_distance"].values]
    yield Drawing(
        name=f"trust-{name}",
        caption=f"How far to trust the calibration of {camera_titles(tree)[name]}. Above: mean residuals of each "
        "camera fitted alone, in cells of its picture; arrows that agree in neighbouring cells show errors of the lens "
        "model or of the board. Below, for a point midway between the cameras: the RMS difference between the depths "
        "that random halves of the views give (found); this difference as the uncertainties of the halves predict it "
        "(claimed); and the depth uncertainty that the fit to all views claims.",
        alt=f"Two maps of arrows for {camera_titles(tree)[name]}, and a chart of halves of the views, whose "
        "differences, divided by the claimed ones, are: "
        + ", ".join(f"{significant(float(one), 2)} at {where}" for one, where in zip(ratio, distances, strict=True))
        + ".",
        draw=partial(calibration_trust.draw_trust, tree, name),
        values=partial(residual_tables, data["rig_residual"].values),
    )
