"""A point source behind one circular lens, by the method of choice."""

from __future__ import annotations

import math

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.propagation.direct import ApertureSamples, Kernel
from tradestudy.optics.propagation.fresnel import FresnelKernel
from tradestudy.optics.propagation.kirchhoff import KirchhoffKernel
from tradestudy.optics.propagation.lens import OBLIQUITIES, CircularLens, LensWave, Obliquity, PointSource
from tradestudy.optics.propagation.result import ApertureField, Method
from tradestudy.optics.propagation.sampling import Limits, NodeCounts, needed_nodes, outline
from tradestudy.optics.propagation.targets import Targets
from tradestudy.optics.propagation.wave_optics import Accuracy, propagate_wave
from tradestudy.optics.quadrature import disc_nodes

METHODS: tuple[Method, ...] = ("geometric", "boundary_wave", "fresnel", "kirchhoff")


def aperture_field(
    *,
    source: PointSource,
    lens: CircularLens,
    targets: Targets,
    wavelength: float,
    method: Method,
    accuracy: Accuracy,
    obliquity: Obliquity = "paper",
    limits: Limits | None = None,
    counts: NodeCounts | None = None,
) -> ApertureField:
    """Field and intensity of a point source behind a circular lens, with their error."""
    if method == "fresnel" and obliquity != "paper":
        raise OutOfRangeError("obliquity of the Fresnel integral", value=repr(obliquity), limit="'paper'")
    wave = lens_wave(source=source, lens=lens, wavelength=wavelength, paraxial=method == "fresnel", obliquity=obliquity)
    kernel: Kernel = (
        FresnelKernel(wavelength=wavelength)
        if method == "fresnel"
        else KirchhoffKernel(wavelength=wavelength, obliquity=obliquity)
    )
    return propagate_wave(
        sample=lambda n: sample_wave(wave, n),
        counts=counts or nodes_for(wave, targets, accuracy),
        kernel=kernel,
        targets=targets,
        accuracy=accuracy,
        limits=limits,
        fixed_nodes=counts is not None,
    )


def lens_wave(
    *, source: PointSource, lens: CircularLens, wavelength: float, paraxial: bool, obliquity: Obliquity
) -> LensWave:
    """Wave behind the lens; refuses a wavelength that is not a positive length."""
    if not (math.isfinite(wavelength) and wavelength > 0):
        raise OutOfRangeError("wavelength", value=f"{wavelength:g} m", limit="> 0, finite")
    if obliquity not in OBLIQUITIES:
        raise OutOfRangeError("obliquity", value=repr(obliquity), limit=" | ".join(OBLIQUITIES))
    return LensWave(source=source, lens=lens, wavelength=wavelength, paraxial=paraxial, obliquity=obliquity)


def sample_wave(wave: LensWave, counts: NodeCounts) -> ApertureSamples:
    """Sample the wave behind a lens on the nodes of its disc."""
    lens = wave.lens
    nodes = disc_nodes(radius=lens.radius, radial_count=counts.radial, angular_count=counts.angular, centre=lens.centre)
    x, y = nodes.x - lens.centre[0], nodes.y - lens.centre[1]
    cosine = None if wave.paraxial or wave.obliquity != "textbook" else wave.axial_cosine(x, y)
    return ApertureSamples(nodes=nodes, field=np.asarray(wave.field(x, y), dtype=np.complex128), axial_cosine=cosine)


def nodes_for(wave: LensWave, targets: Targets, accuracy: Accuracy) -> NodeCounts:
    """Node counts for the wave behind a lens and the outline of the targets."""
    x, y, z = targets.coordinates()
    x, y, z = outline(x - wave.lens.centre[0], y - wave.lens.centre[1], z)
    return needed_nodes(
        wave.paths,
        radius=wave.lens.radius,
        wavenumber=wave.wavenumber,
        x=x,
        y=y,
        z=z,
        tolerance=1e-3 * accuracy.tolerance,
    )
