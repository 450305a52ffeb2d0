"""Two imported cameras side by side: which is left, how far apart, and the mix-ups that the numbers reveal."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, ImportedCamera, ImportedRig
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.conversions import rotation_tuple, vector_tuple
from tradestudy.study.camera_files.located import Located
from tradestudy.units import LENGTH, pretty

_SHORTEST, _LONGEST = 5e-4, 20.0  # baselines [m] between which no factor of 1000 hides
_QUARTER: Final = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_LARGEST_TANGENTIAL: Final = 0.05
"""p1 and p2 of real lenses are below a hundredth: a slope of 1 would be shifted by a tenth."""


def paired(
    first: ImportedCamera,
    second: ImportedCamera,
    rotation: FloatArray,
    translation: FloatArray,
    *,
    where: tuple[Located, Located],
    conventions: tuple[Convention, ...],
) -> ImportedRig:
    """The pair of two cameras.

    Parameters
    ----------
    first, second
        Left and right, or upper and lower.
    rotation, translation
        From the first camera to the second one, ``x₂ = R x₁ + t`` [m].
    where
        Where these two stand.
    conventions
        How the files were read.

    Raises
    ------
    CameraFileError
        The cameras stand one behind the other or in one place, are exchanged, or so far apart that their unit of
        length must be another one; their pictures differ in size.
    """
    at = where[1]
    if first.pixels is not None and second.pixels is not None and first.pixels != second.pixels:
        sizes = " and ".join(f"{columns} × {rows}" for columns, rows in (first.pixels, second.pixels))
        raise at.fail(f"the pictures of the two cameras differ in size: {sizes} px; equal ones are expected")
    x, y, z = (float(one) for one in translation)
    baseline = float(np.linalg.norm(translation))
    if not baseline > 0.0:
        raise at.fail("the second camera stands where the first one does: there is no baseline")
    if not _SHORTEST <= baseline <= _LONGEST:
        units = ("metres", "millimetres") if baseline > _LONGEST else ("millimetres", "metres")
        raise at.fail(
            f"the baseline would be {pretty(baseline, LENGTH)}: {units[0]} taken for {units[1]}? Then say length_unit: "
            f"{'mm' if baseline > _LONGEST else 'm'} beside from:"
        )
    if abs(z) >= max(abs(x), abs(y)):
        raise at.fail("the cameras stand one behind the other; a pair side by side is expected")
    is_vertical = abs(y) > abs(x)
    if (y if is_vertical else x) > 0.0:
        apart = pretty(baseline, LENGTH)
        side, both = ("above", "upper and lower") if is_vertical else ("to the left of", "left and right")
        raise at.fail(
            f"{second.name} stands {apart} {side} {first.name}: {both} are exchanged; exchange the files of from:, "
            "the names of pair:, or the cameras in the file"
        )
    key = at.key
    order = "upper, lower: both pictures are taken turned by 90°" if is_vertical else "left, right"
    told = (*conventions, Convention(name="order of cameras", says=f"{first.name}, {second.name} are {order}", key=key))
    if is_vertical:
        first, second = _turned(first, at), _turned(second, at)
        rotation, translation = _QUARTER @ rotation @ _QUARTER.T, _QUARTER @ translation
    return ImportedRig(
        left=first,
        right=second,
        rotation=rotation_tuple(rotation),
        translation=vector_tuple(translation),
        conventions=told,
        keys={"rotation": where[0].key, "translation": key},
    )


def check_lens(camera: ImportedCamera, value: Located) -> ImportedCamera:
    """The camera, unless its coefficients cannot be those of the model that they are called.

    Raises
    ------
    CameraFileError
        A fisheye lens under the name of a pinhole one.
    """
    if camera.lens_model != "rational":
        return camera
    for name in ("p1", "p2"):
        shift = camera.coefficients.get(name, 0.0)
        if abs(shift) > _LARGEST_TANGENTIAL:
            raise value.fail(
                f"{name} = {shift:g} is no tangential distortion (real ones are below {_LARGEST_TANGENTIAL:g}): these "
                "seem to be k1 to k4 of a fisheye lens under the name of a pinhole one; if so, call the model "
                "equidistant in the file, or say lens_model: fisheye beside from:"
            )
    return camera


def _turned(camera: ImportedCamera, at: Located) -> ImportedCamera:
    """A camera whose pictures are turned by a quarter, so that what was below is to the right.

    Radial coefficients stay; (p2, p1) and (s1, s3), (s2, s4) turn with the picture.
    """
    if camera.pixels is None:
        raise at.fail("a vertical pair is read turned by 90°, and the file does not state the size of its pictures")
    if any(camera.coefficients.get(name, 0.0) for name in ("tau_x", "tau_y")):
        raise at.fail("a vertical pair with a tilted sensor (tau_x, tau_y) is not supported")
    columns, rows = camera.pixels
    (fx, fy), (cx, cy), old = camera.focal_lengths, camera.centre, camera.coefficients
    turned = dict(old)
    for across, down in (("p2", "p1"), ("s1", "s3"), ("s2", "s4")):
        if across in old or down in old:
            turned[across], turned[down] = old.get(down, 0.0), -old.get(across, 0.0)
    return replace(
        camera, focal_lengths=(fy, fx), centre=(cy, columns - 1 - cx), pixels=(rows, columns), coefficients=turned
    )
