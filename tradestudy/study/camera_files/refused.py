"""Files of programs whose cameras have no scale, or another meaning: refused by name, with what to give instead."""

from __future__ import annotations

import re
from typing import Final

_LISTS: Final = "write both cameras and their pose as lists, K1, D1, K2, D2, R and T, in JSON"
_NO_SCALE: Final = (
    "its poses come from pictures alone and have no unit of length; calibrate the pair with a board of known size, or "
    f"{_LISTS}, with T in a unit that you measured"
)
REFUSED: Final = (
    (
        "COLMAP",
        re.compile(
            r"^# Camera list with one line of data per camera"
            r"|\A\s*\d+ (\w*PINHOLE|\w*RADIAL\w*|\w*OPENCV\w*|FOV) \d+ \d+ "
            r'|"(cam_from_rig_(rotation|translation)|ref_sensor)"\s*:',
            re.MULTILINE,
        ),
        f"{_NO_SCALE}; subtract 0.5 px from its principal points",
    ),
    (
        "Metashape",
        re.compile(r"<calibration[ >][\s\S]{0,400}<projection>|<document [\s\S]{0,400}<chunk"),
        "save each camera in Tools > Camera Calibration as OpenCV Camera Calibration (*.xml), and write a third file "
        "with R and T",
    ),
    ("nerfstudio", re.compile(r'"(fl_x|camera_angle_x)"\s*:'), _NO_SCALE),
    ("OpenMVG", re.compile(r'"sfm_data_version"\s*:'), _NO_SCALE),
    (
        "pickle",
        re.compile(r"\A(\(dp\d|\(lp\d|cnumpy|ccopy_reg)"),
        "a pickle can run code and is never loaded; save the matrices by np.savez(file, K1=K1, …)",
    ),
)
"""Program, its files, and what to do."""
_HEAD: Final = 20_000


def refused(text: str) -> str:
    """Why a file is refused by its program; empty if it is not."""
    head = text[:_HEAD]
    match = next(((program, remedy) for program, pattern, remedy in REFUSED if pattern.search(head)), None)
    return f"this is a file of {match[0]}, which is not read: {match[1]}" if match else ""
