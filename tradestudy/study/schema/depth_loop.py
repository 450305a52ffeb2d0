"""The check whether cameras measure depth as predicted, in rendered pictures of planes."""

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
    """Planes across the axis, rendered and measured, each with its own texture and noise.

    Texture, light, noise and window are those of scene.picture. The matcher is fitted to the errors at some distances
    and tested on those at all others.
    """

    distances: Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=_MOST)] = Field(
        description="Distances of the planes, increasing."
    )
    fitted_at: Annotated[
        tuple[ObjectDistance, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)
    ] = Field(description="Distances at which the matcher is fitted to the errors; they share one seed.")
    cameras: Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(distinct)] | None = Field(
        default=None, description="Cameras to test; default: all that measure depth."
    )
    contrasts: (
        Annotated[tuple[PositiveFraction, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)] | None
    ) = Field(default=None, description="Contrasts of the texture; default: that of scene.picture.")
    electrons: (
        Annotated[tuple[PositiveElectrons, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)] | None
    ) = Field(default=None, description="Mean number of electrons in a pixel; default: that of scene.picture.light.")
    texture_scaled_from: ObjectDistance | None = Field(
        default=None,
        description="Distance at which the texture has its declared correlation length; elsewhere the length scales "
        "with distance, so that a camera sees the same texture at all distances; default: no scaling.",
    )
    windows: Annotated[int, Field(strict=True, ge=100, le=1_000_000)] = Field(
        default=1500,
        description="Number of non-overlapping matching windows on each plane, at most as many as eight pictures "
        "contain; the relative error of the measured spread is about 1/sqrt(windows).",
    )
    samples: Annotated[int, Field(strict=True, ge=4, le=4096)] = Field(
        default=64,
        description="Rays per pixel and lens; many of them keep the sampling error from passing for the matcher's.",
    )

    @model_validator(mode="after")
    def _at_known_distances(self) -> Self:
        if wrong := [k for k, (near, far) in enumerate(itertools.pairwise(self.distances), start=1) if not near < far]:
            raise MistakeAt(("distances", wrong[0]), "distances must increase, without repeats")
        if unknown := [k for k, one in enumerate(self.fitted_at) if one not in self.distances]:
            raise MistakeAt(("fitted_at", unknown[0]), "is not one of the distances")
        return self
