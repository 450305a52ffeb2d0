"""The keys of a study for a stereo rig imported from a calibration file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from tradestudy.cameras.imported import (
    NOMINAL_PITCH,
    ImportedCorners,
    ImportedRig,
    Stated,
    camera_stated,
    conventions_stated,
)

_ASSUMED_PITCH: Final = "3 um"


def stated_by(imported: ImportedRig | ImportedCorners) -> Iterator[Stated]:
    """Every value of a stereo rig from a calibration file, and the conventions by which the file was read."""
    yield Stated(path=("kind",), value="stereo", key=_first_key(imported), basis="derived")
    if isinstance(imported, ImportedCorners):
        yield from _of_corners(imported)
        return
    yield from _of_rig(imported)


def _first_key(imported: ImportedRig | ImportedCorners) -> str:
    return imported.key if isinstance(imported, ImportedCorners) else imported.keys["translation"]


def _of_rig(rig: ImportedRig) -> Iterator[Stated]:
    from scipy.spatial.transform import Rotation

    for side, camera in (("left", rig.left), ("right", rig.right)):
        yield from camera_stated(("geometry", side), camera)
    turn = Rotation.from_matrix(np.array(rig.rotation)).as_rotvec()
    rotation = [f"{float(angle)!r} rad" for angle in turn]
    yield Stated(path=("geometry", "rotation"), value=rotation, key=rig.keys["rotation"])
    moved = [f"{length!r} m" for length in rig.translation]
    yield Stated(path=("geometry", "translation"), value=moved, key=rig.keys["translation"])
    if (pixels := rig.left.pixels or rig.right.pixels) is not None:
        key = (rig.left if rig.left.pixels else rig.right).keys["pixels"]
        yield Stated(path=("sensor", "pixels"), value=list(pixels), key=key)
    yield _pitch(rig.keys["translation"])
    yield from conventions_stated(rig.conventions)
    said = [{(one.name, one.says) for one in camera.conventions} for camera in (rig.left, rig.right)]
    shared = said[0] & said[1]
    yield from conventions_stated(tuple(one for one in rig.left.conventions if (one.name, one.says) in shared))
    for side, camera in (("left", rig.left), ("right", rig.right)):
        own = tuple(one for one in camera.conventions if (one.name, one.says) not in shared)
        yield from conventions_stated(own, f"{side} ")


def _pitch(key: str) -> Stated:
    return Stated(path=("sensor", "pixel_pitch"), value=_ASSUMED_PITCH, key=key, basis="assumed", note=NOMINAL_PITCH)


def _of_corners(corners: ImportedCorners) -> Iterator[Stated]:
    """The design from a fit to the corners; the posterior from the same corners gives the geometry."""
    fitted = "from a fit to the corners"
    focal_length = Stated(
        path=("lenses", "focal_length"),
        value=f"{corners.focal_length!r} px",
        key=corners.key,
        basis="derived",
        note=fitted,
    )
    yield focal_length
    yield Stated(path=("baseline",), value=f"{corners.baseline!r} m", key=corners.key, basis="derived", note=fitted)
    yield Stated(
        path=("depth", "disparity_error"),
        value=f"{corners.noise * 2.0**0.5!r} px",
        key=corners.key,
        basis="assumed",
        note="assumes that matching is as precise as the corner detector: √2 times the fitted noise of one coordinate",
    )
    yield _pitch(corners.key)
    yield Stated(path=("calibration", "corners", "file"), value=corners.file, key=corners.key)
    yield from conventions_stated(corners.conventions)
