"""The pictures to render of a study's scene: its surfaces, the cameras that see them, and how sensors record them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from tradestudy.cameras.camera import Camera
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.light_cones import Exposure
from tradestudy.cameras.parts import Sensor
from tradestudy.declarations.part import MistakeAt
from tradestudy.errors import Problem, StudyError
from tradestudy.imaging.models import Texture
from tradestudy.imaging.render.tiles import Mosaic, Recording, Tile, drawn_errors
from tradestudy.imaging.scenes.pattern import PicturePattern, RandomPattern, read_depths, read_picture
from tradestudy.imaging.scenes.scene import DepthMapSurface, Rock, SceneSource, SurfaceSource
from tradestudy.imaging.scenes.surfaces import Flat, Sphere
from tradestudy.optics.arrays import FloatArray
from tradestudy.provenance import file_hash
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.scene import (
    DepthMapPart,
    PicturePart,
    PlanePart,
    Rig,
    RockPart,
    SceneImagePart,
    SpherePart,
    StairsPart,
)

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


def declared_image(study: PreparedStudy) -> tuple[SceneImagePart, PicturePart]:
    """The declarations of the image and of its pictures; a missing one is reported as a mistake."""
    scene = study.file.scene
    if scene is None or scene.image is None or scene.picture is None:
        problem = study.document.locate(("scene",)).problem(
            _WHERE, "this key is missing: it declares the surfaces to render"
        )
        raise StudyError([problem])
    return scene.image, scene.picture


def set_up(
    study: PreparedStudy, *, rig: Rig | None = None, texture_side: int | None = None
) -> tuple[SceneSource, list[Taken]]:
    """The scene and its cameras, with every mistake at its place; ``rig`` overrides that of the study.

    ``texture_side`` limits the samples before the texture repeats, which does not matter for a few patches.
    """
    image, picture = declared_image(study)
    extent, cameras = extent_and_cameras(study, rig=rig)
    exposures = [exposure for taken in cameras for exposure in taken.exposures]
    pattern = pattern_of_scene(texture_of(picture), exposures, extent, study.file.propagation.seed)
    if texture_side is not None:
        pattern = replace(pattern, side=min(pattern.side, texture_side))
    return scene_of(image, pattern, study.document.folder_of(_WHERE)), cameras


def extent_and_cameras(study: PreparedStudy, *, rig: Rig | None = None) -> tuple[tuple[float, float], list[Taken]]:
    """Nearest and farthest distance of the scene [m], and its cameras, before textures are generated."""
    image, picture = declared_image(study)
    texture = texture_of(picture)
    flat = RandomPattern(texture=texture, sample=texture.correlation_length, side=2, seed=0)
    try:
        extent = scene_of(image, flat, study.document.folder_of(_WHERE)).extent
    except MistakeAt as mistake:
        problems = [_problem(study, (*_WHERE, *detail.tail), detail.what) for detail in mistake.all]
        raise StudyError(problems) from None
    return extent, _cameras(study, image, picture, sum(extent) / 2.0, rig or image.rig)


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
    study: PreparedStudy, image: SceneImagePart, scene: SceneSource, taken: Taken, recording: Recording
) -> list[Tile]:
    """All pictures of a camera by rays, each as one tile."""
    return [
        Tile(
            camera=taken.name,
            exposure=exposure,
            scene=scene,
            recording=recording,
            samples=image.samples or taken.camera.rays_per_pixel,
            seed=study.file.propagation.seed,
            rows=(0, exposure.sensor.rows),
            columns=(0, exposure.sensor.columns),
        )
        for exposure in taken.exposures
    ]


def _problem(study: PreparedStudy, path: tuple[str | int, ...], message: str) -> Problem:
    return study.document.locate(path).problem(path, message)


def _cameras(study: PreparedStudy, image: SceneImagePart, picture: PicturePart, middle: float, rig: Rig) -> list[Taken]:
    taken = []
    for camera_name, camera in study.case.all_cameras.items():
        if image.cameras is not None and camera_name not in image.cameras:
            continue
        errors: Mapping[str, FloatArray] = {}
        environment = None
        if rig == "drawn" and isinstance(camera, DepthCamera):
            if camera.calibration.vocabulary is not None or not camera.calibration.inferred:
                message = (
                    f"errors cannot be drawn for the pictures of {camera_name}, because it is an imported or fitted "
                    "rig; write rig: as-designed, or leave it out of scene.image.cameras"
                )
                raise StudyError([_problem(study, ("scene", "image", "rig"), message)])
            errors = drawn_errors(camera, camera_name, study.file.propagation.seed)
            environment = camera.calibration.environment
        exposures = camera.exposures(middle, errors, environment, picture.stop_separation)
        taken.append(
            Taken(
                name=camera_name,
                camera=camera,
                errors=errors,
                exposures=exposures,
                reference_distance=middle,
                stop_separation=picture.stop_separation,
            )
        )
    return taken


_SIDES: Final = (512, 4096)  # least and most samples of a random texture before it repeats
_CORRELATION_LENGTHS: Final = 16  # minimum number within the texture
_OVERLAP: Final = 1e-6  # share of its height by which a riser extends past its treads, so that no ray slips through


def scene_of(part: SceneImagePart, pattern: RandomPattern, folder: Path) -> SceneSource:
    """The scene in SI units.

    Parameters
    ----------
    part
        The declaration.
    pattern
        Texture of every surface that has no picture of its own.
    folder
        Folder of the files that the declaration names.

    Raises
    ------
    MistakeAt
        A file is not a depth map or picture, or their sizes differ; the position is relative to the part.
    """
    surfaces: list[SurfaceSource] = []
    for number, surface in enumerate(part.surfaces):
        if isinstance(surface, PlanePart):
            surfaces.append(_plane(surface, pattern))
        elif isinstance(surface, StairsPart):
            surfaces += _stairs(surface, pattern)
        elif isinstance(surface, SpherePart):
            sphere = Sphere(centre=(*surface.centre, surface.distance), radius=surface.radius, pattern=pattern)
            surfaces.append(sphere)
        elif isinstance(surface, RockPart):
            surfaces.append(
                Rock(
                    near=surface.near,
                    far=surface.far,
                    feature_size=surface.feature_size,
                    hurst=surface.hurst,
                    seed=pattern.seed,
                    number=number,
                    pattern=pattern,
                )
            )
        else:
            surfaces.append(_map(surface, ("surfaces", number), pattern, folder))
    return SceneSource(surfaces=tuple(surfaces), background=part.background)


def plane_across(distance: float, pattern: RandomPattern) -> SceneSource:
    """An infinite plane perpendicular to the axis at a distance [m]."""
    plane = Flat(
        centre=(0.0, 0.0, distance),
        first=(1.0, 0.0, 0.0),
        second=(0.0, 1.0, 0.0),
        size=(math.inf, math.inf),
        pattern=pattern,
    )
    return SceneSource(surfaces=(plane,), background=0.0)


def pattern_of_scene(
    texture: Texture, exposures: Sequence[Exposure], extent: tuple[float, float], seed: int
) -> RandomPattern:
    """A texture about as wide as the visible scene, with two samples across the smallest spot that a pixel averages."""
    finest, widest = math.inf, 0.0
    for exposure in exposures:
        sensor = exposure.sensor
        # The middle and the corners of the sensor, and five depths, stand for all others.
        x = np.array([0.0, -0.5, 0.5, -0.5, 0.5]) * sensor.width
        y = np.array([0.0, -0.5, -0.5, 0.5, 0.5]) * sensor.height
        cones = exposure.cones(x, y)
        for depth in np.linspace(*extent, 5):
            by_pixel = (cones.start_by_pixel + depth * np.asarray(cones.slope_by_pixel)) * sensor.pixel_pitch
            by_lens = (cones.start_by_lens + depth * np.asarray(cones.slope_by_lens)) * cones.lens_radius
            finest = min(finest, float(np.min(np.hypot(by_pixel, by_lens))))
        place = cones.start + extent[1] * cones.slope
        widest = max(widest, 2.0 * float(np.max(np.abs(place))) + 2.0 * abs(exposure.pose.centre[0]))
    least, most = _SIDES
    sample = max(finest / 2.0, _CORRELATION_LENGTHS * texture.correlation_length / most)
    needed = max(widest, _CORRELATION_LENGTHS * texture.correlation_length) / sample
    side = min(max(2 ** round(math.log2(max(needed, 1.0))), least), most)
    return RandomPattern(texture=texture, sample=sample, side=side, seed=seed)


def _plane(part: PlanePart, pattern: RandomPattern) -> Flat:
    """A tilted plane; its first direction lies in the x–z plane, and its second is perpendicular to the first."""
    first = np.array([1.0, 0.0, math.tan(part.tilt_x)])
    second = np.array([0.0, 1.0, math.tan(part.tilt_y)])
    first /= np.linalg.norm(first)
    second -= first * (first @ second)
    second /= np.linalg.norm(second)
    return Flat(
        centre=(*part.centre, part.distance),
        first=(float(first[0]), float(first[1]), float(first[2])),
        second=(float(second[0]), float(second[1]), float(second[2])),
        size=part.size or (math.inf, math.inf),
        pattern=pattern,
        origin=part.centre,
    )


def _stairs(part: StairsPart, pattern: RandomPattern) -> Iterator[Flat]:
    """Treads and risers; the first and the last tread extend far beyond the view of any camera."""
    across, down, along = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    endless = 1e3 * part.far
    depths = np.linspace(part.near, part.far, part.treads)
    inner = (np.arange(part.treads - 1) - (part.treads - 2) / 2.0) * (part.tread_width or 0.0) + part.edge
    edges = [part.edge - endless, *(float(edge) for edge in inner), part.edge + endless]
    for k, depth in enumerate(float(tread) for tread in depths):
        left, right = edges[k], edges[k + 1]
        middle = (left + right) / 2.0
        yield Flat(
            centre=(middle, 0.0, depth),
            first=across,
            second=down,
            size=(right - left, math.inf),
            pattern=pattern,
            origin=(middle, 0.0),
        )
        if k:
            height = depth - float(depths[k - 1])
            yield Flat(
                centre=(left, 0.0, depth - height / 2.0),
                first=along,
                second=down,
                size=(height * (1.0 + _OVERLAP), math.inf),
                pattern=pattern,
                origin=(left, 0.0),
            )


def _map(part: DepthMapPart, at: tuple[str | int, ...], texture: RandomPattern, folder: Path) -> DepthMapSurface:
    """A depth map; its files are read here once, so that a faulty one is refused before anything is rendered."""
    try:
        file = folder / part.depth
        depths = read_depths(file, part.unit)
    except ValueError as error:
        raise MistakeAt((*at, "depth"), str(error)) from error
    pattern: RandomPattern | PicturePattern = texture
    if part.picture is not None:
        try:
            shape = read_picture(folder / part.picture).shape[1:]
        except ValueError as error:
            raise MistakeAt((*at, "picture"), str(error)) from error
        if shape != depths.shape:
            raise MistakeAt((*at, "picture"), f"has {shape} rows and columns, but the depth map has {depths.shape}")
        picture = folder / part.picture
        pattern = PicturePattern(file=picture, sha256=file_hash(picture), sample=1.0, from_top=part.first_row == "top")
    return DepthMapSurface(
        file=file,
        sha256=file_hash(file),
        unit=part.unit,
        from_top=part.first_row == "top",
        width=part.width,
        field_of_view=part.field_of_view,
        extent=(float(depths.min()), float(depths.max())),
        pattern=pattern,
        pattern_in_samples=part.picture is not None,
    )
