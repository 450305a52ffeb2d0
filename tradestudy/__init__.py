"""Trade studies of plenoptic cameras against stereo rigs: depth, depth of field, diffraction, calibration.

``tradestudy.load(path)`` reads a study, ``.run()`` computes it; the physics is importable on its own from
`tradestudy.optics`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tradestudy.api import Result, Study, compare, load, open_result

__all__ = ["Result", "Study", "compare", "load", "open_result"]


def __getattr__(name: str) -> Any:
    # The façade loads the study reader; whoever wants the physics alone does not pay for it.
    if name in __all__:
        from tradestudy import api

        return getattr(api, name)
    raise AttributeError(f"module 'tradestudy' has no attribute {name!r}")
