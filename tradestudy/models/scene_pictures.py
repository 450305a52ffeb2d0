"""The choice between rays and waves for pictures of the study's scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.accuracy import Quantity
from tradestudy.effects import LENSES, OFF, Models, models_of
from tradestudy.errors import OutOfRangeError
from tradestudy.execution.steps import fingerprint
from tradestudy.imaging.render.sight import waves_of
from tradestudy.imaging.render.tiles import Tile, electrons_at
from tradestudy.imaging.render.waves import Waves
from tradestudy.models.problem import Change, Changes, SimulationProblem, Slot
from tradestudy.models.rendered_scene import declared_image, recording_of, set_up, whole_pictures
from tradestudy.study.prepared import PreparedStudy
from tradestudy.wording import NO_MICROLENSES

_PATCHES: Final = 3  # along each side of a picture; both models render them
_SIDE: Final = 24  # pixels along a patch
_SAMPLES: Final = 16  # enough that the models, and not the samples, make the difference
_OFFSET_STEP: Final = 4.0  # four times that of pictures; alters the change found by less than a tenth
TRIAL_TEXTURE: Final = 1024
"""Samples after which the texture of a trial repeats; patches are too few to show the repetition."""
_MARGIN: Final = 1.3  # on the trial, since a few patches do not represent the whole picture
_MOST_WAVES: Final = 60.0  # of defocus; beyond, the ray spot is hundreds of wavelengths wide


def name_of(camera: str) -> str:
    """Name of the problem of a camera's pictures."""
    return f"{camera}-pictures"


def picture_problems(study: PreparedStudy, forced: Models) -> Iterator[ScenePicturesProblem]:
    """One problem for each camera that takes pictures, as designed: its errors shift effects of waves but create none.

    Raises
    ------
    StudyError
        If the scene cannot be rendered.
    """
    image, picture = declared_image(study)
    scene, cameras = set_up(study, rig="as-designed", texture_side=TRIAL_TEXTURE)
    for taken in cameras:
        recording = recording_of(image, picture, taken.camera.sensor)
        yield ScenePicturesProblem(
            name=name_of(taken.name),
            title=f"Pictures by {study.file.cameras[taken.name].title}",
            pictures=whole_pictures(study, image, scene, taken, recording),
            wavelength=study.case.wavelength,
            forced=forced,
        )


class ScenePicturesProblem(SimulationProblem):
    """A camera's pictures of the scene, by rays or by waves on all legs; a trial finds what rays change.

    Parameters
    ----------
    name, title
        Name and title of the problem.
    pictures
        The pictures, each as one tile.
    wavelength
        Wavelength of the light [m].
    forced
        Models that the study prescribes; those that pictures do not have are ignored.

    Raises
    ------
    OutOfRangeError
        If rays are forced on one leg and waves on the other.
    """

    def __init__(self, *, name: str, title: str, pictures: Sequence[Tile], wavelength: float, forced: Models) -> None:
        self.name, self.title = name, title
        self.asked: tuple[Quantity, ...] = ("pixel_intensity",)
        self._pictures, self._wavelength = pictures, wavelength
        middle = np.zeros(1)
        # Rays through microlenses have a type of lens each; all others share one.
        microlenses = not isinstance(pictures[0].exposure.cones(middle, middle).lens_type, int)
        self._legs = LENSES if microlenses else LENSES[:1]
        self._forced = {leg: forced[leg] for leg in self._legs if forced.get(leg) in models_of(leg, "picture")}
        reason = "" if self._forced or self._in_reach() else "a blur of hundreds of wavelengths, for which rays suffice"
        self.slots = tuple(
            Slot(
                name=leg,
                models=models_of(leg, "picture") if leg in self._legs and not reason else (OFF,),
                reason=reason if leg in self._legs else NO_MICROLENSES,
            ).under(self._forced)
            for leg in LENSES
        )
        if self._by_waves(self.complete) is None:
            raise OutOfRangeError(
                f"forced models of the pictures of {pictures[0].camera} cannot be combined",
                value=", ".join(f"{leg}: {model}" for leg, model in self._forced.items()),
                limit="rays on both legs, or waves on both",
                remedy="set both legs to 'off', or both to fresnel",
            )
        self._done: list[tuple[float, float]] = []

    def changes(self, models: Models) -> Changes:
        """Relative L2 change of the pixels by rays instead of waves, over patches of every picture."""
        if (by_waves := self._by_waves(models)) is None:
            return {"pixel_intensity": Change(relative=math.inf, least=math.inf)}
        if by_waves == self._by_waves(self.complete):
            return {"pixel_intensity": Change(relative=0.0)}
        if len(self._done) < len(self._pictures):
            return {"pixel_intensity": Change(relative=math.inf, evidence="trial")}
        changed, light = (math.fsum(column) for column in zip(*self._done, strict=True))
        relative = _MARGIN * math.sqrt(changed / light) if light > 0.0 else 0.0
        return {"pixel_intensity": Change(relative=relative, evidence="trial")}

    def try_out(self, models: Models) -> bool:
        """Render patches of one more picture by rays and by waves."""
        by_waves = self._by_waves(models)
        if by_waves is None or by_waves == self._by_waves(self.complete) or len(self._done) == len(self._pictures):
            return False
        tile, waves = self._pictures[len(self._done)], self._waves[len(self._done)]
        self._done.append(_changed(_Trial(key=fingerprint(tile, self._wavelength), tile=tile, waves=waves)))
        return True

    def _by_waves(self, models: Models) -> bool | None:
        """Whether waves are used, None if legs conflict; rays on one leg mean rays on both unless waves are forced."""
        if all(models[leg] != OFF for leg in self._legs):
            return True
        return None if any(model != OFF for model in self._forced.values()) else False

    def _in_reach(self) -> bool:
        """Whether all pictures are close enough to focus that waves could differ from rays."""
        return all(max(map(abs, lens.defocus)) < _MOST_WAVES for waves in self._waves for lens in waves.lenses)

    @cached_property
    def _waves(self) -> list[Waves]:
        """How waves would render each picture."""
        return [waves_of(tile.exposure, tile.scene, self._wavelength) for tile in self._pictures]


@dataclass(frozen=True, kw_only=True)
class _Trial:
    """A picture of which both models render patches; trials of the same picture are equal."""

    key: bytes
    tile: Tile = field(compare=False)
    waves: Waves = field(compare=False)


@lru_cache(maxsize=64)  # a run plans the same pictures more than once
def _changed(trial: _Trial) -> tuple[float, float]:
    """Sums of squares over patches: of the change by rays, and of the picture by waves [electrons²]."""
    tile, waves = replace(trial.tile, samples=_SAMPLES), replace(trial.waves, offset_step=_OFFSET_STEP)
    down, across = (_patches(end) for end in (tile.rows[1], tile.columns[1]))
    rows, columns = (grid.ravel() for grid in np.meshgrid(down, across, indexing="ij"))
    rays, whole = (electrons_at(replace(tile, waves=model), rows, columns)[0] for model in (None, waves))
    return float(np.sum(np.square(rays - whole))), float(np.sum(np.square(whole)))


def _patches(size: int) -> NDArray[np.intp]:
    """Pixels of patches along an axis, each centred in one of `_PATCHES` equal parts."""
    middles = [(2 * k + 1) * size // (2 * _PATCHES) for k in range(_PATCHES)]
    return np.concatenate(
        [np.arange(max(0, middle - _SIDE // 2), min(size, middle + _SIDE // 2)) for middle in middles]
    )
