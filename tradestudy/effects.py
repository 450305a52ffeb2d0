"""The effects in a scene and their models, by name and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, get_args

SlotName = Literal[
    "defocus_blur",
    "main_lens_diffraction",
    "microlens_diffraction",
    "crosstalk",
    "pixel_integration",
    "source_extent",
    "spectrum",
    "vignetting",
    "sensor_noise",
    "calibration",
    "sampling",
]
Models = Mapping[SlotName, str]
"""One model for each effect, by name."""

Use = Literal["depth", "sharpness", "spot", "point", "picture"]
"""A camera's depth, its depth of field, a light spot's picture, a point's image behind one lens, or scene pictures."""

OFF: Final = "off"
_EVERY: Final[tuple[Use, ...]] = get_args(Use)
_DEPTH: Final[tuple[Use, ...]] = ("depth",)
_SPOT: Final[tuple[Use, ...]] = ("spot",)
_PICTURES: Final[tuple[Use, ...]] = ("depth", "spot")

_MODELS: Final[Mapping[SlotName, Mapping[str, tuple[Use, ...]]]] = {
    "defocus_blur": {OFF: _DEPTH, "disc": _DEPTH},
    "main_lens_diffraction": {
        OFF: ("depth", "sharpness", "spot", "picture"),
        "airy": ("depth", "sharpness"),
        "boundary_wave": _SPOT,
        "fresnel": ("depth", "spot", "point", "picture"),
        "kirchhoff": ("depth", "spot", "point"),
    },
    "microlens_diffraction": {
        OFF: (*_PICTURES, "picture"),
        "airy": _DEPTH,
        "boundary_wave": _SPOT,
        "fresnel": (*_PICTURES, "picture"),
        "kirchhoff": _PICTURES,
    },
    "crosstalk": {OFF: _PICTURES, "share": _DEPTH, "coherent": _SPOT},
    "pixel_integration": {OFF: _PICTURES, "square": _PICTURES},
    "source_extent": {OFF: _SPOT, "disc": _SPOT},
    "spectrum": {OFF: _PICTURES, "weighted": _PICTURES},
    "vignetting": {OFF: _DEPTH, "cos4": _DEPTH},
    "sensor_noise": {"shot": _DEPTH, "shot+read": _DEPTH, "shot+read+quantisation": _DEPTH},
    "calibration": {OFF: _DEPTH, "linear": _DEPTH, "exact": _DEPTH},
}


def models_of(slot: SlotName, use: Use | None = None) -> tuple[str, ...]:
    """Names of an effect's models for one use, or for any, from the cheapest to the most complete."""
    uses = _EVERY if use is None else (use,)
    return tuple(model for model, model_uses in _MODELS[slot].items() if not set(uses).isdisjoint(model_uses))


LENSES: Final[tuple[SlotName, SlotName]] = ("main_lens_diffraction", "microlens_diffraction")
"""Diffraction at each lens, in the order in which light passes the lenses."""
EFFECTS: Final[tuple[SlotName, ...]] = tuple(_MODELS)
"""Every effect except sampling, whose models are tolerances."""


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
