"""The geometry of a camera's pictures: the quantities that blur, noise and matching window depend on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.matched_windows import ComparedPictures
from tradestudy.optics.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class LensStage:
    """One lens of a camera as it forms a picture; fields are arrays over distance unless noted otherwise.

    Parameters
    ----------
    aperture_diameter
        Aperture of the lens, or of the part of it that one view uses [m]; one number.
    focal_length
        Focal length [m].
    object_distance
        Distance from its object to the lens [m]; negative for a virtual object behind it, formed by the preceding lens.
    plane_distance
        Distance from the lens to its picture plane [m].
    blur_diameter
        Diameter of the geometric blur in that plane [m].
    relay
        Magnification from that plane to the sensor: 1, or that of the microlenses.
    """

    aperture_diameter: float
    focal_length: FloatArray
    object_distance: FloatArray
    plane_distance: FloatArray
    blur_diameter: FloatArray
    relay: FloatArray

    @cached_property
    def f_number(self) -> FloatArray:
        """Working f-number: distance of the picture plane divided by the aperture."""
        return np.asarray(self.plane_distance / self.aperture_diameter)

    @cached_property
    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Magnification to the sensor, f-number and blur [m], as columns that broadcast with a row of frequencies."""
        return column(self.relay), column(self.f_number), column(self.blur_diameter)

    def finest_period(self, wavelength: float) -> float:
        """Shortest period on the sensor [m] that the lens transmits at any distance; infinite without a picture."""
        period = wavelength * self.f_number * self.relay
        return float(np.min(period, initial=np.inf, where=period > 0.0))

    def defocus(self, wavelength: float) -> FloatArray:
        """Signed path error at the rim, ``A²/8 (1/a + 1/b − 1/f)/λ`` [waves]."""
        vergence = 1.0 / self.object_distance + 1.0 / self.plane_distance - 1.0 / self.focal_length
        return np.asarray(self.aperture_diameter**2 / 8.0 * vergence / wavelength)

    def at(self, index: NDArray[np.intp]) -> LensStage:
        """Select some of the distances, by index."""
        return LensStage(
            aperture_diameter=self.aperture_diameter,
            focal_length=self.focal_length[index],
            object_distance=self.object_distance[index],
            plane_distance=self.plane_distance[index],
            blur_diameter=self.blur_diameter[index],
            relay=self.relay[index],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PictureGeometry:
    """How a camera pictures objects at given distances; fields are arrays over distance unless noted otherwise.

    Parameters
    ----------
    distance
        Distances of the objects [m]; NaN in all arrays where the camera forms no picture.
    magnification
        Ratio of size on the sensor to size on the object.
    sample_pitch
        Distance between neighbouring samples of the matched picture [m]: the pixel pitch, or the microlens pitch for
        views with one sample per microlens. One number, as for all that follow except stages and ``light_f_number``.
    sample_width
        Side of the square, or diameter of the disc, from which a sample collects light [m].
    sample_shape
        ``square`` for pixels, ``disc`` for microlenses.
    pixel_pitch
        Pixel pitch of the sensor [m]; its pixels collect the electrons.
    compared
        The pictures that the estimator compares, with the windows that they share.
    light_f_number
        f-number of the cone that reaches a pixel, over distance.
    pupil_diameter
        Pupil of the main lens [m].
    main_lens, microlens
        The stages of the picture; no microlens if none blurs it.
    micro_image_diameter
        Diameter of the light behind one microlens [m]; infinite for a picture of the whole sensor.
    """

    distance: FloatArray
    magnification: FloatArray
    sample_pitch: float
    sample_width: float
    sample_shape: Literal["square", "disc"]
    pixel_pitch: float
    compared: ComparedPictures
    light_f_number: FloatArray
    pupil_diameter: float
    main_lens: LensStage
    microlens: LensStage | None
    micro_image_diameter: float = math.inf

    @property
    def blur_px(self) -> FloatArray:
        """Sum of the geometric blurs of the stages [samples]."""
        stages = [stage for stage in (self.main_lens, self.microlens) if stage is not None]
        return np.asarray(sum(stage.blur_diameter * stage.relay for stage in stages) / self.sample_pitch)

    def in_focus(self) -> PictureGeometry:
        """The same without geometric blur."""
        main_lens, microlens = (
            None if stage is None else replace(stage, blur_diameter=np.zeros_like(stage.blur_diameter))
            for stage in (self.main_lens, self.microlens)
        )
        assert main_lens is not None  # every camera has one
        return replace(self, main_lens=main_lens, microlens=microlens)

    def at(self, index: NDArray[np.intp]) -> PictureGeometry:
        """Select some of the distances, by index."""
        return replace(
            self,
            distance=self.distance[index],
            magnification=self.magnification[index],
            compared=self.compared.at(index),
            light_f_number=self.light_f_number[index],
            main_lens=self.main_lens.at(index),
            microlens=None if self.microlens is None else self.microlens.at(index),
        )


def column(values: FloatArray) -> FloatArray:
    """Values over distance as a column that broadcasts with a row of frequencies; one number if all are equal."""
    found = values[:, np.newaxis]
    return found[:1] if values.size and np.all(values == values[0]) else found
