"""/pictures: what the cameras' pictures of the scene look like, reduced, with a detail and the true depth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_OF: Final = ("picture",)
_WHOLE: Final = ("picture", "picture_row", "picture_column")
_SAMPLED: Final = "sampling_error, model_error, and the noise of the picture"

PICTURES: Final[Mapping[str, Variable]] = {
    "brightness": Variable(
        dims=_WHOLE,
        units="1",
        long_name="mean of blocks of pixels over the brightest pixel; NaN beyond the picture",
        error=_SAMPLED,
    ),
    "detail": Variable(
        dims=("picture", "detail_row", "detail_column"),
        units="1",
        long_name="pixels in the middle of the picture over the brightest pixel; NaN beyond it",
        error=_SAMPLED,
    ),
    "true_depth": Variable(
        dims=_WHOLE,
        units="m",
        long_name="depth of the middle pixel of each block along the axis of the camera; infinite where it sees "
        "nothing, NaN where the pupil sends no light",
        error="that of the rays: rounding",
    ),
    "camera_of": Variable(dims=_OF, units="", long_name="camera that takes it"),
    "block": Variable(dims=_OF, units="px", long_name="side of the blocks of pixels", error="exact"),
    "columns": Variable(dims=_OF, units="px", long_name="width of the picture", error="exact"),
    "rows": Variable(dims=_OF, units="px", long_name="height of the picture", error="exact"),
    "pixel_pitch": Variable(dims=_OF, units="m", long_name="distance of its pixels", error="as declared"),
    "saturated": Variable(dims=_OF, units="1", long_name="pixels that are full", error="exact"),
    "sampling_error": Variable(
        dims=_OF,
        units="1",
        long_name="relative difference (root mean square) from a picture with 16 times the rays, noise apart; by waves "
        "also from twice as many computed spreads along each axis",
        error="an estimate of an error, from places all over the picture",
    ),
    "by_waves": Variable(dims=_OF, units="1", long_name="1 by waves, 0 by rays", error="exact"),
    "model_error": Variable(
        dims=_OF,
        units="1",
        long_name="by rays, relative change (L2) that leaving out diffraction makes; by waves, share of the light that "
        "is bent farther than it is followed",
        error="an estimate of an error: by rays from places all over the picture, with a margin of 30 %",
    ),
}
