"""The point spread behind one declared lens: a sampled point-spread function and its measures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.lens_point_spread import point_spread
from tradestudy.optics.propagation import LensPhase, PointSource
from tradestudy.optics.psf_difference import airy_radius
from tradestudy.optics.sampled_point_spread import Measured
from tradestudy.optics.spread_metrics import encircled_energy_radius, full_width_at_half_maximum, rms_width
from tradestudy.optics.spread_shares import modulation_transfer, share_on_neighbouring_pixels, share_outside_disc
from tradestudy.study.schema.wave_optics import ElementPart, PointSpreadPart, listed

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
_SAMPLES_PER_PERIOD = 8.0  # of the shortest period λ N_w of an intensity


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
    """

    focal_length: float
    object_distance: float
    f_number: float
    wavelength: float
    lens_phase: LensPhase
    field_angle: float
    defocus_waves: float

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
        return airy_radius(
            wavelength=self.wavelength, image_distance=self.image_distance, pupil_diameter=2 * self.radius
        )

    @property
    def source(self) -> PointSource:
        """The point.

        Raises
        ------
        OutOfRangeError
            The defocus would put it beyond infinity.
        """
        vergence = 1 / self.object_distance + 2 * self.defocus_waves * self.wavelength / self.radius**2
        if not vergence > 0:
            raise OutOfRangeError(
                "defocus that puts the object beyond infinity",
                value=f"{self.defocus_waves:g} waves at f/{self.f_number:g}",
                limit=f"> {-(self.radius**2) / (2 * self.object_distance * self.wavelength):.3g} waves",
            )
        return PointSource(x=math.tan(self.field_angle) / vergence, distance=1 / vergence)

    @property
    def geometric_radius(self) -> float:
        """Radius of the disc that paraxial rays fill [m]: R b |1/a' − 1/a|."""
        return 2 * abs(self.defocus_waves) * self.wavelength * self.image_distance / self.radius


def every_case(part: PointSpreadPart) -> list[LensAndPoint]:
    """All cases of a study, lens by lens, with one parameter varied at a time."""
    return [
        case_of(part, element, {name: value})
        for element in part.elements.values()
        for name, values in varied_values(part).items()
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


def case_of(part: PointSpreadPart, element: ElementPart, changed: Mapping[str, float]) -> LensAndPoint:
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
    return {name: _or_nan(measures[name]) for name in MEASURES}


def _or_nan(measure: Callable[[], Measured]) -> tuple[float, float]:
    """A measure, or NaN if the sampled window cannot give it."""
    try:
        found = measure()
    except OutOfRangeError:
        return math.nan, math.nan
    return float(found.value), float(found.error)
