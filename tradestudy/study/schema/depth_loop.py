"""The check whether cameras measure depth as predicted, in rendered pictures of planes."""

from __future__ import annotations

import itertools
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import ObjectDistance, PositiveElectrons, PositiveFraction, distinct

_MOST = 50


class DepthLoopPart(Part):
    """A comparison of predicted depth uncertainties with the depth errors in rendered pictures of planes.

    The planes are perpendicular to the optical axis. Texture, light, noise and window are those of scene.picture. The
    program fits the parameters of the matcher to the depth errors at the distances in `fitted_at`. It tests the fitted
    matcher at all other distances, with other random textures and noise.
    """

    distances: Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=_MOST)] = Field(
        description="Distances of the planes, in increasing order."
    )
    fitted_at: Annotated[
        tuple[ObjectDistance, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)
    ] = Field(description="Those of the `distances` at which the matcher is fitted to the depth errors.")
    cameras: Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(distinct)] | None = Field(
        default=None, description="Cameras to test; default: all that measure depth."
    )
    contrasts: (
        Annotated[tuple[PositiveFraction, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)] | None
    ) = Field(
        default=None, description="Contrasts of the texture to test; default: the contrast in scene.picture.texture."
    )
    electrons: (
        Annotated[tuple[PositiveElectrons, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)] | None
    ) = Field(
        default=None,
        description="Mean numbers of electrons per pixel to test; default: scene.picture.light.electrons. Needed if "
        "the light is given in photons.",
    )
    texture_scaled_from: ObjectDistance | None = Field(
        default=None,
        description="Distance at which the texture has its declared correlation length. At other distances, that "
        "length is proportional to the distance, so that a camera sees the same texture everywhere. "
        "Default: no scaling.",
    )
    windows: Annotated[int, Field(strict=True, ge=100, le=1_000_000)] = Field(
        default=1500,
        description="Number of non-overlapping matching windows to measure on each plane, in at most eight pictures. "
        "The spread of the depth errors is then known with a relative error of about 1/√windows.",
    )
    samples: Annotated[int, Field(strict=True, ge=4, le=4096)] = Field(
        default=64,
        description="Number of rays traced from each pixel through each lens or microlens that sends light to this "
        "pixel. With too few, the noise of rendering looks like an error of the matcher.",
    )

    @model_validator(mode="after")
    def _at_known_distances(self) -> Self:
        if wrong := [k for k, (near, far) in enumerate(itertools.pairwise(self.distances), start=1) if not near < far]:
            raise MistakeAt(("distances", wrong[0]), "distances must increase, without repeats")
        if unknown := [k for k, one in enumerate(self.fitted_at) if one not in self.distances]:
            raise MistakeAt(("fitted_at", unknown[0]), "is not one of the distances")
        return self
