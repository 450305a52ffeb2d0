"""Light of one wavelength, or of the declared spectrum."""

from __future__ import annotations

import math

from tradestudy.effects.base import OFF, Slot
from tradestudy.effects.picture.criteria import spectrum_width
from tradestudy.effects.picture.trial import PictureTrial, bounded, weighed


def spectrum(trial: PictureTrial) -> Slot:
    """Off: the central wavelength; weighted: the mean transfer over the spectrum, where one is declared."""
    width = spectrum_width(trial.spectrum_width)
    if math.isnan(trial.spectrum_width):
        reason = "the study declares one wavelength"
        return Slot(name="spectrum", models=(bounded(trial, OFF, 0.0, width, reason),))
    return Slot(
        name="spectrum",
        models=(
            weighed(trial, "spectrum", OFF, width,
                    "diffraction grows in proportion to wavelength, so that colours either side of the centre nearly "
                    "cancel: what is left counts where diffraction does and the spectrum is wide or one-sided"),
            weighed(trial, "spectrum", "weighted", width, "the mean over the declared wavelengths"),
        ),
    )  # fmt: skip
