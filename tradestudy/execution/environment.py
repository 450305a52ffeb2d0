"""What the bits of a value depend on beside its point: the code, and the libraries that compute."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import version

from tradestudy.provenance import code_hash

_COMPUTING = ("numpy", "scipy", "finufft", "emcee", "arviz-stats")


@cache
def environment() -> dict[str, str]:
    """Hash of this package's sources, and the versions of Python and of the libraries that numbers come from."""
    return {
        "tradestudy": code_hash(),
        "python": platform.python_version(),
        **{name: version(name) for name in _COMPUTING},
    }
