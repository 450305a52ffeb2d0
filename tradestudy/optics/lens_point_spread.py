"""The point-spread function of a lens from its data, in one call."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import check_angle, checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lateral_resolution import FIRST_DARK_RING
from tradestudy.optics.propagation.aperture import aperture_field, lens_wave
from tradestudy.optics.propagation.kernels import FresnelKernel, Kernel, KirchhoffKernel
from tradestudy.optics.propagation.lens import (
    AS_AT_INFINITY,
    CircularLens,
    FocalLengths,
    LensPhase,
    LensWave,
    Obliquity,
    PointSource,
    finite_image_distance,
    focal_length_for,
    reference_focal_length,
)
from tradestudy.optics.propagation.pupil import Pupil
from tradestudy.optics.propagation.result import ApertureField, Effort, Method
from tradestudy.optics.propagation.sampling import Limits
from tradestudy.optics.propagation.targets import TargetGrid
from tradestudy.optics.propagation.wave_optics import FieldAccuracy
from tradestudy.optics.sampled_point_spread import Measured, PointSpread, as_point_spread
from tradestudy.optics.spread_metrics import (
    encircled_energy,
    encircled_energy_radius,
    full_width_at_half_maximum,
    strehl_ratio,
)
from tradestudy.optics.spread_shares import modulation_transfer, window_share

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEAST_SHARE = 0.5  # of the light in the window, for a spot that has a width
_LEAST_WINDOW = 1.5  # Airy radii: fewer samples do not allow an estimate of the errors
_SAMPLES_PER_PERIOD = 8.0  # of the shortest period λ N_w of an intensity
_ON_AXIS_AT_INFINITY = PointSource.at_infinity()


@dataclass(frozen=True, kw_only=True)
class LensPointSpread(PointSpread):
    """Point-spread function of a lens, as `point_spread` computes it: a `PointSpread` with data on the lens.

    The methods defined here return numbers with their errors, except `plot`. The inherited `at`, `moments` and
    `power_in` give values without errors; where they state W and W/m², read 1 and 1/m². The square that the samples
    cover is called the window.

    Attributes
    ----------
    x, y
        Positions of the samples in the image plane [m].
    intensity
        Fraction of the light through the pupil per unit area of the image plane [1/m²], shape (len(y), len(x)).
    pupil_power
        Always 1, because `intensity` is a fraction of the light through the pupil [1].
    relative_error
        Stated relative L2 error of the intensity over the samples [1].
    centre
        Point (x, y) at which the chief ray meets the image plane [m].
    airy_radius
        Radius of the first dark ring without aberration, by Fresnel's law [m]: 1.2197 λ b/D for the wavelength λ, the
        distance b of the image plane behind the lens, and the diameter D of the pupil. By Kirchhoff's law, the ring of
        a fast lens is larger: by about 1 % at f/2.8.
    reference_peak
        Intensity at `centre` if the light of the whole pupil arrived there in phase [1/m²]: the peak without
        aberration.
    method
        Method of propagation, as given to `point_spread`.
    effort
        What the computation took, including the number of quadrature ``nodes`` and the wall time ``seconds`` [s].

    Raises
    ------
    OutOfRangeError
        If an array or a number does not meet the conditions of `PointSpread`.

    Examples
    --------
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9)
    >>> print(f"{psf.width().value * 1e6:.3f} µm at half maximum; error below 1e-6: {psf.relative_error < 1e-6}")
    4.535 µm at half maximum; error below 1e-6: True
    >>> half = psf.radius_of(0.5)
    >>> print(f"{psf.encircled_energy(half.value).value:.4f} of the light within {half.value * 1e6:.3f} µm")
    0.5000 of the light within 2.358 µm
    >>> print(f"MTF at 100/mm: {psf.modulation_transfer(100e3)}; Strehl ratio {psf.strehl_ratio().value:.4f}")
    MTF at 100/mm: 0.457 ± 0.008; Strehl ratio 1.0000
    >>> figure = psf.plot()
    """

    centre: tuple[float, float]
    airy_radius: float
    reference_peak: float
    method: Method
    effort: Effort

    def __repr__(self) -> str:
        return f"LensPointSpread({self.method}, {self._summary()}, Airy radius {self.airy_radius:.3g} m)"

    @property
    def relative_intensity(self) -> FloatArray:
        """Intensity of the samples relative to `reference_peak` [1], shape (len(y), len(x)).

        The peak may lie between samples; `strehl_ratio` finds it.
        """
        return np.asarray(self.intensity / self.reference_peak)

    @checked
    def width(self, *, angle: float = 0.0) -> Measured:
        """Full width at half maximum of the cut through the brightest point, by `full_width_at_half_maximum`.

        Far out of focus, the brightest point belongs to one of many fringes; `radius_of` then gives the size of the
        whole spot.

        Parameters
        ----------
        angle
            Direction of the cut, measured from the x axis [rad], within ±2π.

        Returns
        -------
        Measured
            Width [m], shape (); its error accounts for the spacing and the stated error of the samples.

        Raises
        ------
        OutOfRangeError
            If the window contains less than half of the light, the brightest sample lies on the edge of the window, the
            intensity along the cut stays above half the peak up to an edge, or the angle exceeds a full turn.
        """
        if (held := window_share(self).value) < _LEAST_SHARE:
            raise OutOfRangeError(
                "too little of the light in the window for a width",
                value=f"{100.0 * float(held):.2g} %",
                limit="≥ 50 %",
                remedy="widen the window",
            )
        return full_width_at_half_maximum(self, angle=angle)

    @checked
    def encircled_energy(self, radius: npt.ArrayLike) -> Measured:
        """Fraction of the light through the pupil that falls within circles about the chief ray.

        Parameters
        ----------
        radius
            Radii of the circles [m], any shape.

        Returns
        -------
        Measured
            Fractions [1] in the shape of the radii; their error accounts for the spacing and the stated error of the
            samples.

        Raises
        ------
        OutOfRangeError
            If a circle reaches beyond the window.
        """
        return encircled_energy(self, centre=self.centre, radius=np.asarray(radius, dtype=np.float64))

    @checked
    def radius_of(self, share: float) -> Measured:
        """Radius of the circle about the chief ray that contains a given fraction of the light through the pupil.

        Parameters
        ----------
        share
            Fraction of the light [1], in (0, 1).

        Returns
        -------
        Measured
            Radius [m], shape (); its error accounts for the spacing and the stated error of the samples.

        Raises
        ------
        OutOfRangeError
            If the largest circle that fits into the window contains a smaller fraction.
        """
        return encircled_energy_radius(self, centre=self.centre, share=share)

    def strehl_ratio(self) -> Measured:
        """Ratio of the peak intensity to `reference_peak`, the peak without aberration.

        Returns
        -------
        Measured
            Ratio [1], shape (); its error accounts for the spacing and the stated error of the samples.

        Raises
        ------
        OutOfRangeError
            If the brightest sample lies on the edge of the window.
        """
        return strehl_ratio(self, reference_peak=self.reference_peak)

    @checked
    def modulation_transfer(self, frequency: npt.ArrayLike, *, angle: float = 0.0) -> Measured:
        """Modulation transfer function (MTF) along one direction.

        At frequency 0, it is the fraction of the light that falls within the window, which differs from 1 by less than
        the stated error.

        Parameters
        ----------
        frequency
            Spatial frequencies [cycles/m], any shape.
        angle
            Direction along which the intensity is modulated, measured from the x axis [rad], within ±2π.

        Returns
        -------
        Measured
            MTF [1] in the shape of the frequencies; its error accounts for the spacing and the stated error of the
            samples, and for the light outside the window.

        Raises
        ------
        OutOfRangeError
            If a frequency exceeds the largest that the samples resolve, 1/(2 `spacing`), or the angle exceeds a full
            turn. The MTF is 0 above the much lower cutoff frequency, 1.2197/`airy_radius`.
        """
        check_angle(angle)
        f = np.asarray(frequency, dtype=np.float64)
        resolved = 1 / (2 * self.spacing)
        if not np.all(np.abs(f) <= resolved):
            raise OutOfRangeError(
                "spatial frequency",
                value=f"{np.abs(f).max():g} 1/m",
                limit=f"≤ {resolved:g} 1/m",
                remedy=f"keep to the cutoff, {FIRST_DARK_RING / self.airy_radius:g} 1/m, beyond which the MTF is 0",
            )
        return modulation_transfer(self, frequency_x=f * math.cos(angle), frequency_y=f * math.sin(angle))

    def plot(self, file: str | Path | None = None, *, ax: Axes | npt.NDArray[Any] | None = None) -> Figure:
        """Plot the spot, cuts through it, the encircled energy and the MTF, with bands for the stated errors.

        Parameters
        ----------
        file
            File in which the figure is saved; its extension sets the format. Default: the figure is not saved.
        ax
            Matplotlib axes in which the spot alone is drawn; or four axes for all panels, such as those of
            ``plt.subplots(2, 2)``. Default: the four axes of a new figure.

        Returns
        -------
        Figure
            Matplotlib figure that contains the axes; a new one is not yet shown on the screen.

        Raises
        ------
        OutOfRangeError
            If there are neither one nor four axes, the extension is unknown, or the file cannot be written.
        """
        from tradestudy.optics.spread_plot import spread_figure

        return spread_figure(
            self,
            centre=self.centre,
            airy_radius=self.airy_radius,
            reference_peak=self.reference_peak,
            file=file,
            ax=ax,
        )


@checked
def point_spread(
    *,
    focal_length: float | FocalLengths,
    f_number: float,
    wavelength: float,
    source: PointSource = _ON_AXIS_AT_INFINITY,
    method: Method = "kirchhoff",
    tolerance: float = 1e-6,
    focus_distance: float | None = None,
    lens_phase: LensPhase = "perfect",
    pupil: Pupil | None = None,
    window: float = 20.0,
    obliquity: Obliquity = "paper",
    limits: Limits | None = None,
) -> LensPointSpread:
    """Point-spread function of a lens, from its focal length and f-number.

    I(P) = |∬ U(q) t(q) exp(i k W(q)) K(q, P) dq|²/P₀ is the intensity at a point P of the image plane. The integral
    extends over the points q of the pupil. U is the wave behind the lens before ``pupil`` acts on it,
    t the amplitude transmission of ``pupil``, W the path that ``pupil`` adds, k = 2π/λ, K the kernel that propagates
    the field from q to P, and P₀ the power through the pupil.

    Parameters
    ----------
    focal_length
        Focal length f [m], > 0; or a table of focal lengths over field angle and wavelength, which describes field
        curvature and axial colour.
    f_number
        N = f/D [1], > 0, where D is the diameter of the pupil. For a table of focal lengths, f is its reference
        focal length.
    wavelength
        Wavelength λ [m], > 0 and less than the diameter of the pupil.
    source
        Point source, at a finite position or `PointSource.at_infinity`. Default: on the axis at infinity.
    method
        Method of propagation: ``kirchhoff``, ``fresnel``, ``boundary_wave`` or ``geometric``, as in `aperture_field`.
        ``fresnel`` is paraxial and agrees with textbook formulas. ``kirchhoff`` is not paraxial: at f/2.8 and 550 nm,
        its MTF is lower than that of ``fresnel`` by up to 0.01.
    tolerance
        Largest relative L2 error of the intensity over the window [1], from 1e-10 to 0.1.
    focus_distance
        Object distance at which the lens is focused [m], possibly infinite. The image plane is where an axial point at
        this distance is imaged; with a table of focal lengths, at its reference wavelength. Default: the distance of
        the source.
    lens_phase
        Phase of the lens:

        * ``perfect``: images every source point exactly onto its thin-lens image.
        * ``stigmatic``: images the axial point at ``focus_distance`` exactly; has coma off the axis.
        * ``parabolic``: the lens of the paper under References; has spherical aberration.
    pupil
        Amplitude transmission and aberrations of the pupil. Default: a clear pupil without aberrations.
    window
        Half the side of the window, the square about the chief ray on which the intensity is sampled [Airy radii];
        at least 1.5. The error of the MTF includes the light outside the window, which is 0.8 % of all light for the
        default and inversely proportional to ``window``.
    obliquity
        Obliquity factors in U and K, as in `aperture_field`. ``fresnel`` accepts only the default.
    limits
        Nodes, memory and time that the computation may take. Default: 2·10⁷ nodes, 2 GB and 600 s.

    Returns
    -------
    LensPointSpread
        Intensity [1/m²] with its stated error. The methods of the result compute width, encircled energy, Strehl
        ratio and MTF, and plot them.

    Raises
    ------
    OutOfRangeError
        An argument is outside the range in which the method holds, or ``focus_distance`` does not exceed the focal
        length.
    UnaffordableError
        The computation needs more than ``limits`` allows.
    NotConvergedError
        The method, or double precision, cannot reach the tolerance.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 9–22; M. Born and E. Wolf,
    *Principles of Optics*, sections 8.3 and 9.1–9.4.

    Examples
    --------
    An f/2.8 lens with a tenth of a wave (rms) of coma along x, Noll's Z₈:

    >>> from tradestudy import optics
    >>> psf = optics.point_spread(
    ...     focal_length=50e-3,
    ...     f_number=2.8,
    ...     wavelength=550e-9,
    ...     pupil=optics.Pupil.from_waves({8: 0.1}, wavelength=550e-9),
    ... )
    >>> strehl = psf.strehl_ratio()
    >>> print(f"Strehl ratio {strehl.value:.4f}, error below 1e-6: {strehl.error < 1e-6}")
    Strehl ratio 0.6704, error below 1e-6: True
    >>> mtf = psf.modulation_transfer([100e3, 200e3])
    >>> print(f"MTF {mtf.value[0]:.2f} at 100/mm, {mtf.value[1]:.2f} at 200/mm, to {mtf.error[0]:.2f}")
    MTF 0.56 at 100/mm, 0.31 at 200/mm, to 0.01
    """
    nominal = reference_focal_length(focal_length)
    _check_numbers(nominal, f_number, wavelength, window)
    # Pupil and image plane are those of the nominal focal length; light is bent by that for its angle and wavelength.
    # The lens equation would give NaN for an infinite focus distance: that of a source at infinity replaces it.
    focus = source.distance if focus_distance is None else min(focus_distance, AS_AT_INFINITY)
    image = finite_image_distance(focus, nominal)
    if not image > 0:
        raise OutOfRangeError(
            "focus of the lens",
            value=f"{focus:g} m in front of a lens of {nominal:g} m",
            limit="a real image",
            remedy="focus beyond the focal length",
        )
    lens = CircularLens(
        radius=nominal / f_number / 2,
        focal_length=focal_length_for(focal_length, source, wavelength),
        lens_phase=lens_phase,
        focus_distance=focus if lens_phase == "stigmatic" else None,
        pupil=pupil,
    )
    centre = -image / source.distance * source.x + 0.0, -image / source.distance * source.y + 0.0  # never −0
    airy = FIRST_DARK_RING * wavelength * image / (2 * lens.radius)
    # A whole number of samples in each quarter, because the metrics compare all samples with every fourth.
    quarter = samples_in_quarter(window)
    field = aperture_field(
        source=source,
        lens=lens,
        targets=TargetGrid.centred(
            centre=centre, pitch=window * airy / (2 * quarter), count=4 * quarter + 1, distance=image
        ),
        wavelength=wavelength,
        method=method,
        accuracy=FieldAccuracy(tolerance=tolerance),
        obliquity=obliquity,
        limits=limits,
    )
    return _of_field(field, source, lens, centre, wavelength=wavelength, obliquity=obliquity, airy=airy)


def samples_in_quarter(window: float) -> int:
    """Steps between the samples along a quarter of the side of a window of `window` Airy radii."""
    return math.ceil(window * FIRST_DARK_RING * _SAMPLES_PER_PERIOD / 2)


def _check_numbers(focal_length: float, f_number: float, wavelength: float, window: float) -> None:
    """Refuse impossible numbers under their own names, before laws combine them."""
    if not 0 < focal_length < math.inf:
        raise OutOfRangeError(
            "focal length", value=f"{focal_length:g} m", limit="> 0, finite", remedy="describe a converging lens"
        )
    if not 0 < f_number < math.inf:
        raise OutOfRangeError(
            "f-number", value=f"{f_number:g}", limit="> 0, finite", remedy="divide focal length by pupil diameter"
        )
    if not 0 < wavelength < focal_length / f_number:
        raise OutOfRangeError(
            "wavelength",
            value=f"{wavelength:g} m",
            limit=f"> 0 and less than the pupil diameter of {focal_length / f_number:g} m",
            remedy="give it in metres: 550 nm are 550e-9",
        )
    if not _LEAST_WINDOW <= window < math.inf:
        raise OutOfRangeError(
            "window",
            value=f"{window:g} Airy radii",
            limit=f"≥ {_LEAST_WINDOW:g}, finite",
            remedy="widen it; the default is 20",
        )


def _of_field(
    field: ApertureField,
    source: PointSource,
    lens: CircularLens,
    centre: tuple[float, float],
    *,
    wavelength: float,
    obliquity: Obliquity,
    airy: float,
) -> LensPointSpread:
    """Intensity as a fraction of the light through the pupil, with the data of the lens."""
    samples = as_point_spread(field)
    # The reference peak is that of the same pupil without aberrations, seen through the same law.
    flat = replace(lens, pupil=replace(lens.pupil, zernikes={}, path=None)) if lens.pupil else lens
    paraxial = field.method == "fresnel"
    wave = lens_wave(source=source, lens=flat, wavelength=wavelength, paraxial=paraxial, obliquity=obliquity)
    kernel: Kernel = (
        FresnelKernel(wavelength=wavelength)
        if paraxial
        else KirchhoffKernel(wavelength=wavelength, obliquity=obliquity)
    )
    image = float(field.targets.coordinates()[2][0])
    return LensPointSpread(
        x=samples.x,
        y=samples.y,
        intensity=samples.intensity / samples.pupil_power,
        pupil_power=1.0,
        relative_error=samples.relative_error,
        centre=centre,
        airy_radius=airy,
        reference_peak=_peak_in_phase(wave, kernel, (*centre, image)) / samples.pupil_power,
        method=field.method,
        effort=field.effort,
    )


def _peak_in_phase(wave: LensWave, kernel: Kernel, point: tuple[float, float, float]) -> float:
    """Intensity at a point if the light of the whole pupil arrived there in phase."""
    nodes = wave.power_nodes(min(abs(wave.source.distance), point[2]))
    cosine = wave.axial_cosine(nodes.x, nodes.y) if wave.obliquity == "textbook" else None
    strength = wave.amplitude(nodes.x, nodes.y) * kernel.amplitude(
        nodes.x, nodes.y, cosine, *(np.array(c) for c in point)
    )
    return float(nodes.weights @ np.abs(strength)) ** 2
