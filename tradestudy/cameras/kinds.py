"""All kinds of cameras that a study may declare. A new kind needs a package beside these and an entry here."""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Final

from pydantic import Field

from tradestudy.cameras.conventional.declaration import ConventionalDeclaration
from tradestudy.cameras.declaration import CameraDeclaration
from tradestudy.cameras.focused_plenoptic.declaration import FocusedPlenopticDeclaration
from tradestudy.cameras.stereo.declaration import StereoDeclaration
from tradestudy.cameras.unfocused_plenoptic.declaration import UnfocusedPlenopticDeclaration

KINDS: Final[tuple[type[CameraDeclaration], ...]] = (
    FocusedPlenopticDeclaration,
    UnfocusedPlenopticDeclaration,
    StereoDeclaration,
    ConventionalDeclaration,
)

if TYPE_CHECKING:
    CameraPart = CameraDeclaration
else:
    CameraPart = Annotated[reduce(or_, KINDS), Field(discriminator="kind")]
