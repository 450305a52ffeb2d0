"""/pictures: the cameras' pictures of the scene, reduced in size, with a full-size detail and the true depth."""

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
        long_name="mean of each block of pixels, relative to the brightest pixel; NaN outside a picture smaller than "
        "the largest",
        error=_SAMPLED,
    ),
    "detail": Variable(
        dims=("picture", "detail_row", "detail_column"),
        units="1",
        long_name="values of the pixels in the middle of the picture, relative to the brightest pixel; NaN "
        "outside a picture smaller than the largest",
        error=_SAMPLED,
    ),
    "true_depth": Variable(
        dims=_WHOLE,
        units="m",
        long_name="true depth of the middle pixel of each block, along the axis of the camera; infinite where "
        "the pixel sees nothing, NaN where no light reaches it through the pupil",
        error="rounding only",
    ),
    "camera_of": Variable(dims=_OF, units="", long_name="camera that takes the picture"),
    "block": Variable(dims=_OF, units="px", long_name="side of the square blocks of pixels", error="exact"),
    "columns": Variable(dims=_OF, units="px", long_name="number of columns of the picture", error="exact"),
    "rows": Variable(dims=_OF, units="px", long_name="number of rows of the picture", error="exact"),
    "pixel_pitch": Variable(dims=_OF, units="m", long_name="pixel pitch of the camera", error="none: declared"),
    "saturated": Variable(dims=_OF, units="1", long_name="number of saturated pixels", error="exact"),
    "sampling_error": Variable(
        dims=_OF,
        units="1",
        long_name="relative root-mean-square difference from a picture with 16 times as many rays, without "
        "noise; for a picture by waves, also from one with twice as many point-spread functions along each axis",
        error="itself an estimate, from places all over the picture",
    ),
    "by_waves": Variable(
        dims=_OF, units="1", long_name="whether the picture is rendered by waves (1) or by rays (0)", error="exact"
    ),
    "model_error": Variable(
        dims=_OF,
        units="1",
        long_name="for pictures by rays, the relative change, in the L2 norm, due to leaving out diffraction; "
        "for pictures by waves, the fraction of the light that is diffracted beyond the computed range",
        error="itself an estimate; by rays, it comes from places all over the picture and has a margin of 30 %",
    ),
}
