"""The light of one source point behind all microlenses at once, on one fine grid over the whole detector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.detector_transfer import (
    Response,
    Transfer,
    choose_transfer,
    fading_length,
    half_band,
    patch_fields,
)
from tradestudy.optics.chain.microlens_plane import MicrolensPlane
from tradestudy.optics.chain.pixels import MARGIN, samples_per_pixel
from tradestudy.optics.chain.rays import RayReach
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.propagation.direct import ComplexArray

_UPSAMPLING = 4.0  # memory of a nonuniform FFT over that of its modes


@dataclass(frozen=True, kw_only=True)
class DetectorPlan:
    """Sizes that source points need.

    Attributes
    ----------
    kept
        Light that lands up to this far from where it passed the array is kept [m].
    target_reach
        Farthest target from a ray image that nodes must resolve [m].
    per_pixel
        Samples along a pixel.
    transfer
        Grid and law of the leg.
    """

    kept: float
    target_reach: float
    per_pixel: int
    transfer: Transfer

    def memory(self, nodes: int, *, single: bool = False) -> float:
        """What nodes and samples take at once, in single or double precision [bytes]."""
        return (8.0 if single else 16.0) * (12 * nodes + (_UPSAMPLING + 4) * self.transfer.count**2)


def plan_detector(
    path: LightPath,
    reaches: Sequence[RayReach],
    *,
    wavelength: float,
    paraxial: bool,
    accuracy: ChainAccuracy,
    everywhere: bool = False,
) -> DetectorPlan:
    """Follow light from where rays land to a margin of Fresnel lengths that grows as the tolerance shrinks.

    Parameters
    ----------
    path
        The camera.
    reaches
        Rays of the source points whose light is to be followed; of a disc those of its centre and of its rim.
    wavelength, paraxial
        Of the leg to the detector.
    accuracy
        What to aim at.
    everywhere
        Follow it to the farthest pixel and the margin beyond, wherever rays land.
    """
    travel = max(float(reach.travel.max()) for reach in reaches)
    margin = accuracy.fresnel_lengths * math.sqrt(wavelength * path.detector_distance)
    kept = (_farthest(path) if everywhere else min(travel, _farthest(path))) + margin
    pixels = path.pixels
    band = half_band(wavelength, path.detector_distance, kept, paraxial=paraxial, tolerance=accuracy.tolerance)
    per_pixel = samples_per_pixel(pixels, accuracy.pixel_sampling * 2 * band * pixels.pitch)
    spacing = pixels.pitch / per_pixel
    nodes, targets = _half_side(path)
    fading = fading_length(wavelength, path.detector_distance, kept, paraxial=paraxial, tolerance=accuracy.tolerance)
    # Beside its rays a microlens sends light of the main lens's edge; starved nodes throw it back into small windows.
    beside_rays = math.sqrt(2.0) * (max(float(reach.spread.max()) for reach in reaches) + margin)
    return DetectorPlan(
        kept=kept,
        target_reach=max(min(_farthest_image(path, reaches), kept + fading + travel), beside_rays),
        per_pixel=per_pixel,
        transfer=choose_transfer(
            wavelength=wavelength,
            distance=path.detector_distance,
            paraxial=paraxial,
            node_reach=nodes,
            target_reach=targets + MARGIN * spacing,
            kept_reach=kept,
            spacing=spacing,
            tolerance=accuracy.tolerance,
        ),
    )


def field_on_detector(
    plane: MicrolensPlane,
    strengths: ComplexArray,
    *,
    response: Response,
    per_pixel: int,
    tolerance: float,
    threads: int = 0,
) -> ComplexArray:
    """Field on the fine grid of the detector, three samples more on every side.

    Parameters
    ----------
    plane
        Nodes of all microlenses.
    strengths
        Field behind the lenses times area weight, shape (lenses, nodes).
    response
        Grid and transfer function.
    per_pixel
        Samples along a pixel.
    tolerance
        Of the nonuniform FFT.
    threads
        For it to use; 0 for all.
    """
    pixels = plane.path.pixels
    held = strengths != 0  # a shadow leaves some lenses fewer nodes than others, and a sphere leaves nothing
    x, y = plane.positions
    rows, columns = (n * per_pixel + 2 * MARGIN for n in pixels.shape)
    if not held.any():
        return np.zeros((rows, columns), dtype=strengths.dtype)
    first = np.asarray(pixels.corner) - pixels.centre + (0.5 - MARGIN) * pixels.pitch / per_pixel
    fields = patch_fields(
        response.transfer,
        x=x[held] - pixels.centre[0],
        y=y[held] - pixels.centre[1],
        strengths=strengths[held][None],
        response=response,
        carriers=np.zeros((1, 2), dtype=int),
        start=first[None],
        shape=(rows, columns),
        tolerance=tolerance,
        threads=threads,
    )
    return np.asarray(fields[0])


def _farthest(path: LightPath) -> float:
    """Farthest pixel from any point of a microlens: light that lands beyond is nobody's [m]."""
    apart = np.linalg.norm(path.microlenses.centres[:, None] - _corners(path), axis=-1)
    return float(apart.max()) + path.microlenses.cell_reach


def _farthest_image(path: LightPath, reaches: Sequence[RayReach]) -> float:
    """Farthest pixel from any ray image of a source point, of a disc of any of its points [m]."""
    first, last = reaches[0].image, reaches[-1].image
    moved = float(np.linalg.norm(last - first, axis=1).max())
    return float(np.linalg.norm(first[:, None] - _corners(path), axis=-1).max()) + moved


def _corners(path: LightPath) -> FloatArray:
    """Of the detector, shape (4, 2) [m]."""
    return np.array([[x, y] for x in path.pixels.edges_x[[0, -1]] for y in path.pixels.edges_y[[0, -1]]])


def _half_side(path: LightPath) -> tuple[float, float]:
    """Half sides of the squares about the detector's centre that hold all nodes and all pixels."""
    centre = np.asarray(path.pixels.centre)
    nodes = float(np.max(np.abs(path.microlenses.centres - centre))) + path.microlenses.cell_reach
    return nodes, max(path.pixels.shape) * path.pixels.pitch / 2
