"""How models change the uncertainty off axis, where there is less light and calibration errors act differently."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import FieldPosition
from tradestudy.depth.linear import has_covariance, linearised_depth
from tradestudy.effects import OFF, Models
from tradestudy.imaging.models import PictureModels
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.building import in_closed_form, with_models


def closed_form_of(law: PictureDisparityError, models: Models) -> PictureModels:
    """A law's models, overridden by the closed form of `models` for the effects of the law's picture."""
    own = with_models(law.models, in_closed_form(models))
    return own if law.settings.spectrum else replace(own, spectrum=OFF)  # other forms of the camera may have a spectrum


@dataclass(frozen=True, kw_only=True, eq=False)
class OffAxis:
    """A camera at one field position, whose standard deviations of depth are computed once for all sets of models.

    Parameters
    ----------
    reference
        The camera with the most complete models in closed form.
    places, field
        Distances [m] and the field position.
    """

    reference: DepthCamera
    places: FloatArray
    field: FieldPosition

    def moved(self, models: Models) -> float:
        """The largest relative change of the uncertainty by models that replace the reference's, to first order."""
        noise, both = self._deviations
        moved = noise * _noise_changed(self.reference, self.places, self.field, models)
        with np.errstate(invalid="ignore", divide="ignore"):
            by_calibration = 0.0 if models.get("calibration") == OFF else np.maximum(both**2 - noise**2, 0.0)
            change = np.abs(np.sqrt(moved**2 + by_calibration) / both - 1.0)
        return float(np.nanmax(change, initial=0.0))

    @cached_property
    def _deviations(self) -> tuple[FloatArray, FloatArray]:
        """Standard deviations by noise and by all errors."""
        camera = self.reference
        noise = linearised_depth(camera, self.places, self.field, "noise").standard_deviation
        if not has_covariance(camera):  # then noise alone: it depends most on models
            return noise, noise
        return noise, linearised_depth(camera, self.places, self.field, "both").standard_deviation


def _noise_changed(reference: DepthCamera, places: FloatArray, field: FieldPosition, models: Models) -> FloatArray:
    """The factor by which noise changes; 1 where the disparity error is declared or the lens forms no picture."""
    law = reference.disparity_error_px
    if not isinstance(law, PictureDisparityError):
        return np.ones(places.shape)
    there = law.at_field(reference, reference.field_share(field))
    bound = there.bound_px(reference, places)
    other = replace(there, models=closed_form_of(there, models)).bound_px(reference, places)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = other / bound
    return there.matcher.change(bound, np.where(np.isnan(factor), 1.0, factor))
