"""Light of neighbouring micro-images in a window, as a share of all light there."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from tradestudy.cameras.picture_geometry import PictureGeometry, column
from tradestudy.imaging.transfer import airy_transfer, disc_transfer
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre

_LEAST_NODES: Final = 32
_NODES_PER_CYCLE: Final = 3  # of the product of two Bessel functions
_STEP: Final = 32  # so that few rules serve all pictures


def neighbours_share(
    geometry: PictureGeometry, wavelength: float, window_px: FloatArray, *, blurred: bool
) -> FloatArray:
    """Share of the light in a window that a neighbouring microlens brings, over distance; 0 without microlenses.

    Every microlens spreads the light of its own micro-image, a disc of radius R, by diffraction and blur; in a uniform
    scene as much comes in from neighbours as goes out. Averaged over a window in the middle, as over the disc of its
    area, of radius a:

    ``1 − (2 R/a) ∫₀^{1/λN} H(ν) J₁(2π R ν) J₁(2π a ν) dν/ν``, H the transfer of Airy pattern and blur.

    Parameters
    ----------
    geometry
        The picture.
    wavelength
        [m].
    window_px
        Side of the window [samples], over distance, at most what a micro-image holds.
    blurred
        Whether the geometric blur spreads light, too.
    """
    lens = geometry.microlens
    if lens is None:
        return np.zeros_like(geometry.distance)
    from scipy.special import j1

    R = geometry.widest_window_px * geometry.sample_pitch / math.sqrt(2.0)
    # What is the same at all distances is computed once.
    a = column(window_px * geometry.sample_pitch / math.sqrt(math.pi))
    _, N, blur = lens.columns
    blur = blur if blurred else np.zeros((1, 1))
    cutoff = 1.0 / (wavelength * N)
    cycles = 2.0 * R * float(np.nanmax(cutoff, initial=0.0))
    t, w = gauss_legendre(_STEP * math.ceil((_LEAST_NODES + _NODES_PER_CYCLE * cycles) / _STEP))
    nu = cutoff * t
    unblurred = w / t * airy_transfer(nu, wavelength, N) * j1(2.0 * np.pi * R * nu) * j1(2.0 * np.pi * a * nu)
    own = 2.0 * R / a * np.sum(unblurred * disc_transfer(nu, blur), axis=1, keepdims=True)
    return np.broadcast_to(1.0 - own, (geometry.distance.size, 1))[:, 0]
