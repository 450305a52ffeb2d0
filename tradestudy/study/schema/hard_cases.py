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
    """Computations that are numerically difficult, and study files that are difficult to read safely.

    Each computation is done by the textbook formula and by this program.
    """

    families: Annotated[tuple[FamilyName, ...], Field(min_length=1, max_length=len(EVERY_FAMILY))] = Field(
        default=EVERY_FAMILY,
        description="Groups of cases to compute: `thin-lens` (main lens and microlens array), `triangulation` (stereo "
        "rig), `phases` (long and short light paths), `fields` (light behind an aperture), `equation-27` (the paper's "
        "minimum f-number), `depth-of-field`, `propagation` (of uncertainty) and `study-files` (extreme values and "
        "harmful content).",
    )
