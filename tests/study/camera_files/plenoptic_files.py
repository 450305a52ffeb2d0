"""Made-up plenoptic cameras in the files of Lytro, Raytrix and PlenoptiSign, by their definitions."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

DEPTH = "depth: {estimator: outermost-views, disparity_error: 0.1 px}"
OPTICS = (
    "main_lens: {focal_length: 100 mm, f_number: 6.25}, sensor: {pixels: [4000, 3000], pixel_pitch: 5.5 um}, "
    "focus: {mla_distance: 110 mm}, depth: {estimator: widest-pair, disparity_error: 0.2 px}"
)


def lytro_metadata(
    *,
    image: Mapping[str, Any] | None = None,
    lens: Mapping[str, Any] | None = None,
    mla: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The metadata of one frame, with some values changed."""
    return {
        "image": {"width": 4000, "height": 3000, "orientation": 1, "originOnSensor": {"x": 0, "y": 0}, **(image or {})},
        "devices": {
            "clock": {"zuluTime": "2015-01-01T00:00:00.000Z"},
            "sensor": {"pixelPitch": 1.5e-06, "pixelWidth": 4000, "pixelHeight": 3000},
            "lens": {
                "fNumber": 2.5,
                "focalLength": 0.02,
                "infinityLambda": 16.0,
                "zoomStep": -3,
                "focusStep": 300,
                "exitPupilOffset": {"z": 0.08},
                **(lens or {}),
            },
            "mla": {
                "tiling": "hexUniformRowMajor",
                "lensPitch": 2e-05,
                "rotation": 2e-3,
                "scaleFactor": {"x": 1.0, "y": 1.0},
                "sensorOffset": {"x": 8e-06, "y": -1e-06, "z": 4e-05},
                **(mla or {}),
            },
        },
    }


def lytro(path: Path, **changed: Mapping[str, Any]) -> Path:
    path.write_text(json.dumps(lytro_metadata(**changed), indent=1))
    return path


def section(kind: bytes, content: bytes, digest: str = "") -> bytes:
    """A section of a container: type, version, length, SHA-1 in 80 bytes, content, and zeros up to 16 bytes."""
    head = b"\x89LF" + kind + b"\r\n\x1a\n" + (kind == b"P").to_bytes(4, "big") + len(content).to_bytes(4, "big")
    if not content:
        return head
    digest = digest or hashlib.sha1(content).hexdigest()
    return head + f"sha1-{digest}".encode().ljust(80, b"\0") + content + b"\0" * (-len(content) % 16)


def container(path: Path, *frames: bytes) -> Path:
    """A picture with sections of contents, pixels and the metadata of frames."""
    frames = frames or (json.dumps(lytro_metadata()).encode(),)
    contents = b'{"frames": [{"frame": {"metadataRef": "sha1-0"}}]}'
    pixels = bytes(range(1, 256)) * 40
    path.write_bytes(
        section(b"P", b"")
        + section(b"M", contents)
        + section(b"C", pixels)
        + b"".join(section(b"C", f) for f in frames)
    )
    return path


def plenoptisign(path: Path, **changed: object) -> Path:
    """Focused at 1 m from the first principal plane: a = 1000, b = 50 · 1000/950, df = a + b + HH."""
    says = {
        **{"pp": 0.005, "fs": 1.0, "hh": 0.2, "pm": 0.1, "dA": 80.0, "fU": 50.0, "HH": -10.0},
        **{
            "df": 1000.0 + 50e3 / 950.0 - 10.0,
            "f_num": 10.0,
            "a": 1.0,
            "M": 20.0,
            "G": -6,
            "dx": 4.0,
            "sd": [10.0, 15.0],
        },
        **changed,
    }
    path.write_text(json.dumps(says))
    return path


RAYTRIX = """\
<?xml version="1.0"?>
<RayCalibData version="1.0">
\t<offset units="pix"><x>0</x><y>0</y></offset>
\t<diameter units="pix">24</diameter>
\t<rotation units="rad">2e-003</rotation>
\t<lens_border units="pix">1</lens_border>
\t<tcp units="virtual_depth">2.1</tcp>
\t<lens_base_x units="lens"><x>1</x><y>0</y></lens_base_x>
\t<lens_base_y units="lens"><x>0.5</x><y>0.8660254</y></lens_base_y>
\t<sub_grid_base units="lens"><x>3</x><y>1.7320508</y></sub_grid_base>
\t<distortion type="radial">
\t\t<function>constant</function><parameter count="0">0</parameter><offset units="pix"><x>0</x><y>0</y></offset>
\t</distortion>
TYPES</RayCalibData>
"""
_TYPE = """\
\t<lens_type id="{0}">
\t\t<offset units="lens"><x>{0}</x><y>0</y></offset>
\t\t<depth_range units="virtual_depth"><min>1</min><max>3</max></depth_range>
\t</lens_type>
"""


def raytrix(path: Path, *changes: tuple[str, str], types: int = 3) -> Path:
    text = RAYTRIX.replace("TYPES", "".join(_TYPE.format(number) for number in range(types)))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


WRITERS: Mapping[str, tuple[Callable[[Path], Path], str, str]] = {
    "Lytro metadata": (lytro, "lytro.json", DEPTH),
    "Lytro container": (container, "lytro.lfr", DEPTH),
    "PlenoptiSign parameters": (plenoptisign, "sign.json", f"microlenses: {{layout: square}}, {DEPTH}"),
    "Raytrix calibration": (
        raytrix, "array.xml", f"microlenses: {{gap: 0.9 mm, focal_lengths: [0.8 mm, 0.9 mm, 1 mm]}}, {OPTICS}"
    ),
}  # fmt: skip
"""For every format: writes a file, its name, and what a study says beside it."""
