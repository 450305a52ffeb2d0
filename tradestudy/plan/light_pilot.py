"""Predict the computing time of a light spot's picture: time samples of its work and scale them by their counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tradestudy.analysis.spot_images import RAYS, SpotModels, legs, light_path, light_source
from tradestudy.optics.chain import ChainAccuracy, DiscSource, LightPath
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import array_table, point_wave
from tradestudy.optics.chain.exact_rays import exact_ray_image, ray_count
from tradestudy.optics.chain.geometric_image import geometric_image
from tradestudy.optics.chain.image import microlenses_alone, nearest_microlens
from tradestudy.optics.chain.lit_disc import lit_disc
from tradestudy.optics.chain.point_image import compute_point, plan_point, reference_law
from tradestudy.optics.chain.scene import Legs
from tradestudy.optics.chain.source_tables import table_count
from tradestudy.optics.chain.sources import source_nodes
from tradestudy.optics.chain.spot_image import CHECKED_POINTS, followed_points
from tradestudy.optics.chain.spot_parts import source_density
from tradestudy.optics.chain.spot_points import point_light, prepare_spot
from tradestudy.optics.propagation import PointSource
from tradestudy.plan.pilots import seconds_of, timed
from tradestudy.study.schema.light_spot import LightSpotPart

_COARSE = 0.2  # tolerance of rays in a pilot
_PASSES = 3  # over a point: one for its light, one for the error estimate, and one by quadrature


def predicted_picture_seconds(part: LightSpotPart, models: SpotModels) -> float:
    """Computing time of a picture [s] on this machine under its present load, within a factor of 3.

    Raises
    ------
    TradestudyError
        If the picture itself would be refused: too many source points, or too much memory.
    """
    path, source = light_path(part), light_source(part)
    if models.point and isinstance(source, DiscSource):
        source = source.centre
    if not models.separate:
        return _seconds(part, path, source, models)
    owner = nearest_microlens(path)
    present = np.unique(owner)
    alone = microlenses_alone(path, [int(present[present.size // 2])], owner)
    return present.size * _seconds(part, alone, source, models)


def _seconds(part: LightSpotPart, path: LightPath, source: PointSource | DiscSource, models: SpotModels) -> float:
    accuracy = ChainAccuracy(tolerance=models.tolerance)
    if models.method in RAYS:
        return _seconds_of_rays(path, source, models, accuracy)
    lines = 1 if models.monochromatic else len(part.lines)
    laws, wavelength = legs(models.method), part.mean_wavelength
    if isinstance(source, DiscSource) and not source.coherent:
        return lines * _seconds_of_disc(path, source, wavelength, laws, accuracy)
    coherent_radius = source.diameter / 2.0 if isinstance(source, DiscSource) else 0.0
    point = source.centre if isinstance(source, DiscSource) else source
    return lines * _PASSES * _seconds_of_point(path, point, wavelength, laws, accuracy, coherent_radius)


def _seconds_of_rays(
    path: LightPath, source: PointSource | DiscSource, models: SpotModels, accuracy: ChainAccuracy
) -> float:
    if models.method == "geometric":
        alone = _nearest(path, source.centre if isinstance(source, DiscSource) else source)
        return path.microlenses.count * seconds_of(lambda: geometric_image(alone, source, density=1.0))
    coarse = ChainAccuracy(tolerance=_COARSE)
    seconds = seconds_of(lambda: exact_ray_image(path, source, accuracy=coarse))
    return seconds * max(1.0, ray_count(path, source, accuracy) / ray_count(path, source, coarse))


def _seconds_of_point(
    path: LightPath, point: PointSource, wavelength: float, laws: Legs, accuracy: ChainAccuracy, coherent_radius: float
) -> float:
    """Time of one pass over all that the point lights, scaled from one microlens by the samples on the detector."""
    wave = point_wave(path, point, wavelength=wavelength, legs=laws, coherent_radius=coherent_radius)
    alone = replace(wave, path=_nearest(path, point))
    whole, one = (plan_point(each, laws.to_detector, accuracy).detector.transfer.count for each in (wave, alone))
    return (whole / one) ** 2 * seconds_of(lambda: compute_point(alone, laws.to_detector, accuracy))


def _seconds_of_disc(
    path: LightPath, source: DiscSource, wavelength: float, laws: Legs, accuracy: ChainAccuracy
) -> float:
    """Time for the points of the disc, the tables of the main lens's field, and the separately checked points."""
    source = lit_disc(path, source, wavelength=wavelength, tolerance=accuracy.tolerance)
    nodes = source_nodes(path, source, wavelength=wavelength, density=source_density(accuracy))
    spot, seconds = timed(lambda: prepare_spot(path, source, nodes, wavelength, laws, accuracy, blank=True))
    table = spot.tables.tables[0] if spot.tables else None
    at = float(nodes.rings[-1][0, 0]), float(nodes.rings[-1][0, 1])
    seconds += followed_points(path, source, nodes) * seconds_of(lambda: point_light(spot, at, table).on_pixels(spot))
    check = Legs(to_array=laws.to_array, to_detector=reference_law(laws.to_detector))
    finer = accuracy.unstarved()
    seconds += CHECKED_POINTS * _seconds_of_point(path, source.centre, wavelength, check, finer, 0.0)
    if table is None:
        return seconds
    # The number of samples on the array grows like that of the nodes in the pupil.
    small = _nearest(path, source.centre)
    wave = spot.wave(source.x, source.y)
    assert isinstance(wave, PupilWave)  # rays have no tables
    wave = replace(wave, path=small)
    part, taken = timed(lambda: array_table(wave, accuracy))
    return seconds + table_count(accuracy) * table.coefficients.size * taken / part.coefficients.size


def _nearest(path: LightPath, point: PointSource) -> LightPath:
    """The path with only the microlens nearest to the point's chief ray, among those in front of a pixel."""
    owner = nearest_microlens(path)
    present = np.unique(owner)
    away = np.linalg.norm(path.microlenses.centres[present] - path.chief_point(point), axis=1)
    return microlenses_alone(path, [int(present[np.argmin(away)])], owner)
