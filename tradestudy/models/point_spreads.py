"""The point spread behind one declared lens: a sampled point-spread function and its measures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

import numpy as np

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.fresnel_validity import (
    bounded_minimum_f_number,
    collimated_minimum_distance,
    goodman_minimum_f_number,
    paper_eq27,
)
from tradestudy.optics.lateral_resolution import airy_radius
from tradestudy.optics.lens_point_spread import point_spread, samples_in_quarter
from tradestudy.optics.propagation.aperture import lens_wave
from tradestudy.optics.propagation.kernels import FresnelKernel, KirchhoffKernel
from tradestudy.optics.propagation.lens import CircularLens, LensPhase, PointSource
from tradestudy.optics.propagation.sampling import Limits, check_affordable, refuse_near_zone
from tradestudy.optics.propagation.targets import TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, nodes_for
from tradestudy.optics.psf_difference import PsfDifference, compared_points, fresnel_psf_difference
from tradestudy.optics.sampled_point_spread import Measured
from tradestudy.optics.spread_metrics import encircled_energy_radius, full_width_at_half_maximum, rms_width
from tradestudy.optics.spread_shares import modulation_transfer, share_on_neighbouring_pixels, share_outside_disc
from tradestudy.study.schema.wave_optics import ElementPart, FresnelValidityPart, PointSpreadPart, PsfMetric, listed
from tradestudy.units import LENGTH, pretty

SpreadMethod = Literal["fresnel", "kirchhoff"]
MEASURES: Final = (
    "full_width",
    "half_energy_radius",
    "energy_radius_80",
    "rms_width",
    "strehl_ratio",
    "transfer_half_nyquist",
    "outside_geometric",
    "neighbour_share",
)


@dataclass(frozen=True, kw_only=True)
class LensAndPoint:
    """A lens, its image plane in focus on ``object_distance``, and a point at that or another distance.

    Parameters
    ----------
    focal_length, object_distance
        f and the distance in focus a [m].
    f_number, wavelength, lens_phase
        F-number of the lens, wavelength of the light [m], and the lens phase.
    field_angle
        Direction of the point [rad].
    defocus_waves
        W: the point is at 1/a' = 1/a + 2 W λ/R², so its wave differs by W wavelengths at the rim of the pupil.

    Raises
    ------
    OutOfRangeError
        The defocus would put the point beyond infinity, or `refuse_near_zone` refuses the wavelength.
    """

    focal_length: float
    object_distance: float
    f_number: float
    wavelength: float
    lens_phase: LensPhase
    field_angle: float
    defocus_waves: float

    def __post_init__(self) -> None:
        refuse_near_zone(width=2 * self.radius, nearest=self.image_distance, wavelength=self.wavelength)
        if not self._vergence > 0:
            raise OutOfRangeError(
                "defocus that puts the object beyond infinity",
                value=f"{self.defocus_waves:g} waves at f/{self.f_number:g}",
                limit=f"> {-(self.radius**2) / (2 * self.object_distance * self.wavelength):.3g} waves",
            )

    @property
    def image_distance(self) -> float:
        """Distance of the image plane [m]."""
        return self.object_distance * self.focal_length / (self.object_distance - self.focal_length)

    @property
    def radius(self) -> float:
        """Radius of the pupil [m]."""
        return self.focal_length / self.f_number / 2

    @property
    def airy_radius(self) -> float:
        """Radius of the Airy disc in the image plane [m]."""
        return float(airy_radius(self.image_distance, 2 * self.radius, self.wavelength))

    @property
    def source(self) -> PointSource:
        """The point."""
        vergence = self._vergence
        return PointSource(x=math.tan(self.field_angle) / vergence, distance=1 / vergence)

    @property
    def _vergence(self) -> float:
        """1/a' [1/m]."""
        return 1 / self.object_distance + 2 * self.defocus_waves * self.wavelength / self.radius**2

    @property
    def geometric_radius(self) -> float:
        """Radius of the disc that paraxial rays fill [m]: R b |1/a' − 1/a|."""
        return 2 * abs(self.defocus_waves) * self.wavelength * self.image_distance / self.radius


def refuse_spreads(part: PointSpreadPart) -> None:
    """Refuse cases that are impossible or too large.

    Raises
    ------
    OutOfRangeError
        As for `LensAndPoint`.
    UnaffordableError
        The samples of a window exceed the limits of nodes, memory or time.
    """
    count = (4 * samples_in_quarter(part.window) + 1) ** 2
    for case in every_case(part):
        _refuse_large(case, window=part.window, count=count, tolerance=part.tolerance)


def refuse_comparison(part: FresnelValidityPart) -> None:
    """Refuse impossible comparisons, and those that are too large at the smallest f-number, which needs the most nodes.

    Raises
    ------
    OutOfRangeError
        As for `refuse_long_waves`.
    UnaffordableError
        The points of the windows exceed the limits of nodes, memory or time.
    """
    refuse_long_waves(part)
    lights = [(0.0, min(part.wavelengths))]
    lights += [] if part.off_axis is None else [(part.off_axis.field_angle, part.off_axis.wavelength)]
    for (angle, wavelength), phase in itertools.product(lights, part.lens_phases):
        count = compared_points(part.windows, symmetric=angle == 0.0)
        for element in part.elements.values():
            published = element.published_error if angle == 0.0 else None
            case = LensAndPoint(
                focal_length=element.focal_length,
                object_distance=element.object_distance,
                f_number=min(*listed(part.f_numbers), element.f_number, *([published.f_number] if published else [])),
                wavelength=wavelength,
                lens_phase=phase,
                field_angle=angle,
                defocus_waves=0.0,
            )
            _refuse_large(case, window=part.windows[-1], count=count, tolerance=part.tolerance)


def _refuse_large(case: LensAndPoint, *, window: float, count: int, tolerance: float) -> None:
    """Refuse either integral on `count` targets in a square about the chief ray, of half side `window` [Airy radii]."""
    half, middle = window * case.airy_radius, -case.image_distance / case.source.distance * case.source.x
    # Two corners suffice: the number of nodes depends on the outline of the targets alone.
    box = TargetPoints(
        x=middle + half * np.array([-1.0, 1.0]), y=half * np.array([-1.0, 1.0]), distance=case.image_distance
    )
    focus = case.object_distance if case.lens_phase == "stigmatic" else None
    lens = CircularLens(
        radius=case.radius, focal_length=case.focal_length, lens_phase=case.lens_phase, focus_distance=focus
    )
    accuracy = FieldAccuracy(tolerance=tolerance)
    kernels = FresnelKernel(wavelength=case.wavelength), KirchhoffKernel(wavelength=case.wavelength, obliquity="paper")
    try:
        for kernel in kernels:
            paraxial = isinstance(kernel, FresnelKernel)
            wave = lens_wave(source=case.source, lens=lens, wavelength=case.wavelength, paraxial=paraxial)
            nodes = nodes_for(wave, kernel, box, accuracy)
            check_affordable(nodes, targets=count, check_targets=accuracy.check_targets, limits=Limits())
    except UnaffordableError as error:
        raise UnaffordableError(
            f"the point-spread function at f/{case.f_number:g} in {pretty(case.wavelength, LENGTH)} light takes more "
            "nodes, memory or time than allowed",
            value=error.value,
            limit=error.limit,
            remedy=f"choose a smaller window than {window:g} Airy radii",
        ) from None


def refuse_long_waves(part: FresnelValidityPart) -> None:
    """Refuse light for which scalar diffraction does not hold behind the narrowest aperture of every lens."""
    longest = max([*part.wavelengths, part.off_axis.wavelength if part.off_axis else 0.0])
    for element in part.elements.values():
        width = element.focal_length / max(listed(part.f_numbers))
        refuse_near_zone(width=width, nearest=element.image_distance, wavelength=longest)


def every_case(part: PointSpreadPart) -> list[LensAndPoint]:
    """All cases of a study, lens by lens, with one parameter varied at a time."""
    return [
        lens_and_point(part, element, {parameter: value})
        for element in part.elements.values()
        for parameter, values in varied_values(part).items()
        for value in values
    ]


def varied_values(part: PointSpreadPart) -> Mapping[str, tuple[float, ...]]:
    """The varied parameters and their values."""
    return {
        "f_number": listed(part.f_numbers),
        "wavelength": part.wavelengths,
        "field_angle": part.field_angles,
        "defocus": part.defocus,
    }


def base_values(part: PointSpreadPart, element: ElementPart) -> Mapping[str, float]:
    """The value of each parameter while another is varied."""
    return {
        "f_number": element.f_number,
        "wavelength": part.reference_wavelength,
        "field_angle": 0.0,
        "defocus": 0.0,
    }


def lens_and_point(part: PointSpreadPart, element: ElementPart, changed: Mapping[str, float]) -> LensAndPoint:
    """A lens at its base values, with some of them changed."""
    values = {**base_values(part, element), **changed}
    return LensAndPoint(
        focal_length=element.focal_length,
        object_distance=element.object_distance,
        f_number=values["f_number"],
        wavelength=values["wavelength"],
        lens_phase=part.lens_phase,
        field_angle=values["field_angle"],
        defocus_waves=values["defocus"],
    )


def spread_measures(
    case: LensAndPoint, *, method: SpreadMethod, window: float, rms_radius: float, pixel_pitch: float, tolerance: float
) -> Mapping[str, tuple[float, float]]:
    """Every measure with its numerical error; NaN if it needs more than the window contains.

    Parameters
    ----------
    case
        Lens and point.
    method
        Law of propagation.
    window, rms_radius
        Half side of the sampled window, and radius for the rms width, in Airy radii.
    pixel_pitch
        Pitch of the pixels [m] for the Nyquist frequency and the neighbouring pixels.
    tolerance
        Tolerance on the intensity.
    """
    psf = point_spread(
        focal_length=case.focal_length,
        f_number=case.f_number,
        wavelength=case.wavelength,
        source=case.source,
        method=method,
        tolerance=tolerance,
        focus_distance=case.object_distance,
        lens_phase=case.lens_phase,
        window=window,
    )
    centre = psf.centre
    half_nyquist = np.array(1 / (4 * pixel_pitch))
    everything = Measured(value=np.array(1.0), error=np.array(0.0))
    measures: Mapping[str, Callable[[], Measured]] = {
        "full_width": lambda: full_width_at_half_maximum(psf, angle=math.pi / 2),
        "half_energy_radius": lambda: encircled_energy_radius(psf, centre=centre, share=0.5),
        "energy_radius_80": lambda: encircled_energy_radius(psf, centre=centre, share=0.8),
        "rms_width": lambda: rms_width(psf, centre=centre, radius=rms_radius * psf.airy_radius),
        "strehl_ratio": psf.strehl_ratio,
        "transfer_half_nyquist": lambda: modulation_transfer(
            psf, frequency_x=half_nyquist, frequency_y=np.zeros_like(half_nyquist)
        ),
        "outside_geometric": lambda: (
            share_outside_disc(psf, centre=centre, radius=case.geometric_radius)
            if case.geometric_radius > 0
            else everything
        ),
        "neighbour_share": lambda: share_on_neighbouring_pixels(psf, pitch=pixel_pitch, centre=centre),
    }
    return {measure: _or_nan(measures[measure]) for measure in MEASURES}


def _or_nan(measure: Callable[[], Measured]) -> tuple[float, float]:
    """A measure, or NaN if the sampled window cannot give it."""
    try:
        measured = measure()
    except OutOfRangeError:
        return math.nan, math.nan
    return float(measured.value), float(measured.error)


METRICS: tuple[PsfMetric, ...] = ("peak", "l1", "largest")
_ROOT_TOLERANCE = 1e-4


@lru_cache(maxsize=4096)
def psf_differences(
    element: ElementPart,
    *,
    f_number: float,
    field_angle: float,
    wavelength: float,
    lens_phases: tuple[LensPhase, ...],
    windows: tuple[float, ...],
    tolerance: float,
) -> Mapping[LensPhase, PsfDifference]:
    """`fresnel_psf_difference` of a declared lens, cached."""
    return fresnel_psf_difference(
        focal_length=element.focal_length,
        object_distance=element.object_distance,
        f_number=f_number,
        field_angle=field_angle,
        wavelength=wavelength,
        lens_phases=lens_phases,
        windows=windows,
        tolerance=tolerance,
    )


def limit_f_number(error_at: Callable[[float], float], f_numbers: Sequence[float], limit: float) -> float:
    """Smallest f-number above which an error stays below a limit.

    Parameters
    ----------
    error_at
        Error at an f-number.
    f_numbers
        Increasing; searched from the largest down, so that errors below the answer do not matter.
    limit
        The limit.

    Returns
    -------
    float
        0 if the error is below the limit at all of them, infinity if it exceeds the limit at the largest.
    """
    from scipy.optimize import brentq  # heavy, and few studies ask

    if error_at(f_numbers[-1]) > limit:
        return math.inf
    for below, above in zip(f_numbers[-2::-1], f_numbers[:0:-1], strict=True):
        if error_at(below) > limit:  # its logarithm is nearly a straight line over that of the f-number
            ends = math.log(below), math.log(above)
            root = brentq(lambda x: math.log(error_at(math.exp(x)) / limit), *ends, xtol=_ROOT_TOLERANCE)
            return math.exp(root)
    return 0.0


def paper_zeros(element: ElementPart, wavelengths: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Both zeros of the criterion as the paper prints it, shape (wavelength, 2), and its condition number."""
    criterion = paper_eq27(
        focal_length=element.focal_length, object_distance=element.object_distance, wavelength=np.asarray(wavelengths)
    )
    zeros = np.stack([criterion.first_zero_f_number, criterion.second_zero_f_number], axis=-1)
    return zeros, criterion.condition_number


def path_error_f_number(element: ElementPart, wavelength: FloatArray | float, waves: FloatArray | float) -> FloatArray:
    """Smallest f-number at which the path length that Fresnel neglects is at most a given number of waves."""
    return bounded_minimum_f_number(
        focal_length=element.focal_length,
        object_distance=element.object_distance,
        image_distance=element.image_distance,
        wavelength=wavelength,
        path_error_waves=waves,
    )


def goodman_f_number(element: ElementPart, wavelength: FloatArray | float) -> FloatArray:
    """Smallest f-number by Goodman's condition, leg by leg."""
    return goodman_minimum_f_number(
        focal_length=element.focal_length,
        object_distance=element.object_distance,
        image_distance=element.image_distance,
        wavelength=wavelength,
    )


def southwell_f_number(element: ElementPart, wavelength: FloatArray, error: float) -> FloatArray:
    """Smallest f-number at which Fresnel holds to an error in the image plane of a bare hole lit by a plane wave.

    The required distance grows as the 4/3 power of the radius, so one radius gives all others.
    """
    radius = element.focal_length / 2  # f/1
    needed = collimated_minimum_distance(aperture_radius=radius, wavelength=wavelength, intensity_error=error)
    return np.asarray((needed / element.image_distance) ** 0.75)
