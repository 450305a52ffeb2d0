"""Light of one wavelength, or of the declared spectrum."""

from __future__ import annotations

import math

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.trial import PictureTrial, bounded, weighed


def spectrum(trial: PictureTrial) -> Slot:
    """Off: the central wavelength; weighted: the mean transfer over the spectrum, where one is declared."""
    width = "width of the spectrum over its centre"
    if math.isnan(trial.spectrum_width):
        reason = "the study declares one wavelength"
        return Slot(name="spectrum", models=(bounded(trial, OFF, 0.0, width, math.nan, reason),))
    return Slot(
        name="spectrum",
        models=(
            weighed(trial, "spectrum", OFF, criterion=width, number=trial.spectrum_width,
                    reason="diffraction grows in proportion to wavelength; colours above and below the centre nearly "
                    "cancel"),
            weighed(trial, "spectrum", "weighted", criterion=width, number=trial.spectrum_width,
                    reason="the mean over the declared wavelengths"),
        ),
    )  # fmt: skip
