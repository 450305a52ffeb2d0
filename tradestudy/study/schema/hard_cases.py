"""Which hard cases a study asks for; they need neither cameras nor a scene."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

from tradestudy.declarations.part import Part

FamilyName = Literal[
    "thin-lens", "triangulation", "phases", "fields", "equation-27", "depth-of-field", "propagation", "study-files"
]
EVERY_FAMILY: tuple[FamilyName, ...] = get_args(FamilyName)


class HardCasesPart(Part):
    """Numerically hard cases, computed by the usual formula and by this program."""

    families: Annotated[tuple[FamilyName, ...], Field(min_length=1, max_length=len(EVERY_FAMILY))] = Field(
        default=EVERY_FAMILY,
        description="Groups of cases to compute: `thin-lens`, of the main lens and the microlens array behind it; "
        "`triangulation`, of the stereo rig; `phases` of light paths; `fields` of light behind an aperture; "
        "`equation-27`, the minimum f-number of the paper; `depth-of-field`; `propagation` of uncertainty; and "
        "`study-files` with extreme values or harmful content.",
    )
