"""A camera's depth at any distance, read from one table over the study's range.

A study asks a camera for its depth at thousands of distances: where its usable range ends, where another camera becomes
better, how uncertain it is at worst over a requirement. Between the places where a lens type, an estimator or a limit
switches, the distribution of depth is a smooth function of distance, so one table answers them all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.depth.distribution import DepthDistribution, standard_error
from tradestudy.depth.evaluation import Reading, distribution, finite, imaged, model_error
from tradestudy.depth.remembered import remembered
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray, lagrange_weights

NODES_PER_FACTOR: Final = 64.0
"""Nodes of a table in a factor e of distance."""
_PER_FACTOR_DRAWN: Final = 24.0  # of an exact model, whose draws cost milliseconds a node
_SAFE: Final = 1e-7  # largest estimated error of an interpolated width, relative to it
_SAFE_DRAWN: Final = 0.25  # the same for a drawn width, relative to the standard deviation between scrambles
_MOST_DRAWN: Final = 2e-3  # of a drawn width; scrambles differ widely where an interval is about to become unbounded
_HALF_STENCIL: Final = 3  # nodes on each side of a distance
_DENSER: Final = 64  # dense points between two nodes, among which narrow features are sought
_NARROW: Final = 0.02  # of the depth error, by which a feature departs from the line between two nodes
_NEGLIGIBLE: Final = 1e-9  # error of a failed fraction


@dataclass(frozen=True, kw_only=True, eq=False)
class _Curves:
    """Values (…, nodes) at distances [m] that are evenly spaced in their logarithm."""

    distance: FloatArray
    values: FloatArray

    def read(self, distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values at distances [m], how far a lower order is off, and the values used (…, distances, nodes).

        NaN where a value used is infinite or unknown.
        """
        step = math.log(self.distance[-1] / self.distance[0]) / (self.distance.size - 1)
        place = np.log(distance / self.distance[0]) / step
        interval = np.clip(place.astype(int), 0, self.distance.size - 2)
        first = self._first[interval]
        # The lower order uses four of the six nodes, two on each side of the distance where the six allow it.
        inner = first + np.clip(interval - first - 1, 0, 2)
        around = self.values[..., first[:, None] + np.arange(2 * _HALF_STENCIL)]
        near = self.values[..., inner[:, None] + np.arange(2 * _HALF_STENCIL - 2)]
        with np.errstate(invalid="ignore"):  # infinite values at a node: not known between nodes
            value, lower = (
                np.sum(values * lagrange_weights(np.arange(float(values.shape[-1])), place - start), axis=-1)
                for values, start in ((around, first), (near, inner))
            )
            return value, np.abs(value - lower), around

    @cached_property
    def _first(self) -> IndexArray:
        """First of the nodes used in each interval: those around it or, beside unknown values, those on one side."""
        intervals = np.arange(self.distance.size - 1)
        firsts = np.stack([intervals + 1 - _HALF_STENCIL + shift for shift in (0, -1, 1, -2, 2)])
        firsts = np.clip(firsts, 0, self.distance.size - 2 * _HALF_STENCIL)
        known = np.isfinite(self.values).reshape(-1, self.distance.size).all(axis=0)
        # The first shift without unknown values counts; without one, the centred nodes give NaN, which is never safe.
        whole = np.asarray(sliding_window_view(known, 2 * _HALF_STENCIL).all(axis=1))
        return np.asarray(firsts[whole[firsts].argmax(axis=0), intervals])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    """The distribution at nodes that are evenly spaced in the logarithm of distance."""

    distance: FloatArray
    nodes: DepthDistribution

    @cached_property
    def ends(self) -> _Curves:
        """Inverse depth relative to the true one, less 1: its quantiles and the far end of the error radius.

        Shape (scrambles, probabilities + 1, nodes); -1 where depth is infinite.
        """
        far = self.distance + self.nodes.error_radii[:, np.newaxis]
        depth = np.concatenate([self.nodes.quantiles, far], axis=1)
        return _Curves(distance=self.distance, values=self.distance / depth - 1.0)

    @cached_property
    def failures(self) -> _Curves:
        """Failed shares, (scrambles, nodes)."""
        return _Curves(distance=self.distance, values=self.nodes.failures())


@lru_cache(maxsize=512)
def _table(camera: DepthCamera, field: FieldPosition, error_source: str) -> _Table | None:
    """The table of a camera over the range of its study; None if it has none, or too short a one."""
    judged = camera.propagation.judged
    if not judged or not judged[0] < judged[-1]:
        return None
    density = _PER_FACTOR_DRAWN if camera.propagation.model == "exact" and error_source != "noise" else NODES_PER_FACTOR
    count = max(2 * _HALF_STENCIL, 1 + math.ceil(density * math.log(judged[-1] / judged[0])))
    distance = np.geomspace(judged[0], judged[-1], count)
    return _Table(distance=distance, nodes=distribution(camera, imaged(camera, distance), error_source, field))


@remembered(256)
def distribution_between(
    camera: DepthCamera, distance: FloatArray, error_source: str = "both", field: FieldPosition = 0.0, /
) -> DepthDistribution:
    """The distribution of depth at distances [m], interpolated in the table of the camera where that is safe.

    Between nodes, a polynomial of degree 5 in the logarithm of distance gives the inverse depths of quantiles and of
    the far end of the error radius, and failed shares. Where one of degree 3 differs from it by more than 1e-7 of the
    width, or a quarter of the standard deviation between scrambles, as where a lens type switches or an interval
    becomes unbounded, and beyond the range of the study, the distribution is computed at the distance itself.
    """
    table = _table(camera, field, error_source)
    distance = imaged(camera, distance)
    if table is None:
        return distribution(camera, distance, error_source, field)
    inside = (table.distance[0] <= distance) & (distance <= table.distance[-1])
    read = _Reading(
        camera=camera, distance=distance, error_source=error_source, field=field, table=table, inside=inside
    )
    return DepthDistribution(
        probabilities=camera.propagation.probabilities,
        quantiles=read.quantiles,
        failures=lambda: read.failures,
        radii=lambda: read.radii,
        counting_step=table.nodes.counting_step,
        false_matches=table.nodes.false_matches,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Reading:
    """What a table gives at distances, and what is computed there instead."""

    camera: DepthCamera
    distance: FloatArray
    error_source: str
    field: FieldPosition
    table: _Table
    inside: BoolArray

    @cached_property
    def _ends(self) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Interpolated ends (`_Table.ends`) as depth relative to the distance, where all are safe, and where unseen."""
        value, error, around = self.table.ends.read(self.distance[self.inside])
        beyond = np.all(around == -1.0, axis=-1)  # infinity at all nodes
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = 1.0 / np.where(beyond, 0.0, 1.0 + value)
            widths = relative - 1.0
            # All quantiles share the width of the widest interval; an infinite end counts as 0, which leaves it finite.
            widths[:, :-1] = np.ptp(np.where(np.isinf(relative), 0.0, relative)[:, :-1], axis=1, keepdims=True) / 2.0
            # Depth is the inverse of what is interpolated: its error is larger by the square of depth.
            safe = beyond | (error * relative**2 <= self._allowed(widths)) & (relative > 0.0)
        unseen = np.isnan(around).all(axis=(0, 1, 3))
        return relative, np.asarray(np.all(safe, axis=(0, 1))), np.asarray(unseen)

    @cached_property
    def quantiles(self) -> FloatArray:
        """Quantiles of depth [m], shape (scrambles, probabilities, distances)."""
        relative, safe, _ = self._ends
        return self._filled(self.distance[self.inside] * relative[:, :-1], safe, lambda depth: depth.quantiles)

    @cached_property
    def radii(self) -> FloatArray:
        """Error radii [m], shape (scrambles, distances)."""
        relative, safe, _ = self._ends
        return self._filled(self.distance[self.inside] * (relative[:, -1] - 1.0), safe, lambda depth: depth.error_radii)

    @cached_property
    def failures(self) -> FloatArray:
        """Failed shares, shape (scrambles, distances)."""
        share, error, _ = self.table.failures.read(self.distance[self.inside])
        allowed = np.maximum(self._allowed(share), _NEGLIGIBLE + _SAFE_DRAWN * self.table.nodes.counting_step)
        # Where ends are computed at the distance, so are failures: a table can show none where half of them fail.
        safe = self._ends[1] & np.all(error <= allowed, axis=0)
        return self._filled(np.clip(share, 0.0, 1.0), safe, lambda depth: depth.failures())

    def _allowed(self, widths: FloatArray) -> FloatArray:
        """The largest error of interpolated values, shape (scrambles, distances)."""
        # Without draws the deviation is 0, and only the smallest error of a width is allowed.
        drawn = _SAFE_DRAWN * np.nan_to_num(standard_error(widths)) * math.sqrt(len(widths))
        return np.clip(drawn, _SAFE * np.abs(widths), _MOST_DRAWN * np.abs(widths))

    def _filled(
        self, read: FloatArray, safe: BoolArray, quantity: Callable[[DepthDistribution], FloatArray]
    ) -> FloatArray:
        """What was read where it is safe, and what is computed elsewhere."""
        values = np.full((*read.shape[:-1], self.distance.size), np.nan)
        kept = self.inside.copy()
        kept[self.inside] = safe
        values[..., kept] = read[..., safe]
        missing = ~kept & ~np.isnan(self.distance)
        missing[self.inside] &= ~self._ends[2]  # where nothing is measured at any node around
        if missing.any():
            computed = distribution(self.camera, self.distance[missing], self.error_source, self.field)
            values[..., missing] = quantity(computed)
        return values


@lru_cache(maxsize=512)
def narrow_features(camera: DepthCamera) -> tuple[float, ...]:
    """Distances [m] within the range of the study where the depth error changes faster than a table shows.

    Such are the places where the image lies on the microlenses, or a lens type or an estimator switches. The change of
    depth per disparity (`DepthCamera.depth_discrimination` towards the camera), a closed form, shows them on a dense
    grid. Without microlenses that blur the matched picture, there are none.
    """
    judged = camera.propagation.judged
    if not camera.pictured_by_microlenses or not judged or not judged[0] < judged[-1]:
        return ()
    count = 1 + _DENSER * math.ceil(NODES_PER_FACTOR * math.log(judged[-1] / judged[0]))
    dense = np.geomspace(judged[0], judged[-1], count)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen, step = imaged(camera, dense), camera.discrimination_step_px * camera.sample_pitch
        change = np.log(seen - camera.depth_of_disparity(camera.disparity(seen) + step, seen))
        # The dense points show how far the change departs from a straight line between two nodes.
        line = np.interp(np.arange(count), np.arange(0, count, _DENSER), change[::_DENSER])
        apart = np.nan_to_num(np.abs(change - line)).reshape(-1)[:-1].reshape(-1, _DENSER)
    starts = np.flatnonzero(apart.max(axis=1) > _NARROW) * _DENSER
    peaks = starts + apart[starts // _DENSER].argmax(axis=1)
    around = np.concatenate([starts, peaks, starts + _DENSER])
    return tuple(np.unique(dense[around]).tolist())


def judged_uncertainty(
    camera: DepthCamera, distance: FloatArray, error_source: str = "both", field: FieldPosition = 0.0
) -> FloatArray:
    """The uncertainty [m] that judges a camera: the larger of half width and radius about the true distance.

    The radius contains 68.27 % of all measurements, failures and false matches counted as infinitely wrong; it exceeds
    the half width where measurements are biased or fail.
    """
    return distribution_between(camera, distance, error_source, field).judged


def judged_uncertainty_error(
    camera: DepthCamera,
    distance: FloatArray,
    error_source: str = "both",
    field: FieldPosition = 0.0,
    *,
    depth: Reading = distribution_between,
) -> FloatArray:
    """Estimated error of `judged_uncertainty` [m]: the standard error of draws, or the error of a cheaper model."""
    distance = imaged(camera, distance)
    depths = depth(camera, distance, error_source, field)
    if camera.propagation.model == "exact":
        return depths.judged_error
    return np.asarray(model_error(camera, distance, error_source, field).judged * finite(depths.judged))
