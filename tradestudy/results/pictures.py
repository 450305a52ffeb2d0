"""/pictures: the cameras' pictures of the scene, reduced in size, with a full-size detail and the true depth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import DECLARED, EXACT, Variable

_OF: Final = ("picture",)
_WHOLE: Final = ("picture", "picture_row", "picture_column")
_SAMPLED: Final = "see sampling_error and model_error; the picture also has noise"

PICTURES: Final[Mapping[str, Variable]] = {
    "brightness": Variable(
        dims=_WHOLE,
        units="1",
        long_name="mean value of a block of pixels, relative to the brightest pixel of the picture; NaN beyond the "
        "edge of pictures smaller than the largest",
        error=_SAMPLED,
    ),
    "detail": Variable(
        dims=("picture", "detail_row", "detail_column"),
        units="1",
        long_name="values of the pixels in a square around the middle of the picture, relative to the brightest pixel "
        "of the picture; NaN beyond the edge of pictures smaller than the square",
        error=_SAMPLED,
    ),
    "true_depth": Variable(
        dims=_WHOLE,
        units="m",
        long_name="true depth at the middle pixel of a block; infinite where the pixel sees no surface; NaN where "
        "no light reaches the pixel through the pupil and, in pictures smaller than the largest, beyond their edge",
        error="rounding only",
    ),
    "camera_of": Variable(dims=_OF, units="", long_name="camera that takes the picture"),
    "block": Variable(
        dims=_OF,
        units="px",
        long_name="side of the square blocks of pixels in 'brightness' and true_depth",
        error=EXACT,
    ),
    "columns": Variable(dims=_OF, units="px", long_name="number of columns of the whole picture", error=EXACT),
    "rows": Variable(dims=_OF, units="px", long_name="number of rows of the whole picture", error=EXACT),
    "pixel_pitch": Variable(dims=_OF, units="m", long_name="pixel pitch of the whole picture", error=DECLARED),
    "saturated": Variable(dims=_OF, units="1", long_name="number of saturated pixels", error=EXACT),
    "sampling_error": Variable(
        dims=_OF,
        units="1",
        long_name="root-mean-square difference between this picture and a finer one, both without noise, relative to "
        "the finer one; the finer picture has 16 times as many rays and, if rendered by waves, also twice as many "
        "point-spread functions along each axis",
        error="itself an error estimate, from places all over the picture",
    ),
    "by_waves": Variable(
        dims=_OF, units="1", long_name="whether the picture is rendered by waves rather than by rays", error=EXACT
    ),
    "model_error": Variable(
        dims=_OF,
        units="1",
        long_name="for a picture rendered by rays, the relative change that diffraction would cause, in the L2 norm; "
        "for a picture rendered by waves, the fraction of the light that diffraction spreads beyond the area over "
        "which point-spread functions are computed",
        error="itself an error estimate; for a picture rendered by rays, from places all over it, with a margin of "
        "30 %",
    ),
}
