"""The scene: its distances, its light, and the surfaces in it."""

from __future__ import annotations

import itertools
from typing import Annotated, Self

from pydantic import Field, model_validator

from tradestudy.declarations.distances import MOST_DISTANCES, DistanceRangePart
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import ObjectDistance, PositiveWavelength
from tradestudy.study.schema.picture import PicturePart
from tradestudy.study.schema.scene_image import SceneImagePart


class ScenePart(Part):
    """The scene that the cameras observe."""

    distances: (
        DistanceRangePart | Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=MOST_DISTANCES)]
    ) = Field(description="Distances at which the cameras are evaluated: a range or an increasing list.")
    wavelength: PositiveWavelength = Field(description="Wavelength of the light.")
    picture: PicturePart | None = Field(
        default=None,
        description="Texture, light and sensor noise, from which the program derives disparity errors and renders "
        "pictures.",
    )

    image: SceneImagePart | None = Field(
        default=None,
        description="Surfaces at different depths, of which the commands `run` and `render` make pictures.",
    )

    @model_validator(mode="after")
    def _image_needs_light(self) -> Self:
        if self.image is not None and self.picture is None:
            raise MistakeAt(("image",), "needs scene.picture too, which gives its texture, light and noise")
        return self

    @model_validator(mode="after")
    def _sorted(self) -> Self:
        pairs = enumerate(itertools.pairwise(self.distance_values()), start=1)
        if wrong := [index for index, (near, far) in pairs if not near < far]:
            at = () if isinstance(self.distances, DistanceRangePart) else (wrong[0],)
            raise MistakeAt(("distances", *at), "distances must increase, without repeats")
        return self

    def distance_values(self) -> tuple[float, ...]:
        """The distances [m], increasing."""
        return self.distances.values() if isinstance(self.distances, DistanceRangePart) else self.distances
