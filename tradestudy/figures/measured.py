"""Measured depth errors on the predicted curve, and the disparity errors behind them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.figures.style import (
    SOFT,
    CameraTrace,
    StudyFigure,
    all_traces,
    distance_axis,
    distance_label,
    legend,
    length_tick,
    log_axis,
    new_figure,
    styled,
)
from tradestudy.results.views.measured import NAMES, Measured, measured_tables

MM = 1e3
_MARGIN = 1.08  # of the distances


def measured_drawings(tree: xr.DataTree) -> Iterator[Drawing]:
    """One figure for each table of measurements with an error other than 0 to mark."""
    for measurements in measured_tables(tree):
        if not np.any(np.abs(measurements.values(measurements.spread or "bias")) > 0.0):
            continue
        trace = next(trace for trace in all_traces(tree) if trace.key == str(measurements.table["camera_of"].item()))
        quantity = NAMES[measurements.spread or "bias"]
        caption = f"{measurements.title}: measured {quantity} (marks), the prediction (line)"
        caption += " and its fit to the marks (dashed)." if measurements.spread else "."
        if np.isfinite(measurements.values("error_px")).any():
            signed = np.isfinite(measurements.values("bias")).any()
            fit = "sub-pixel locking" if measurements.locked else "an offset and a scale" if signed else ""
            kind = "mean disparity errors" if signed else "magnitudes of the disparity errors"
            caption += f" Below: {kind} behind the marks" + (f", and the fit of {fit} (dashed)." if fit else ".")
        sentence = measurements.finding()
        yield Drawing(
            name=f"measured_{measurements.name}",
            caption=caption,
            alt=f"{sentence[0].upper()}{sentence[1:]}.",
            draw=lambda table=measurements, trace=trace: draw_measured(table, trace),  # type: ignore[misc]
        )


@styled()
def draw_measured(measurements: Measured, trace: CameraTrace) -> StudyFigure:
    """Draw the measured and the predicted error over distance and, if known, the disparity errors behind them."""
    z, error, used = (
        measurements.values("distance_of_row"),
        measurements.values("error_px"),
        measurements.values("used") > 0.0,
    )
    has_px = bool(np.isfinite(error).any())
    figure = new_figure(4.6 if has_px else 3.0)
    panels = figure.subplots(2 if has_px else 1, 1, sharex=True, squeeze=False)[:, 0]
    ends = float(z.min()) / _MARGIN, float(z.max()) * _MARGIN
    distance_axis(panels[0], ends, dense=True)
    panels[-1].set_xlabel(distance_label(ends[1]))
    curve, quantity = np.asarray(measurements.table["curve_distance"].values), measurements.spread or "bias"
    measured = np.abs(measurements.values(quantity)) * MM
    predicted = np.where(
        measurements.table["curve_predicted"].values > 0.0, measurements.table["curve_predicted"].values * MM, np.nan
    )
    fitted = measurements.fitted() * MM if measurements.spread else np.full(curve.shape, np.nan)
    shown = np.concatenate([measured, predicted, fitted])
    shown = shown[np.isfinite(shown) & (shown > 0.0)]
    limits = float(shown.min()) / 1.3, float(shown.max()) * 1.3
    log_axis(panels[0], "y", tick=length_tick, ends=limits)
    panels[0].set(ylim=limits, ylabel=NAMES[quantity], title="Depth error")
    color, points = trace.style.color, {"marker": "o", "linestyle": "", "markersize": 3.0, "alpha": 0.8}
    lines = [
        panels[0].plot(z[used], measured[used], color=color, label="measured", **points)[0],
        panels[0].plot(curve, predicted, color=color, linewidth=1.6, label="predicted")[0],
    ]
    if np.isfinite(fitted).any():
        lines += panels[0].plot(curve, fitted, color=SOFT, linestyle=(0, (4, 1.5)), linewidth=1.2, label="fitted")
    if not used.all():
        look = {**points, "markerfacecolor": "none"}
        lines += panels[0].plot(z[~used], measured[~used], color=SOFT, label="where nothing is predicted", **look)
    if has_px:
        panels[1].set(title="Disparity error", ylabel="px")
        panels[1].plot(z, error, color=color, label="measured", **points)
        fit = measurements.fitted_px()
        if measurements.locked:  # the fit is seen where the table has two samples per period
            sampled = np.sort(z[np.isfinite(error)])[-int(measurements.number("ripple_points")) :]
            fit = np.where(curve >= sampled[0], fit, np.nan)
        panels[1].plot(curve, fit, color=SOFT, linestyle=(0, (4, 1.5)), linewidth=1.2, label="fitted")
        low, high = float(np.nanmin(error)), float(np.nanmax(error))
        room = 0.1 * (high - low) or 0.1
        panels[1].set_ylim(low - room, high + room)
    legend(figure, lines, [str(line.get_label()) for line in lines], columns=len(lines))
    return figure
