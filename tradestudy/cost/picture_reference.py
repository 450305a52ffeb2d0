"""The derived disparity error with everything in it, by a code of its own: what models of pictures are held against.

Kirchhoff's transfer is computed at every distance and interpolated between none, every replica up to the cut-off of the
lenses is summed node by node, and the band has more nodes than a run spends on it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.errors import UnaffordableError
from tradestudy.imaging.kirchhoff import FARTHEST, correction_at, kirchhoff_correction
from tradestudy.imaging.light import field_illumination, mean_electrons, neighbours_share, noise_variance
from tradestudy.imaging.matching_bound import band_nodes, matching_bound_px
from tradestudy.imaging.models import PictureSettings, texture_spectrum
from tradestudy.imaging.picture import window_px
from tradestudy.imaging.transfer import disc_transfer, fresnel_transfer, square_transfer
from tradestudy.optics.arrays import FloatArray

_NODES: Final = ((60, 12), (42, 8))  # along and across an eighth of the band; the second says how good the first is
_MOST_REPLICAS: Final = 24  # to a side


def reference_error_px(geometry: PictureGeometry, settings: PictureSettings) -> tuple[FloatArray, FloatArray]:
    """The bound of `disparity_error_px` with the most complete models [samples], and its numerical error.

    Parameters
    ----------
    geometry
        At the distances asked for; each is computed by itself.
    settings
        What is looked at. All that they declare counts: spectrum, field angle, noise, the active pixel.

    Returns
    -------
    tuple
        σ and its error, shape (distances,): the change on fewer nodes, and what the error of Kirchhoff's transfer does
        everywhere in the band at once.

    Raises
    ------
    UnaffordableError
        Where the lenses resolve so much more than the samples that too many replicas would have to be summed, or the
        defocus is beyond a thousand waves.
    """
    found = [_at_one(geometry.at(np.array([k])), settings) for k in range(geometry.distance.size)]
    value, error = np.array(found).T
    return value, error


def _at_one(geometry: PictureGeometry, settings: PictureSettings) -> tuple[float, float]:
    fine, coarse = (_bound(geometry, settings, along, across) for along, across in _NODES)
    moved = _bound(geometry, settings, *_NODES[0], shifted=True)
    return fine, abs(fine - coarse) + abs(fine - moved)


def _bound(
    geometry: PictureGeometry, settings: PictureSettings, along: int, across: int, *, shifted: bool = False
) -> float:
    """At one distance; ``shifted`` lowers the transfer by its own error."""
    nodes = band_nodes(along, across)
    reach = _replicas(geometry, settings)
    row, column = (shift.reshape(-1, 1) for shift in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    x, y = nodes.x + column, nodes.y + row
    radius = np.hypot(x, y)
    transfer, off = _transfer(geometry, settings, radius.ravel())
    passed = np.reshape(transfer - (off if shifted else 0.0), radius.shape)
    width = geometry.sample_width / geometry.sample_pitch
    if geometry.sample_shape == "disc":
        passed = passed * disc_transfer(radius, width)
    else:
        passed = passed * square_transfer(x, y, settings.pixel_fill * width)
    length = settings.texture.correlation_length * float(geometry.magnification[0]) / geometry.sample_pitch
    electrons = _electrons(geometry, settings)
    density = electrons**2 * texture_spectrum(radius, settings.texture.contrast, length) * np.square(passed)
    own = (row == 0) & (column == 0)
    signal = np.sum(np.where(own, density, 0.0), axis=0)
    floor = noise_variance(electrons, settings.sensor_noise, "shot+read+quantisation")
    window = window_px(geometry, settings)
    neighbours = float(neighbours_share(geometry, settings.wavelength, window, blurred=True)[0])
    noise = floor + (1.0 - neighbours) ** 2 * np.sum(np.where(own, 0.0, density), axis=0) + neighbours**2 * signal
    signal = (1.0 - neighbours) ** 2 * signal
    return float(matching_bound_px(nodes, signal=signal, noise=noise, window_px=float(window[0])))


def _lines(settings: PictureSettings) -> tuple[tuple[float, float], ...]:
    """Wavelengths and their shares."""
    lines = settings.spectrum or ((settings.wavelength, 1.0),)
    total = math.fsum(weight for _, weight in lines)
    return tuple((wavelength, weight / total) for wavelength, weight in lines)


def _stages(geometry: PictureGeometry) -> tuple[LensStage, ...]:
    return tuple(stage for stage in (geometry.main_lens, geometry.microlens) if stage is not None)


def _replicas(geometry: PictureGeometry, settings: PictureSettings) -> int:
    """To a side, up to the cut-off of the narrowest cone in the shortest wavelength."""
    shortest = min(wavelength for wavelength, _ in _lines(settings))
    cut_off = min(
        geometry.sample_pitch / (shortest * float(stage.f_number[0]) * float(stage.relay[0]))
        for stage in _stages(geometry)
    )
    reach = math.ceil(cut_off + 0.5)
    if reach > _MOST_REPLICAS:
        raise UnaffordableError(
            "replicas of a picture whose lenses resolve more than its samples",
            value=str(reach),
            limit=f"at most {_MOST_REPLICAS} to a side",
            remedy="smaller pixels or larger f-numbers need fewer",
        )
    return reach


def _transfer(
    geometry: PictureGeometry, settings: PictureSettings, frequency_px: FloatArray
) -> tuple[FloatArray, float]:
    """Of all lenses at |ν| [cycles/sample], the mean over the spectrum, and its error."""
    total, error = np.zeros_like(frequency_px), 0.0
    for wavelength, share in _lines(settings):
        passed = np.ones_like(frequency_px)
        for stage in _stages(geometry):
            nu = frequency_px / geometry.sample_pitch * float(stage.relay[0])
            N = float(stage.f_number[0])
            distance = float(stage.object_distance[0])
            table, off = kirchhoff_correction(
                wavelength,
                stage.aperture_diameter,
                float(stage.focal_length[0]),
                math.copysign(min(abs(distance), FARTHEST), distance),
                float(stage.plane_distance[0]),
                settings.lens_phase,
            )
            value = fresnel_transfer(nu, wavelength, N, float(stage.blur_diameter[0]))
            passed = passed * (value + correction_at(table, wavelength * N * nu))
            error += share * off
        total += share * passed
    return total, error


def _electrons(geometry: PictureGeometry, settings: PictureSettings) -> float:
    left = field_illumination(
        settings.field_angle, pupil_diameter=geometry.pupil_diameter, stop_separation=settings.stop_separation
    )
    return float(mean_electrons(settings.light, geometry.light_f_number, geometry.pixel_pitch, left)[0])
