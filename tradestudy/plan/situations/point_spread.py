"""The spread of points behind single lenses: which law of propagation their width calls for."""

from __future__ import annotations

from typing import Final

from tradestudy.analysis.point_spreads import LensAndPoint, every_case
from tradestudy.effects.point_images import PointImage, diffraction_of_points
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.schema.wave_optics import PointSpreadPart

NAME: Final = "point-spread"


def point_spread_situation(part: PointSpreadPart) -> Situation:
    """The laws that could make the declared images of points; the width is the radius that holds half the light."""
    return Situation(
        name=NAME,
        title="Spread of points",
        quantities=("psf_width",),
        slots=(diffraction_of_points([point_image(case) for case in every_case(part)]),),
    )


def point_image(case: LensAndPoint) -> PointImage:
    """What the effects need to know of a case."""
    return PointImage(
        lens=case.lens,
        source=case.source,
        image_distance=case.image_distance,
        centre=case.chief_point,
        wavelength=case.wavelength,
    )
