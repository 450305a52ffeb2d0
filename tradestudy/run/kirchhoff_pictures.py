"""Kirchhoff's part of the pictures that disparity errors are derived from, before depth asks for it: it takes long."""

from __future__ import annotations

from tradestudy.execution.steps import Progress
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.imaging.kirchhoff import kirchhoff_correction
from tradestudy.imaging.optical_transfer import kirchhoff_points
from tradestudy.study.definition import StudyDefinition

STEP = "pictures"


def compute_kirchhoff_pictures(definition: StudyDefinition, progress: Progress) -> None:
    """Compute what Kirchhoff adds to Fresnel for every camera over the study's distances, telling how far it is.

    It is kept where transfers look for it. Nothing is done, or told, where no camera's models need it.
    """
    points = dict.fromkeys(
        point
        for camera in definition.case.cameras.values()
        if isinstance(law := camera.disparity_error_px, PictureDisparityError)
        for point in kirchhoff_points(camera.picture_geometry(definition.case.distance), law.settings, law.models)
    )
    for number, point in enumerate(points):
        progress(STEP, number / len(points))
        kirchhoff_correction(*point)
    if points:
        progress(STEP, 1.0)
