"""What a calibration file says of cameras, whatever its format: pixels, slopes and metres, and how it was read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

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
"""The families of `optics.lens_models`, by their names, and two that no camera here can have."""
Vector = tuple[float, float, float]
Rotation = tuple[Vector, Vector, Vector]
Value = str | float | Sequence["Value"]


@dataclass(frozen=True, kw_only=True)
class Convention:
    """How something that numbers alone do not say was read.

    Parameters
    ----------
    name
        What, such as "direction of transforms".
    says
        How.
    key
        File and key that say so, such as "camchain.yaml: cam1.T_cn_cnm1".
    is_assumed
        Whether neither the file nor the definition of its format says so.
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
        Keys of the camera, from the outside.
    value
        As a study file could hold it, with its unit.
    key
        File and key that it comes from.
    basis, note
        On what it rests.
    """

    path: tuple[str, ...]
    value: Value
    key: str
    basis: Literal["measured", "derived", "assumed"] = "measured"
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class ImportedCamera:
    """One camera of a calibration file.

    Parameters
    ----------
    name
        As the file calls it, for messages.
    focal_lengths, centre
        Across and down, and where the axis meets the picture; the centre of the first pixel is (0, 0) [px].
    pixels
        Columns and rows; None where the file does not say.
    lens_model, coefficients
        From slopes to the distorted slopes that the focal lengths multiply; coefficients by their usual names
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
    """Two cameras of calibration files, and where the second one stands.

    Parameters
    ----------
    left, right
        As seen from behind.
    rotation, translation
        From the frame of the left camera to that of the right one, ``x_right = R x_left + t`` [1, m].
    conventions
        How the files were read, beyond those of either camera.
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
        Mean of all focal lengths, and the deviation of one image coordinate of a corner [px].
    baseline
        [m].
    conventions
        How the file was read.
    key
        The file, for the register.
    """

    file: str
    focal_length: float
    noise: float
    baseline: float
    conventions: tuple[Convention, ...]
    key: str


@dataclass(frozen=True, kw_only=True)
class ImportedPlenoptic:
    """A focused plenoptic camera of a calibration file.

    Parameters
    ----------
    focal_length, f_number
        Of the main lens [m, 1].
    pixels, pixel_pitch
        Of the sensor [m].
    layout, pitch, focal_lengths
        Of the microlens array [m].
    gap, mla_distance
        Array to sensor d, and main lens to array D [m].
    conventions
        How the file was read.
    keys
        File and key of each of these by its name.
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
    conventions: tuple[Convention, ...]
    keys: Mapping[str, str]


Imported = ImportedCamera | ImportedRig | ImportedCorners | ImportedPlenoptic


def conventions_stated(conventions: tuple[Convention, ...], prefix: str = "") -> Iterator[Stated]:
    """How a file was read, for the register of assumptions."""
    for one in conventions:
        yield Stated(
            path=("read_as", f"{prefix}{one.name}"),
            value=one.says,
            key=one.key,
            basis="assumed" if one.is_assumed else "derived",
        )
