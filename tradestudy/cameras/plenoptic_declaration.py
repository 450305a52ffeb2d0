"""What a study declares of the calibration of a camera with a microlens array behind its main lens."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tradestudy.cameras.declaration import LengthErrorPart, NormalLengthErrorPart, error_of
from tradestudy.cameras.plenoptic import PlenopticCalibration
from tradestudy.declarations.part import Part


class PlenopticCalibrationPart(Part):
    """Calibration errors of a plenoptic camera; none may be left out, for none is zero."""

    mla_distance: NormalLengthErrorPart
    focal_length: NormalLengthErrorPart
    correlation: Annotated[float, Field(ge=-1.0, le=1.0, strict=True)] = Field(
        description="Between mla_distance and focal_length: calibration fixes their difference best."
    )
    microlens_gap: LengthErrorPart

    def errors(self) -> PlenopticCalibration:
        """In SI."""
        return PlenopticCalibration(
            mla_distance=error_of(self.mla_distance),
            focal_length=error_of(self.focal_length),
            correlation=self.correlation,
            microlens_gap=error_of(self.microlens_gap),
        )
