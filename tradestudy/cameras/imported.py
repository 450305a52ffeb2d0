"""The contents of calibration files in any format: cameras in pixels, slopes and metres, and how they were read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from tradestudy.optics.lens_families import ANGLES

LensModelName = Literal[
    "rational",
    "kannala-brandt",
    "fov",
    "omni",
    "double-sphere",
    "eucm",
    "stereographic",
    "longitude-latitude",
]
"""Names of the families of `optics.lens_families`, and of two that the program does not model."""
Vector = tuple[float, float, float]
Rotation = tuple[Vector, Vector, Vector]
Value = str | float | Sequence["Value"]

NOMINAL_PITCH: Final = (
    "nominal: depth depends only on its ratio to the focal length, but blur and diffraction need the true value"
)
"""Note on a pixel pitch that no calibration file gives."""
CATALOGUE: Final = "catalogue"
PICTURE_SIZE: Final = "size of pictures"
"""Name of the convention that states the size of the calibrated pictures as taken, and as rotated if they are."""
RIGHT_SIZE: Final = "size of right pictures"
"""Name of the convention that states the size of the right pictures, if it is another one."""
FITTED_LENS: Final = "fitted lens model"
"""Name of the convention that states the lens model of a fit to corners."""


@dataclass(frozen=True, kw_only=True)
class Convention:
    """How to interpret something that numbers alone do not determine.

    Parameters
    ----------
    name
        The subject, such as "direction of transforms".
    says
        The interpretation.
    key
        File and key that determine it, such as "camchain.yaml: cam1.T_cn_cnm1".
    is_assumed
        Whether neither the file nor the definition of its format determines it.
    """

    name: str
    says: str
    key: str
    is_assumed: bool = False


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A value of a study's camera that comes from a calibration file.

    Parameters
    ----------
    path
        Keys in the camera's declaration, outermost first.
    value
        The value as written in a study file, with its unit; None if the file does not give it and the study has to.
    key
        File and key that it comes from.
    basis, note
        What it rests on.
    instead
        Keys beside a value that the study has to give, any of which it may give instead.
    """

    path: tuple[str, ...]
    value: Value | None
    key: str
    basis: Literal["measured", "derived", "assumed"] = "measured"
    note: str = ""
    instead: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ImportedCamera:
    """One camera from a calibration file.

    Parameters
    ----------
    name
        Name of the camera in the file, for messages.
    focal_lengths, centre
        Focal lengths across and down, and the principal point; the centre of the first pixel is (0, 0) [px].
    pixels
        Columns and rows; None if the file does not state them.
    lens_model, coefficients
        The model maps slopes to the distorted slopes that the focal lengths multiply; coefficients by their usual names
        (k1 … k6, p1, p2, s1 … s4, tau_x, tau_y; xi; alpha; beta; w) [1], in radians where they are angles.
    conventions
        How the file was read.
    keys
        File and key of ``focal_lengths``, ``centre``, ``pixels`` and ``coefficients``.
    """

    name: str
    focal_lengths: tuple[float, float]
    centre: tuple[float, float]
    pixels: tuple[int, int] | None
    lens_model: LensModelName
    coefficients: Mapping[str, float]
    conventions: tuple[Convention, ...]
    keys: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class ImportedRig:
    """Two cameras from calibration files, and their relative pose.

    Parameters
    ----------
    left, right
        The cameras; left and right as seen from behind them.
    rotation, translation
        From the frame of the left camera to that of the right one, ``x_right = R x_left + t`` [1, m].
    conventions
        How the files were read, in addition to the conventions of each camera.
    keys
        File and key of ``rotation`` and ``translation``.
    """

    left: ImportedCamera
    right: ImportedCamera
    rotation: Rotation
    translation: Vector
    conventions: tuple[Convention, ...]
    keys: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class ImportedCorners:
    """A pair fitted to the corners of a board.

    Parameters
    ----------
    file
        Name of the corner file.
    focal_length, noise
        Mean of all focal lengths, and the standard deviation of one image coordinate of a corner [px].
    baseline
        Distance between the centres of projection [m].
    conventions
        How the file was read.
    key
        The file, as named in the register of assumptions.
    """

    file: str
    focal_length: float
    noise: float
    baseline: float
    conventions: tuple[Convention, ...]
    key: str


@dataclass(frozen=True, kw_only=True)
class ImportedPlenoptic:
    """A focused plenoptic camera from a calibration file.

    Parameters
    ----------
    focal_length, f_number
        The main lens [m, 1].
    pixels, pixel_pitch
        The sensor [m].
    layout, pitch, focal_lengths
        The microlens array [m]; no focal lengths for pinholes.
    gap, mla_distance
        Distances d from array to sensor and D from main lens to array [m].
    scaling
        Coefficients of metric depth ``a Z² + b Z + c`` [1/m, 1, m]; None if the file has none.
    known
        Known values of the calibration, in SI, by the names of a plenoptic camera's errors.
    conventions
        How the file was read.
    keys
        File and key of each of these values, by name.
    """

    focal_length: float
    f_number: float
    pixels: tuple[int, int]
    pixel_pitch: float
    layout: Literal["hexagonal", "square"]
    pitch: float
    focal_lengths: tuple[float, ...]
    gap: float
    mla_distance: float
    scaling: tuple[float, float, float] | None
    known: Mapping[str, float]
    conventions: tuple[Convention, ...]
    keys: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class ImportedParts:
    """A plenoptic camera from a file that may lack some of its optics.

    Parameters
    ----------
    pixels
        Columns and rows; None if the file does not state them.
    values
        What the file states, and what the study has to give.
    conventions
        How the file was read.
    keys
        File and key of the whole camera (``camera``) and, if given, of ``pixels``.
    """

    pixels: tuple[int, int] | None
    values: tuple[Stated, ...]
    conventions: tuple[Convention, ...]
    keys: Mapping[str, str]

    def stated(self, kind: str) -> Iterator[Stated]:
        """Everything that a camera of this kind states."""
        key = self.keys["camera"]
        yield Stated(path=("kind",), value=kind, key=key, basis="derived")
        yield from (*self.values, *asked_of_depth(key), *conventions_stated(self.conventions))


class ImportedFocused(ImportedParts):
    """Parts of a focused plenoptic camera."""


class ImportedUnfocused(ImportedParts):
    """Parts of an unfocused plenoptic camera."""


Imported = ImportedCamera | ImportedRig | ImportedCorners | ImportedPlenoptic | ImportedParts


def asked_of_depth(key: str) -> Iterator[Stated]:
    """How depth is measured, which no file of a plenoptic camera says."""
    for name in ("estimator", "disparity_error"):
        yield Stated(path=("depth", name), value=None, key=key)


def size_words(pixels: tuple[int, int]) -> str:
    """A size of pictures in words."""
    return f"{pixels[0]} × {pixels[1]} px"


def camera_stated(where: tuple[str, ...], camera: ImportedCamera) -> Iterator[Stated]:
    """The geometry of one camera, below the keys ``where``."""
    keys = camera.keys
    yield Stated(
        path=(*where, "focal_length"), value=[f"{f!r} px" for f in camera.focal_lengths], key=keys["focal_lengths"]
    )
    yield Stated(path=(*where, "principal_point"), value=[f"{c!r} px" for c in camera.centre], key=keys["centre"])
    where, key = (*where, "distortion"), keys["coefficients"]
    yield Stated(path=(*where, "model"), value=camera.lens_model, key=key, basis="derived")
    for name, value in camera.coefficients.items():
        yield Stated(path=(*where, name), value=f"{value!r} rad" if name in ANGLES else value, key=key)


def conventions_stated(conventions: tuple[Convention, ...], prefix: str = "") -> Iterator[Stated]:
    """The conventions by which a file was read, for the register of assumptions."""
    for convention in conventions:
        yield Stated(
            path=("read_as", f"{prefix}{convention.name}"),
            value=convention.says,
            key=convention.key,
            basis="assumed" if convention.is_assumed else "derived",
        )
