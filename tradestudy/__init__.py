"""Trade studies that compare plenoptic cameras with stereo rigs: depth, depth of field, diffraction, calibration.

``load(path)`` reads a study, and the study's ``run()`` computes it. ``camera(kind, …)`` makes a single camera.
``render(study, folder)`` renders the pictures of its scene. ``open_result(folder)`` opens a finished run,
``compare(folders)`` compares finished runs, and ``starter(name)`` returns a commented study to start from.
`tradestudy.optics` offers the wave optics on its own, and `tradestudy.uncertainty` propagates uncertainty through any
function. Errors are in ``tradestudy.errors`` and derive from ``TradestudyError``; their messages state the value, the
limit and a remedy.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tradestudy import optics, uncertainty
    from tradestudy.api import compare, render, schema
    from tradestudy.camera_object import Camera
    from tradestudy.loaded_study import Study, camera, load
    from tradestudy.result import Result, open_result
    from tradestudy.study.starter import starter

    __version__: str

__all__ = [
    "Camera",
    "Result",
    "Study",
    "__version__",
    "camera",
    "compare",
    "load",
    "open_result",
    "optics",
    "render",
    "schema",
    "starter",
    "uncertainty",
]

_PACKAGES = ("optics", "uncertainty")
_MODULES = {
    "Camera": "camera_object",
    "Result": "result",
    "Study": "loaded_study",
    "camera": "loaded_study",
    "load": "loaded_study",
    "open_result": "result",
    "starter": "study.starter",
}


def __getattr__(name: str) -> Any:
    # The study reader is loaded on demand, because those who need only the physics should not wait for it.
    if name == "__version__":
        from importlib.metadata import version  # here, because few programs need it

        return version("tradestudy")
    if name in _PACKAGES:
        return importlib.import_module(f"tradestudy.{name}")
    if name in __all__:
        module = _MODULES.get(name, "api")
        return getattr(importlib.import_module(f"tradestudy.{module}"), name)
    raise AttributeError(f"module 'tradestudy' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
