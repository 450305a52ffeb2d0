"""Wave optics of a lens, of a microlens array behind it, and of its pixels: arrays in, arrays and their errors out.

Start here:

* `point_spread`: from focal length, f-number and wavelength to the point-spread function, its width, encircled energy,
  Strehl ratio, MTF and a plot. `Pupil` gives the lens aberrations (Zernike coefficients) or any amplitude and path,
  `FocalLengths` its field curvature and axial colour.
* `aperture_field`: complex field and intensity of a point behind a lens at any points. Metrics such as
  `encircled_energy` and `modulation_transfer` take what either of them returns.
* `microlens_image`: a point or a disc through main lens and microlens array onto the pixels, from the numbers of a
  `MicrolensCamera`. `chain_image` does the same for any `LightPath`.

Lengths are in metres, angles in radians. Positions of sources, apertures and targets share axes; nothing is mirrored.
Every result states its error, and what misses its tolerance is refused.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tradestudy.optics._public import *  # noqa: F403  (listed there)


def __getattr__(name: str) -> Any:
    # Loaded when asked for: a study that is only checked needs single laws, and neither SciPy nor Fourier transforms.
    # A module of this package is on its way in by itself.
    if name == "__all__" or not (name.startswith("_") or find_spec(f"{__name__}.{name}")):
        public = import_module(f"{__name__}._public")
        if name == "__all__" or name in public.__all__:
            return getattr(public, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(import_module(f"{__name__}._public").__all__)
