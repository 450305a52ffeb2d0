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
    """Samples of a field, with its pupil power and stated error.

    Metrics with errors need 4 n + 1 rows and columns; from any other number, up to three at the far side are dropped.

    Parameters
    ----------
    field
        `PointSpread`, or an `ApertureField` on a `TargetGrid` or on points that form a grid in one plane.

    Returns
    -------
    PointSpread
        The samples; a `PointSpread` is returned unchanged.

    Raises
    ------
    OutOfRangeError
        The targets do not form a regular grid in one plane, or have fewer than 33 rows or columns.

    References
    ----------
    The samples themselves: nothing is interpolated.

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
