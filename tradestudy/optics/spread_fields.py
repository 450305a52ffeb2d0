"""Conversion of fields on regular grids to the samples that every metric accepts."""

from __future__ import annotations

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.argument_types import checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.result import ApertureField
from tradestudy.optics.propagation.targets import TargetGrid, Targets
from tradestudy.optics.sampled_point_spread import PointSpread

SpreadField = PointSpread | ApertureField


@checked
def as_point_spread(field: SpreadField) -> PointSpread:
    """Convert a field on a regular grid to the `PointSpread` from which metrics are computed.

    The error estimates of the metrics need 4 n + 1 rows and 4 m + 1 columns, where n and m are whole numbers. From
    other grids, up to three of the last rows and of the last columns are dropped.

    Parameters
    ----------
    field
        `ApertureField` on a `TargetGrid`, or on `TargetPoints` that form a regular grid at one distance; or a
        `PointSpread`.

    Returns
    -------
    PointSpread
        The intensity of the field at the points of the grid, the pupil power, and the relative error of the intensity.
        A `PointSpread` is returned unchanged.

    Raises
    ------
    OutOfRangeError
        The targets do not form a regular grid at one distance, they have fewer than 33 rows or columns, an intensity is
        infinite, as with rays at a focus, or the error of the intensity is NaN, as in a result of `propagate_samples`.

    References
    ----------
    No formula: the intensity is copied, not interpolated.

    Examples
    --------
    >>> from tradestudy import optics
    >>> field = optics.aperture_field(
    ...     source=optics.PointSource(distance=0.5),
    ...     lens=optics.CircularLens(radius=2e-3, focal_length=25e-3, lens_phase="perfect"),
    ...     targets=optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=0.5e-6, count=64, distance=0.5 * 25e-3 / 0.475),
    ...     wavelength=550e-9,
    ...     method="kirchhoff",
    ...     accuracy=optics.FieldAccuracy(tolerance=1e-6),
    ... )
    >>> optics.as_point_spread(field).intensity.shape
    (61, 61)
    """
    if isinstance(field, PointSpread):
        return field
    x, y = _axes(field.targets)
    rows, columns = (4 * ((axis.size - 1) // 4) + 1 for axis in (y, x))
    return PointSpread(
        x=x[:columns],
        y=y[:rows],
        intensity=field.intensity.reshape(y.size, x.size)[:rows, :columns],
        pupil_power=field.pupil_power,
        relative_error=field.error.intensity,
    )


def _axes(targets: Targets) -> tuple[FloatArray, FloatArray]:
    """Positions of columns and rows [m]."""
    if isinstance(targets, TargetGrid):
        return targets.x_axis, targets.y_axis
    if len(targets.shape) == 2:
        x, y, z = (c.reshape(targets.shape) for c in targets.coordinates())
        if not (np.ptp(x, axis=0).any() or np.ptp(y, axis=1).any() or np.ptp(z)):
            return x[0], y[:, 0]
    raise OutOfRangeError(
        "field on scattered points",
        value=f"targets of shape {targets.shape}",
        limit="a regular grid in one plane",
        remedy="compute the field on a TargetGrid",
    )
