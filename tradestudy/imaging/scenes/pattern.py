"""Patterns on surfaces: a random texture or a picture, prefiltered so that few samples suffice without aliasing.

Each level of a pattern has half as many samples along each axis as the one below; each sample is the mean of four. With
interpolation, level l has a filter of variance ``(3·4^l − 1)/12`` along each axis, in samples of the finest level; two
levels are mixed to obtain the requested variance.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import Texture, texture_spectrum
from tradestudy.optics.arrays import FloatArray
from tradestudy.provenance import require_regular_file
from tradestudy.uncertainty.streams import point_generator

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

MOST_PIXELS: Final = 100_000_000
"""Largest number of pixels of a picture or depth map, and of numbers in an array: 0.8 GB in double precision."""
LARGEST_VALUE: Final = 1e12
"""Largest brightness or depth of a file: squares of depths are computed in single precision."""
_ORIENTATION: Final = 0x0112  # tag of EXIF and TIFF
_BITS: Final = 0x0102  # tag of TIFF, bits of each sample
_ZERO: Final = 0x0106  # tag of TIFF, 0 if zero is white
_PNG_BITS: Final = 24  # byte of a PNG file that gives the bits of each sample
_FORMATS: Final = ("PNG", "TIFF", "JPEG", "BMP", "GIF", "WEBP", "PPM")  # of others, the library may scale the samples
_NOT_RGB: Final = ("CMYK", "YCbCr", "LAB", "HSV")
_OPAQUE: Final = {"P": "RGB", "PA": "RGB", "RGBA": "RGB", "RGBa": "RGB", "RGBX": "RGB", "LA": "L", "La": "L"}
"""Modes without palette and alpha."""


def read_picture(file: Path) -> FloatArray:
    """Brightness in one or three colours, shape (colours, rows, columns); the values of the file are linear.

    Raises
    ------
    OutOfRangeError
        The file is not a picture, has several pages, transparent pixels, an orientation, colours other than grey and
        RGB or of more than 8 bits, or white as zero, or is black.
    """
    values = _values(file)
    if values.ndim == 3 and values.shape[-1] == 3:
        values = np.moveaxis(values, -1, 0)
    elif values.ndim == 2:
        values = values[None]
    if values.ndim != 3 or values.shape[0] not in (1, 3):
        raise OutOfRangeError(
            "shape of a picture", value=f"{values.shape} in {file}", limit="grey, or red, green, blue"
        )
    if not (np.all(np.isfinite(values)) and np.all(values >= 0.0) and values.mean() > 0.0):
        raise OutOfRangeError("brightness of a picture", value=str(file), limit="0 or more, and not 0 everywhere")
    return np.asarray(values, np.float32)


def read_depths(file: Path, unit: float) -> FloatArray:
    """Depths [m], shape (rows, columns), of a map whose values are in a unit [m].

    Raises
    ------
    OutOfRangeError
        The file is not a depth map, has several pages, transparent pixels, an orientation, fewer than 8 bits or white
        as zero, is compressed as JPEG, or has holes.
    """
    values = _values(file, least_bits=8)
    if values.ndim != 2 or min(values.shape) < 2:
        raise OutOfRangeError(
            "shape of a depth map", value=f"{values.shape} in {file}", limit="2 × 2 pixels or more, one value each"
        )
    holes = int(np.count_nonzero(~(np.isfinite(values) & (values > 0.0))))
    if holes:
        raise OutOfRangeError(
            "depths that are not above zero",
            value=f"{holes} pixels of {file}",
            limit="none",
            remedy="fill the holes of the map",
        )
    return np.asarray(values * unit)


def _values(file: Path, least_bits: int = 1) -> FloatArray:
    try:
        require_regular_file(file)
        values = _array(file) if file.suffix.lower() == ".npy" else _image(file, least_bits)
    except OutOfRangeError:
        raise
    except Exception as error:  # damaged files make the libraries raise errors of any kind
        raise OutOfRangeError(
            "a file that cannot be read",
            value=f"{file}: {getattr(error, 'strerror', None) or error}",
            limit="PNG, TIFF, PGM, PPM, PFM or NPY, or a picture in JPEG, BMP, GIF or WebP",
        ) from error
    largest = float(np.max(values[np.isfinite(values)], initial=0.0))
    if largest > LARGEST_VALUE:
        raise OutOfRangeError(
            "a value of a picture or depth map", value=f"{largest:g} in {file}", limit=f"{LARGEST_VALUE:g}"
        )
    return values


def _array(file: Path) -> FloatArray:
    """The numbers of an NPY file, of which only the header is read before its size and type are known."""
    array = np.load(file, mmap_mode="r", allow_pickle=False)
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        kind = array.dtype if isinstance(array, np.ndarray) else "an archive"
        raise OutOfRangeError("the type of an array", value=f"{kind} in {file}", limit="real numbers")
    _require_size(file, array.size)
    return np.array(array, np.float64)


def _image(file: Path, least_bits: int) -> FloatArray:
    from PIL import Image

    # The library warns of invalid tags, which do not matter (invalid pixels raise an error), and of large pictures.
    with warnings.catch_warnings(action="ignore"), Image.open(file, formats=_FORMATS) as picture:
        _require_size(file, picture.width * picture.height)
        tags = getattr(picture, "tag_v2", {})
        largest, full = _scaled_from(picture), 65535 if picture.mode == "I" else 255
        bits = largest.bit_length() if largest > full else _stored_bits(picture, tags, file)
        scale = picture.info.get("scale", 1.0) if picture.format == "PPM" else 1.0
        pages, turn = getattr(picture, "n_frames", 1), picture.getexif().get(_ORIENTATION, 1)
        # A transparent colour of 16 bits is lost in conversion.
        alpha = 0 if "transparency" in picture.info else 255
        alpha = int(np.asarray(picture.convert("RGBA"))[..., 3].min()) if picture.mode in _OPAQUE else alpha
        for is_refused, what, value, limit, remedy in (
            (pages > 1, "pages of a picture or depth map", pages, "1", "save the page that is meant as its own file"),
            (turn not in (0, 1), "EXIF orientation", turn, "1, upright", "turn the pixels, and save without the tag"),
            (alpha < 255, "opacity (alpha)", f"down to {alpha}", "255 everywhere", "save it without transparency"),
            (picture.mode in _NOT_RGB, "colours", picture.mode, "grey, or red, green, blue", "convert it to RGB"),
            (tags.get(_ZERO) == 0, "zero", "white (TIFF WhiteIsZero)", "black", "save it with black as zero"),
            # The library keeps only 8 bits of colours, and scales fewer bits of grey to the range of 8.
            (
                bits > 8 and not picture.mode.startswith(("I", "F")),
                "bits of each colour",
                bits,
                "8",
                "convert to 16-bit grey or 8-bit colour",
            ),
            (bits < least_bits, "bits of each depth", bits, "8 or 16", "save the map with 8 or 16 bits"),
            (
                least_bits > 1 and "jpeg" in (str(picture.format).lower(), picture.info.get("compression")),
                "compression of a depth map",
                "JPEG",
                "one that keeps every value",
                "export the map anew as PNG, TIFF or NPY",
            ),
            (
                scale != 1.0,
                "scale of a PFM file",
                f"{scale:g}",
                "1 or −1",
                "multiply the values by it, and write 1 or −1",
            ),
        ):
            if is_refused:
                raise OutOfRangeError(what, value=f"{value} in {file}", limit=limit, remedy=remedy)
        values = np.asarray(picture.convert(_OPAQUE.get(picture.mode, picture.mode)), np.float64)
        # The library scales the largest value that the file declares to that of 8 or 16 bits, and rounds.
        return np.round(values * largest / full) if largest else values


def _scaled_from(picture: ImageFile) -> int:
    """The largest value that a PGM or PPM file declares, from which the library scales; 0 if it does not scale."""
    arguments = picture.tile[0][3] if picture.format == "PPM" else None
    return int(arguments[1]) if isinstance(arguments, tuple) and arguments[0] in ("L", "RGB") else 0


def _stored_bits(picture: ImageFile, tags: Mapping[int, Any], file: Path) -> int:
    """Bits of each sample in a PNG, TIFF or Netpbm file; 8 in other files."""
    if picture.format == "TIFF":
        return int(max(tags.get(_BITS, (1,))))
    if picture.format == "PNG":
        with file.open("rb") as stream:
            return stream.read(_PNG_BITS + 1)[_PNG_BITS]
    return 1 if picture.mode == "1" else 8


def _require_size(file: Path, pixels: int) -> None:
    if not 0 < pixels <= MOST_PIXELS:
        raise OutOfRangeError(
            "the size of a picture or depth map",
            value=f"{pixels:,} values in {file}",
            limit=f"1 to {MOST_PIXELS:,}",
            remedy="reduce its resolution, or crop it",
        )


MOST_CONTRAST: Final = 0.3
"""At this contrast, a Gaussian texture is black at three standard deviations below its mean."""
GREY: Final = -1
"""The colour of a pixel without a filter; 0, 1 and 2 are red, green and blue."""


@dataclass(frozen=True, kw_only=True)
class RandomPattern:
    """A random texture of mean 1 that repeats periodically.

    Parameters
    ----------
    texture
        Its contrast and correlation length.
    sample
        Distance between neighbouring samples [m].
    side
        Samples along each side before it repeats; a power of two.
    seed
        Seed of the study.

    Raises
    ------
    OutOfRangeError
        The contrast is so high that a Gaussian texture would become darker than black.
    """

    texture: Texture
    sample: float
    side: int
    seed: int

    def __post_init__(self) -> None:
        if self.texture.contrast > MOST_CONTRAST:
            raise OutOfRangeError(
                "contrast of a Gaussian texture, which would become darker than black in places",
                value=f"{100 * self.texture.contrast:g} %",
                limit=f"at most {100 * MOST_CONTRAST:g} %",
                remedy="reduce the contrast of scene.picture.texture, or use a picture instead of the texture",
            )

    def build(self) -> Pattern:
        """The pattern with all its levels; cached per process."""
        return _random_pattern(self)


@dataclass(frozen=True, kw_only=True)
class PicturePattern:
    """A picture as a pattern, normalised to a mean brightness of 1.

    Parameters
    ----------
    file
        Path of the picture.
    sha256
        Hash of its content.
    sample
        Size of one of its pixels on the surface; 1 if the surface is given by a depth map.
    from_top
        Whether its first row is the top one.
    """

    file: Path
    sha256: str
    sample: float
    from_top: bool

    def build(self) -> Pattern:
        """The pattern with all its levels; cached per process."""
        return _picture_pattern(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pattern:
    """A pattern with all its levels.

    Parameters
    ----------
    values
        All levels concatenated for each colour, shape (colours, samples): grey alone, or red, green, blue and grey.
        Each level repeats its first row and column after its last, so that every sample has a successor.
    columns, rows
        Size of the finest level; powers of two.
    sample
        Distance between its samples.
    """

    values: NDArray[np.float32]
    columns: int
    rows: int
    sample: float

    @property
    def levels(self) -> int:
        """Number of levels."""
        return int(math.log2(min(self.columns, self.rows))) + 1

    def mixture(self, variance: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """The level and the weight of the next one that give a filter with this variance along each axis."""
        required = np.maximum(variance * (4.0 / self.sample**2) + 1.0 / 3.0, 1.0)
        _, exponent = np.frexp(required)
        level = np.minimum((exponent - 1) >> 1, self.levels - 2).astype(np.intp)
        scale = np.ldexp(np.ones_like(required), 2 * level)
        return level, np.clip((required / scale - 1.0) / 3.0, 0.0, 1.0).astype(np.float32)

    def brightness(
        self,
        x: FloatArray,
        y: FloatArray,
        level: NDArray[np.intp],
        share: FloatArray,
        color: NDArray[np.intp] | int = GREY,
    ) -> FloatArray:
        """Brightness at places, in the unit of ``sample``, filtered as `mixture` returned for them."""
        scale = np.ldexp(np.float32(1.0 / self.sample), -level)
        start = color % self.values.shape[0] * self.values.shape[1]
        x, y = x * scale, y * scale
        fine = self._level(x, y, level, start)
        coarse = self._level(x * np.float32(0.5), y * np.float32(0.5), level + 1, start)
        return fine + share * (coarse - fine)

    def _level(
        self, x: FloatArray, y: FloatArray, level: NDArray[np.intp], start: NDArray[np.intp] | int
    ) -> FloatArray:
        """Interpolate bilinearly between the samples of one level, whose centres are half a sample from the origin."""
        x, y = x - np.float32(0.5), y - np.float32(0.5)
        left, top = np.floor(x), np.floor(y)
        x -= left
        y -= top
        columns = self.columns >> level
        first, row = left.astype(np.intp), top.astype(np.intp)
        first &= columns - 1  # sizes are powers of two: the mask wraps positions around
        row &= (self.rows >> level) - 1
        columns += 1
        row *= columns
        first += row
        first += _starts(self.columns, self.rows)[level]
        first += start
        return between_samples(self.values, first, columns, x, y)


def between_samples(
    values: NDArray[np.float32], first: NDArray[np.intp], columns: NDArray[np.intp] | int, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Interpolate bilinearly in a flattened grid.

    Parameters
    ----------
    values
        The grid, of any shape.
    first
        Index of the sample before each place in both directions; changed in place.
    columns
        Samples in a row.
    x, y
        Place between this sample and the next one along a row and a column, from 0 to 1.
    """
    values = values.reshape(-1)
    a, b = values.take(first, mode="clip"), values.take(first + 1, mode="clip")
    first += columns
    c, d = values.take(first, mode="clip"), values.take(first + 1, mode="clip")
    a += x * (b - a)
    c += x * (d - c)
    return np.asarray(a + y * (c - a))


@lru_cache(maxsize=64)
def _starts(columns: int, rows: int) -> NDArray[np.intp]:
    """Start index of each level."""
    sizes = [((columns >> k) + 1) * ((rows >> k) + 1) for k in range(int(math.log2(min(columns, rows))) + 1)]
    return np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.intp)


def pattern_of(finest: FloatArray, sample: float) -> Pattern:
    """Build all levels from samples of shape (colours, rows, columns); rows and columns are powers of two."""
    levels: list[NDArray[np.float32]] = [finest.astype(np.float32)]
    while min(levels[-1].shape[1:]) > 1:
        last = levels[-1]
        levels.append(
            (last[:, ::2, ::2] + last[:, 1::2, ::2] + last[:, ::2, 1::2] + last[:, 1::2, 1::2]) / np.float32(4)
        )
    # Then every sample has a successor along both axes.
    padded = [np.pad(level, ((0, 0), (0, 1), (0, 1)), mode="wrap") for level in levels]
    values = np.concatenate([level.reshape(level.shape[0], -1) for level in padded], axis=1)
    return Pattern(values=values, columns=finest.shape[2], rows=finest.shape[1], sample=sample)


@lru_cache(maxsize=4)
def _random_pattern(settings: RandomPattern) -> Pattern:
    """Gaussian noise filtered by the root of the texture's spectrum; each sample is the mean over its square."""
    from scipy import fft

    side, sample, texture = settings.side, settings.sample, settings.texture
    rng = point_generator(seed=settings.seed, point="texture", replicate=0)
    across, down = fft.rfftfreq(side).astype(np.float32), fft.fftfreq(side).astype(np.float32)
    frequency = np.hypot(across[None, :], down[:, None])
    power = texture_spectrum(frequency, texture.contrast, texture.correlation_length / sample)
    amplitude = np.sqrt(power).astype(np.float32) * np.sinc(across)[None, :] * np.sinc(down)[:, None]
    amplitude[0, 0] = 0.0  # the mean is 1
    spectrum = fft.rfft2(rng.standard_normal((side, side), dtype=np.float32), workers=-1) * amplitude
    noise = fft.irfft2(spectrum, s=(side, side), workers=-1)
    return pattern_of(np.maximum(1.0 + noise, 0.0)[None], sample)


@lru_cache(maxsize=4)
def _picture_pattern(settings: PicturePattern) -> Pattern:
    """A picture padded to powers of two by repeating its edges."""
    picture = read_picture(settings.file)
    picture = picture / picture.mean()
    picture = picture if settings.from_top else picture[:, ::-1]
    if len(picture) == 3:
        picture = np.concatenate([picture, picture.mean(axis=0, keepdims=True)])
    rows, columns = (2 ** math.ceil(math.log2(max(size, 2))) for size in picture.shape[1:])
    padding = ((0, 0), (0, rows - picture.shape[1]), (0, columns - picture.shape[2]))
    return pattern_of(np.pad(picture, padding, mode="edge"), settings.sample)
