"""Whether cameras measure depth as predicted: pictures of planes, and the depth that is measured in them."""

from __future__ import annotations

import itertools
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import ObjectDistance, PositiveElectrons, PositiveFraction
from tradestudy.declarations.words import distinct

_MOST = 50


class DepthLoopPart(Part):
    """Planes across the axis whose pictures are taken and measured, each with a texture and noise of its own.

    Texture, light, noise and window are those of scene.picture. The matcher is fitted to the errors at some of the
    distances and held against those at all others.
    """

    distances: Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=_MOST)] = Field(
        description="Of the planes, increasing."
    )
    fitted_at: Annotated[
        tuple[ObjectDistance, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)
    ] = Field(description="Those of the distances whose errors the matcher is fitted to; they share one seed.")
    cameras: Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(distinct)] | None = Field(
        default=None, description="Those that measure; default: all that measure depth."
    )
    contrasts: (
        Annotated[tuple[PositiveFraction, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)] | None
    ) = Field(default=None, description="Of the texture; default: that of scene.picture.")
    electrons: (
        Annotated[tuple[PositiveElectrons, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)] | None
    ) = Field(default=None, description="Mean electrons of a pixel, as in scene.picture.light; default: those.")
    texture_scaled_from: ObjectDistance | None = Field(
        default=None,
        description="Where the texture has its correlation length, elsewhere in proportion to distance, so that a "
        "camera sees it alike at all distances; default: the same texture everywhere.",
    )
    windows: Annotated[int, Field(strict=True, ge=100, le=1_000_000)] = Field(
        default=1500,
        description="Matching windows without common pixels that are measured on each plane, as far as the sensor has "
        "them; the spread is then known to 1/sqrt(windows), about.",
    )
    samples: Annotated[int, Field(strict=True, ge=4, le=4096)] = Field(
        default=8, description="Rays for each pixel and lens."
    )

    @model_validator(mode="after")
    def _at_known_distances(self) -> Self:
        if wrong := [k for k, (near, far) in enumerate(itertools.pairwise(self.distances), start=1) if not near < far]:
            raise MistakeAt(("distances", wrong[0]), "distances increase, each stands once")
        if unknown := [k for k, one in enumerate(self.fitted_at) if one not in self.distances]:
            raise MistakeAt(("fitted_at", unknown[0]), "is none of the distances")
        return self
