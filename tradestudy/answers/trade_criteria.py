"""Trade criteria with a single value: declared if the study states them, else derived from its other inputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from tradestudy.cameras.camera import Camera
from tradestudy.cameras.declaration import AttributesPart
from tradestudy.cameras.focus import BlurCriterion, EveryObjectFocus
from tradestudy.errors import Problem, StudyError
from tradestudy.optics.triangulation import foreshortening_ratio, hidden_strip_width
from tradestudy.study.prepared import Case, PreparedStudy
from tradestudy.study.schema.requirements import DERIVED as DIMENSIONS
from tradestudy.study.schema.requirements import criterion_dimension, is_number
from tradestudy.units import DURATION, FRACTION, LENGTH, NUMBER, parse, pretty, significant

DERIVED: Final = "derived"
_NOT_STATED: Final = "not stated"


@dataclass(frozen=True, kw_only=True)
class Attribute:
    """One trade criterion of one camera: its text, its number in SI if it has one, and its basis."""

    text: str
    number: float = math.nan
    basis: str = DERIVED


@dataclass(frozen=True, kw_only=True)
class Relief:
    """The scene for which criteria are derived.

    Parameters
    ----------
    near, far
        The range that must be sharp [m].
    sharp
        The criterion of sharpness.
    step_height
        Height h of a depth step [m] whose edge lies in the middle of the scene.
    surface_tilt
        Tilt of a surface there [rad].
    """

    near: float
    far: float
    sharp: BlurCriterion
    step_height: float
    surface_tilt: float

    @property
    def middle(self) -> float:
        """The middle of the range [m]."""
        return (self.near + self.far) / 2.0

    @classmethod
    def of(cls, case: Case) -> Relief:
        """The relief of a study that declares one, with its first criterion of sharpness."""
        assert case.relief is not None  # callers ensure it, and a relief needs a depth of field
        assert case.depth_of_field is not None
        return cls(
            near=case.depth_of_field.range[0],
            far=case.depth_of_field.range[1],
            sharp=next(iter(case.sharp.values())),
            step_height=case.relief.step_height,
            surface_tilt=case.relief.surface_tilt,
        )


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """A row of the comparison: its name, its meaning, and the function that computes it.

    Parameters
    ----------
    path
        Path below a camera in the study file where it may be declared; empty if it is always derived.
    """

    name: str
    says: str
    of: Callable[[Camera, AttributesPart, Relief], Attribute]
    path: str = ""

    @property
    def units(self) -> str:
        """SI unit of its numbers; empty for words."""
        dimension = DIMENSIONS[self.name]
        return "" if dimension is None else dimension.unit or "1"


def _images(camera: Camera, relief: Relief) -> int:
    return camera.focus.images(relief.sharp, relief.near, relief.far)


def _moving_parts(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:  # noqa: ARG001 - one signature for all
    declared = part.moving_parts
    count = camera.focus.mechanisms if declared is None else declared
    return Attribute(text=str(count), number=float(count), basis=DERIVED if declared is None else "")


def _images_per_scene(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:  # noqa: ARG001
    count = _images(camera, relief)
    if count == 0:
        return Attribute(text="no number suffices")
    share = camera.focus.sharp_range(relief.sharp).share_of(relief.near, relief.far)
    text = str(count) + (" by each lens" if camera.lens_count == 2 and count == 1 else "")
    if share < 1.0 and not isinstance(camera.focus, EveryObjectFocus):
        text += f", {pretty(share, FRACTION, 2)} sharp" if share > 0.0 else ", nothing sharp"
    return Attribute(text=text, number=float(count))


def _time_per_scene(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:  # noqa: ARG001
    images = _images(camera, relief)
    if images == 0:
        return Attribute(text="—")
    if not camera.takes_stack or images == 1:
        return Attribute(text="one exposure" if images == 1 else f"{images} exposures")
    if camera.time_per_image is None:
        return Attribute(text=f"{images} exposures; time per image {_NOT_STATED}")
    seconds = images * camera.time_per_image
    return Attribute(text=pretty(seconds, DURATION), number=seconds)


def _data_volume(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:
    if not camera.makes_depth_map:
        return Attribute(text="no depth map")
    pixels = camera.pixel_count * _images(camera, relief)
    if pixels == 0:
        return Attribute(text="—")
    bits = part.bits_per_pixel
    if bits is None:
        return Attribute(text=f"{pixels / 1e6:.3g} Mpx; bits per pixel {_NOT_STATED}")
    return Attribute(text=f"{pixels * bits / 8e6:.3g} MB", number=pixels * bits)


def _depth_map_samples(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:  # noqa: ARG001
    """Number of independent lateral samples in one all-in-focus image at the middle of the scene."""
    lens = camera.gathering_lens
    # The inverse of the magnification, by Newton's equation.
    object_scale = (float(camera.from_pupil(relief.middle)) - lens.front_focus) / lens.focal_length
    resolved = float(camera.focus.lateral_resolution(relief.middle, relief.sharp.wavelength).size)
    field = camera.sensor.width * camera.sensor.height * object_scale**2
    count = field / resolved**2
    size, unit = next(pair for pair in ((1e6, " M"), (1e3, " k"), (1.0, "")) if count >= pair[0] or pair[0] == 1.0)
    return Attribute(text=significant(count / size) + unit, number=count)


def _aperture(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:  # noqa: ARG001
    diameter = camera.gathering_lens.pupil_diameter
    twice = "2 × " if camera.lens_count == 2 else ""
    return Attribute(text=twice + pretty(diameter, LENGTH), number=diameter)


def _light(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:  # noqa: ARG001
    """Solid angle of the light that one exposure gathers from the middle of the scene, over all lenses."""
    half, away = camera.gathering_lens.pupil_diameter / 2.0, float(camera.from_pupil(relief.middle))
    solid_angle = 2.0 * math.pi * (1.0 - away / math.hypot(away, half)) * camera.lens_count
    return Attribute(text=f"{solid_angle * 1e6:.3g} µsr", number=solid_angle)


def _size(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:
    envelope = part.envelope
    if envelope is not None:
        return Attribute(text=" × ".join(pretty(side, LENGTH) for side in envelope), basis="")
    lens = camera.gathering_lens
    across = max(camera.sensor.diagonal, lens.pupil_diameter) + camera.separation
    along = lens.principal_separation + camera.depth_behind_lens(relief.near)
    return Attribute(text=f"{pretty(along, LENGTH)} × {pretty(across, LENGTH)}")


def _hidden_strip(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:  # noqa: ARG001
    if not camera.makes_depth_map:
        return Attribute(text="a single view")
    width = float(hidden_strip_width(relief.step_height, camera.from_pupil(relief.middle), camera.view_baseline))
    return Attribute(text=pretty(width, LENGTH), number=width)


def _foreshortening(camera: Camera, part: AttributesPart, relief: Relief) -> Attribute:  # noqa: ARG001
    if not camera.makes_depth_map:
        return Attribute(text="a single view")
    away = camera.from_pupil(relief.middle)
    ratio = float(foreshortening_ratio(relief.surface_tilt, away, camera.view_baseline))
    return Attribute(text=pretty(ratio, NUMBER), number=ratio)


CRITERIA: Final = (
    Criterion(
        name="moving parts",
        says="mechanisms that must work",
        of=_moving_parts,
        path="attributes.moving_parts",
    ),
    Criterion(
        name="images per scene",
        says="exposures to cover the scene under the first blur criterion, and the sharp share if they do not suffice",
        of=_images_per_scene,
    ),
    Criterion(
        name="time per scene", says="duration of all exposures and of the refocusing between them", of=_time_per_scene
    ),
    Criterion(
        name="data per depth map",
        says="raw pixels of all exposures of one depth map, before compression",
        of=_data_volume,
    ),
    Criterion(
        name="resolved samples",
        says="field of view at the middle of the scene, divided by the area of one resolved detail there",
        of=_depth_map_samples,
    ),
    Criterion(name="aperture", says="diameter of the pupil that gathers the light", of=_aperture),
    Criterion(
        name="light gathered",
        says="solid angle of the pupils, all lenses together, as seen from a point in the middle of the scene",
        of=_light,
    ),
    Criterion(
        name="size",
        says="declared, or a lower bound: distance from principal plane to sensor × (wider of lens and sensor, plus "
        "baseline)",
        of=_size,
        path="attributes.envelope",
    ),
    Criterion(
        name="hidden beside a step",
        says="strip on the lower surface that one of the two outermost views cannot see, h B/Z at a step of height h",
        of=_hidden_strip,
    ),
    Criterion(
        name="foreshortening",
        says="ratio of the widths of a tilted patch in the two outermost views",
        of=_foreshortening,
    ),
)


def criterion_of(case: Case, camera: str, name: str) -> Attribute:
    """One criterion of one camera of a study, declared or derived for the relief."""
    attributes = case.attributes[camera]
    derived = next((criterion for criterion in CRITERIA if criterion.name == name), None)
    if derived is not None:
        return derived.of(case.all_cameras[camera], attributes, Relief.of(case))
    text = attributes.others.get(name)
    if text is None:
        return Attribute(text=_NOT_STATED, basis="")
    dimension = criterion_dimension(name, case.attributes.values())
    if dimension is None or not is_number(text):
        return Attribute(text=text, basis="")
    return Attribute(text=text, number=parse(text, dimension), basis="")


def refuse_words(study: PreparedStudy) -> None:
    """Refuse, before anything is computed, to weigh a derived criterion that has no number for some camera.

    Raises
    ------
    StudyError
        At every such criterion.
    """
    part, case = study.file.trade_off, study.case
    if part is None:
        return
    problems: list[Problem] = []
    for criterion, weighed in part.criteria.items():
        if weighed.quantity is None:
            problems += _words(study, case, criterion, study.file.ranked)
    if problems:
        raise StudyError(problems)


def _words(study: PreparedStudy, case: Case, criterion: str, ranked: Sequence[str]) -> list[Problem]:
    path = ("trade_off", "criteria", criterion)
    attributes = {camera: criterion_of(case, camera, criterion) for camera in ranked}
    return [
        study.document.locate(path).problem(
            path,
            f"{camera!r} has no number for this criterion ({attribute.text}); leave the criterion out, or list "
            "candidates without this camera",
        )
        for camera, attribute in attributes.items()
        if math.isnan(attribute.number)
    ]
