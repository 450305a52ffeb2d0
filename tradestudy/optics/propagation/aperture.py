"""A point source behind one circular lens, by the method of choice."""

from __future__ import annotations

import math

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.propagation.direct import Kernel
from tradestudy.optics.propagation.fresnel import FresnelKernel
from tradestudy.optics.propagation.geometric import geometric_field
from tradestudy.optics.propagation.hybrid import hybrid_field
from tradestudy.optics.propagation.kirchhoff import KirchhoffKernel
from tradestudy.optics.propagation.lens import OBLIQUITIES, CircularLens, LensWave, Obliquity, PointSource
from tradestudy.optics.propagation.lens_sampling import nodes_for, sample_wave
from tradestudy.optics.propagation.result import ApertureField, Method
from tradestudy.optics.propagation.sampling import Limits, NodeCounts
from tradestudy.optics.propagation.targets import Targets
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, propagate_wave

METHODS: tuple[Method, ...] = ("geometric", "boundary_wave", "fresnel", "kirchhoff")


def aperture_field(
    *,
    source: PointSource,
    lens: CircularLens,
    targets: Targets,
    wavelength: float,
    method: Method,
    accuracy: FieldAccuracy,
    obliquity: Obliquity = "paper",
    limits: Limits | None = None,
    counts: NodeCounts | None = None,
) -> ApertureField:
    """Field and intensity of a point source behind a circular lens, with their error.

    U(P) = ∬ U_source(q) exp(i φ_lens(q)) K(q, P) dq over the aperture, with the laws of the method for both legs.

    Parameters
    ----------
    source
        Point source, on or off axis, real or virtual.
    lens
        Aperture and lens phase.
    targets
        Any points behind the lens, or a regular grid (fast).
    wavelength
        Wavelength [m], > 0.
    method
        ``geometric``: rays. ``boundary_wave``: rays and the wave from the edge, Kirchhoff where they are singular.
        ``fresnel``: paths to second order, unit cosines, eqs. 17–22; the conjugate paths that a stigmatic or
        perfect lens cancels are of second order too, so that all lens phases are one.
        ``kirchhoff``: exact paths and cosines, eqs. 9–16.
    accuracy
        Relative L2 tolerance of the intensity over the targets, and the check.
    obliquity
        ``paper``, ``textbook`` or ``rayleigh-sommerfeld-1``, see `KirchhoffKernel` and `LensWave.amplitude`; the
        Fresnel integral has none and takes only the default.
    limits
        Memory and time; left out: 2 GB, 600 s.
    counts
        Node counts on the disc, for studies of convergence: nothing is refined then, and the stated error is what it is
        (on the edge only the angular count is used; rays have no nodes and refuse it). Left out: from the slope of
        the net path.

    Returns
    -------
    ApertureField
        Field [1/m² for a unit point of eqs. 10–12] and intensity in the shape of the targets, the stated error, the
        effort. The field leaves out the lens's constant phase n Δ.

    Raises
    ------
    OutOfRangeError
        An argument is outside the validity of the laws, or an option has no meaning for the method.
    UnaffordableError
        The nodes needed exceed the limits; nothing is undersampled instead.
    NotConvergedError
        The tolerance is below what the method or double precision can give at these targets.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 9–22. Of its errata the one in eq. 23
    (2πi/(λ a) where πi/(λ a) belongs) does not enter here.
    """
    if method not in METHODS:
        raise OutOfRangeError("method", value=repr(method), limit=" | ".join(METHODS))
    if method == "fresnel" and obliquity != "paper":
        raise OutOfRangeError(
            "obliquity of the Fresnel integral",
            value=repr(obliquity),
            limit="'paper', the default",
            remedy="Fresnel sets all cosines to 1; leave the obliquity out",
        )
    if method == "geometric" and counts is not None:
        raise OutOfRangeError("node counts of rays", value=str(counts), limit="None", remedy="leave them out")
    wave = lens_wave(source=source, lens=lens, wavelength=wavelength, paraxial=method == "fresnel", obliquity=obliquity)
    exact = KirchhoffKernel(wavelength=wavelength, obliquity=obliquity)
    if method == "geometric":
        return geometric_field(wave=wave, kernel=exact, targets=targets, accuracy=accuracy)
    if method == "boundary_wave":
        return hybrid_field(
            wave=wave,
            kernel=exact,
            targets=targets,
            accuracy=accuracy,
            limits=limits or Limits(),
            edge_nodes=None if counts is None else counts.angular,
        )
    kernel: Kernel = FresnelKernel(wavelength=wavelength) if method == "fresnel" else exact
    return propagate_wave(
        sample=lambda n: sample_wave(wave, n),
        counts=counts or (lambda: nodes_for(wave, kernel, targets, accuracy)),
        kernel=kernel,
        targets=targets,
        accuracy=accuracy,
        limits=limits,
        fixed_nodes=counts is not None,
    )


def lens_wave(
    *,
    source: PointSource,
    lens: CircularLens,
    wavelength: float,
    paraxial: bool = False,
    obliquity: Obliquity = "paper",
) -> LensWave:
    """Wave of a point source behind a lens.

    Raises
    ------
    OutOfRangeError
        The wavelength is not a positive length, or the obliquity is unknown.
    """
    if not (math.isfinite(wavelength) and wavelength > 0):
        raise OutOfRangeError("wavelength", value=f"{wavelength:g} m", limit="> 0, finite")
    if obliquity not in OBLIQUITIES:
        raise OutOfRangeError("obliquity", value=repr(obliquity), limit=" | ".join(OBLIQUITIES))
    return LensWave(source=source, lens=lens, wavelength=wavelength, paraxial=paraxial, obliquity=obliquity)
