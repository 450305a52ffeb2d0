"""Effects and their models in words: what is simulated, and what a simpler model leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.effects.models import OFF, SlotName

EFFECT: Final[Mapping[SlotName, str]] = {
    "defocus_blur": "defocus",
    "main_lens_diffraction": "diffraction at the main lens",
    "microlens_diffraction": "diffraction at the microlenses",
    "crosstalk": "crosstalk between microlenses",
    "pixel_integration": "integration over the pixel",
    "source_extent": "the extent of the source",
    "spectrum": "the spectrum",
    "vignetting": "vignetting",
    "sensor_noise": "sensor noise",
    "calibration": "calibration errors",
    "sampling": "finer sampling",
}
MODEL: Final[Mapping[tuple[SlotName, str], str]] = {
    ("main_lens_diffraction", "airy"): "Airy diffraction",
    ("main_lens_diffraction", "boundary_wave"): "boundary wave of the main lens",
    ("main_lens_diffraction", "fresnel"): "Fresnel diffraction",
    ("main_lens_diffraction", "kirchhoff"): "Kirchhoff diffraction",
    ("microlens_diffraction", "airy"): "Airy diffraction at the microlenses",
    ("microlens_diffraction", "boundary_wave"): "boundary wave of the microlenses",
    ("microlens_diffraction", "fresnel"): "Fresnel diffraction at the microlenses",
    ("microlens_diffraction", "kirchhoff"): "Kirchhoff diffraction at the microlenses",
    ("calibration", "off"): "noise alone",
    ("calibration", "linear"): "linear calibration",
    ("calibration", "exact"): "exact calibration",
}
_LEFT_OUT: Final[Mapping[str, str]] = {
    "airy": "defocus and diffraction acting together",
    "boundary_wave": "all but the leading term of the wave from the rim",
    "fresnel": "the exact path (Kirchhoff)",
    "linear": "nonlinear and non-normal errors",
    "shot": "read and rounding noise",
    "shot+read": "rounding noise",
}
_AT: Final[Mapping[SlotName, str]] = {
    "main_lens_diffraction": " at the main lens",
    "microlens_diffraction": " at the microlenses",
}


def left_out(slot: SlotName, model: str) -> str:
    """What a model of an effect leaves out, compared with the most complete one."""
    if model == OFF or model not in _LEFT_OUT:
        return EFFECT[slot]
    return _LEFT_OUT[model] + (_AT.get(slot, "") if model in ("airy", "fresnel") else "")
