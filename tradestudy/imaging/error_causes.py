"""Why a derived disparity error is what it is: the same bound with one cause taken away."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.picture_geometry import PictureGeometry
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.picture import LitModels, bounds_and_errors_px
from tradestudy.optics.arrays import FloatArray

CHANGES: Final = ("no blur", "no diffraction", "light of the brightest", "ten times the light")
"""What is changed, one at a time: everything in focus, no lens diffracts, more light."""
_MORE_LIGHT: Final = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorCauses:
    """The bound as it is and with one cause taken away.

    Parameters
    ----------
    value, error
        As of `disparity_error_px` [samples], over distance.
    changed, changed_error
        The same after each of `CHANGES`, shape (change, distance); NaN where the brighter light is not known.
    """

    value: FloatArray
    error: FloatArray
    changed: FloatArray
    changed_error: FloatArray


def error_causes(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels, brightest: ArrayLike
) -> ErrorCauses:
    """Evaluate the bound anew without blur, without diffraction, and in more light.

    What is taken away changes nothing else: a picture in focus keeps its light and its diffraction, one without
    diffraction is blurred by the disc of rays alone, and a pixel of more light is taken not to saturate. Causes act
    together, so their shares need not multiply to the whole. Where blur keeps texture out of the picture that is too
    fine for its samples, the bound without blur can be the larger one.

    Parameters
    ----------
    geometry, settings, models
        As for `disparity_error_px`.
    brightest
        Electrons of the brightest picture that this one is compared with over its own, over distance; NaN where there
        is none.

    Raises
    ------
    OutOfRangeError
        As `disparity_error_px`.
    """
    ratio = np.broadcast_to(np.asarray(brightest, dtype=np.float64), geometry.distance.shape)
    known = np.isfinite(ratio)
    variants = (
        LitModels(models=models),
        LitModels(models=replace(models, defocus_blur="off")),
        LitModels(models=replace(models, main_lens_diffraction="none", microlens_diffraction="none")),
        LitModels(models=models, brighter=np.where(known, ratio, 1.0)),
        LitModels(models=models, brighter=_MORE_LIGHT),
    )
    value, error = np.stack(bounds_and_errors_px(geometry, settings, variants), axis=1)
    error = np.where(np.isfinite(value), error, np.nan)
    in_its_light = 1 + CHANGES.index("light of the brightest")
    for found in (value, error):
        found[in_its_light] = np.where(known, found[in_its_light], np.nan)
    return ErrorCauses(value=value[0], error=error[0], changed=value[1:], changed_error=error[1:])
