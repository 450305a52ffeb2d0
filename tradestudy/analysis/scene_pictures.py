"""The pictures to render of a study's scene: its surfaces, the cameras that see them, and how sensors record them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from tradestudy.analysis.rendered_scene import pattern_of_scene, scene_of
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.light_cones import Exposure
from tradestudy.cameras.parts import Sensor
from tradestudy.declarations.part import MistakeAt
from tradestudy.errors import Problem, StudyError
from tradestudy.imaging.models import Texture
from tradestudy.imaging.render.tiles import Mosaic, Recording, Tile, drawn_errors
from tradestudy.imaging.scenes.pattern import RandomPattern
from tradestudy.imaging.scenes.scene import SceneSource
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.picture import PicturePart
from tradestudy.study.schema.scene import Rig, SceneImagePart

_WHERE: Final = ("scene", "image")


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """A camera of the study, with the errors and exposures of its pictures.

    Parameters
    ----------
    name, camera
        Name and design in the study.
    errors
        Deviations of the actual camera from its design, in SI.
    exposures
        Its pictures.
    reference_distance, stop_separation
        The arguments that gave its exposures [m]; see `Camera.exposures`.
    """

    name: str
    camera: Camera
    errors: Mapping[str, FloatArray]
    exposures: Sequence[Exposure]
    reference_distance: float
    stop_separation: float


def declared_image(definition: StudyDefinition) -> tuple[SceneImagePart, PicturePart]:
    """The declarations of the image and of its pictures; a missing one is reported as a mistake."""
    scene = definition.file.scene
    if scene is None or scene.image is None or scene.picture is None:
        problem = definition.document.locate(("scene",)).problem(
            _WHERE, "this key is missing: it declares the surfaces to render"
        )
        raise StudyError([problem])
    return scene.image, scene.picture


def set_up(
    definition: StudyDefinition, *, rig: Rig | None = None, texture_side: int | None = None
) -> tuple[SceneSource, list[Taken]]:
    """The scene and its cameras, with every mistake at its place; ``rig`` overrides that of the study.

    ``texture_side`` limits the samples before the texture repeats, which does not matter for a few patches.
    """
    image, picture = declared_image(definition)
    extent, cameras = extent_and_cameras(definition, rig=rig)
    exposures = [exposure for taken in cameras for exposure in taken.exposures]
    pattern = pattern_of_scene(texture_of(picture), exposures, extent, definition.file.propagation.seed)
    if texture_side is not None:
        pattern = replace(pattern, side=min(pattern.side, texture_side))
    return scene_of(image, pattern, definition.folder_of(_WHERE)), cameras


def extent_and_cameras(
    definition: StudyDefinition, *, rig: Rig | None = None
) -> tuple[tuple[float, float], list[Taken]]:
    """Nearest and farthest distance of the scene [m], and its cameras, before textures are generated."""
    image, picture = declared_image(definition)
    texture = texture_of(picture)
    flat = RandomPattern(texture=texture, sample=texture.correlation_length, side=2, seed=0)
    try:
        extent = scene_of(image, flat, definition.folder_of(_WHERE)).extent
    except MistakeAt as mistake:
        problems = [_problem(definition, (*_WHERE, *one.tail), one.what) for one in mistake.all]
        raise StudyError(problems) from None
    return extent, _cameras(definition, image, picture, sum(extent) / 2.0, rig or image.rig)


def texture_of(picture: PicturePart) -> Texture:
    """The texture of the surfaces."""
    return Texture(contrast=picture.texture.contrast, correlation_length=picture.texture.correlation_length)


def recording_of(image: SceneImagePart, picture: PicturePart, sensor: Sensor) -> Recording:
    """How a sensor records light."""
    settings = picture.settings(1.0, sensor)  # rays have no wavelength
    mosaic = image.mosaic
    return Recording(
        light=settings.light,
        noise=settings.sensor_noise,
        model=image.noise,
        black_level=image.black_level,
        pixel_fill=settings.pixel_fill,
        mosaic=None if mosaic is None else Mosaic(pattern=mosaic.pattern, response=mosaic.response),
    )


def whole_pictures(
    definition: StudyDefinition, image: SceneImagePart, scene: SceneSource, taken: Taken, recording: Recording
) -> list[Tile]:
    """All pictures of a camera by rays, each as one tile."""
    return [
        Tile(
            camera=taken.name,
            exposure=exposure,
            scene=scene,
            recording=recording,
            samples=image.samples or taken.camera.rays_per_pixel,
            seed=definition.file.propagation.seed,
            rows=(0, exposure.sensor.rows),
            columns=(0, exposure.sensor.columns),
        )
        for exposure in taken.exposures
    ]


def _problem(definition: StudyDefinition, path: tuple[str | int, ...], what: str) -> Problem:
    return definition.document.locate(path).problem(path, what)


def _cameras(
    definition: StudyDefinition, image: SceneImagePart, picture: PicturePart, middle: float, rig: Rig
) -> list[Taken]:
    found = []
    for name, camera in definition.case.all_cameras.items():
        if image.cameras is not None and name not in image.cameras:
            continue
        errors: Mapping[str, FloatArray] = {}
        environment = None
        if rig == "drawn" and isinstance(camera, DepthCamera):
            errors = drawn_errors(camera, name, definition.file.propagation.seed)
            environment = camera.calibration.environment
        exposures = camera.exposures(middle, errors, environment, picture.stop_separation)
        found.append(
            Taken(
                name=name,
                camera=camera,
                errors=errors,
                exposures=exposures,
                reference_distance=middle,
                stop_separation=picture.stop_separation,
            )
        )
    return found
