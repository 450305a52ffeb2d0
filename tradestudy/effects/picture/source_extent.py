"""Extent of the source: a surface is made of points that light up on their own."""

from __future__ import annotations

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.criteria import extent_of_points
from tradestudy.effects.picture.trial import PictureTrial, bounded


def source_extent(trial: PictureTrial) -> Slot:
    """Off: the texture is the source, point by point."""
    reason = "every point of the texture is a source of its own; none has an extent"
    return Slot(name="source_extent", models=(bounded(trial, OFF, 0.0, extent_of_points(), reason),))
