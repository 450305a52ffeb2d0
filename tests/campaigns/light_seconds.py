"""Seconds per unit of the work of light pictures, for the tables that predict them; prints and keeps nothing.

    python -m tests.campaigns.light_seconds

Processor seconds on the light spot, the least of three: `tradestudy.plan.situations.light_cost.SECONDS` and
`tradestudy.effects.point_images.SECONDS_PER_IMAGE` times the speed of this machine.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from tradestudy import load
from tradestudy.analysis.point_spreads import SpreadMethod, every_case, point_spread_of
from tradestudy.machine import machine_speed
from tradestudy.optics.chain import (
    FRESNEL,
    GEOMETRIC,
    KIRCHHOFF,
    ChainAccuracy,
    Legs,
    LightPath,
    chain_image,
    square_centres,
)
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import arriving_light, field_spacing, point_wave
from tradestudy.optics.chain.point_image import compute_point, wave_point_image
from tradestudy.optics.chain.scene import WaveMethod
from tradestudy.optics.chain.source_tables import farthest_read, source_tables, table_count
from tradestudy.plan.situations.light_cost import LightWork, PointWork, pupil_nodes
from tradestudy.plan.situations.light_spot import light_scene
from tradestudy.study.schema.light_spot import LightSpotPart

STUDY = Path(__file__).parents[2] / "studies" / "light_spot.yaml"
COARSE, FINE, DOUBLE = 0.1, 0.01, 9e-4
BEHIND_ARRAY = Legs(to_array="kirchhoff", to_detector="boundary_wave")
_DEFOCUS = 0.8  # of the focal lengths: about three Fresnel zones


def least(task: Callable[[], object], repeats: int = 3) -> float:
    """Least processor seconds of a task."""
    found = []
    for _ in range(repeats):
        start = time.process_time()
        task()
        found.append(time.process_time() - start)
    return min(found)


def units_of_points(part: LightSpotPart, speed: float) -> dict[str, float]:
    """Single points behind few and many microlenses, of usual and denser nodes: the field, what is behind, checks.

    The field is measured by itself; of the rest, nodes and samples are told apart by least squares relative to what
    was measured.
    """
    scene = light_scene(part)
    work, passes, checks = [], [], []
    fields: dict[Legs, list[float]] = {FRESNEL: [], KIRCHHOFF: []}
    for count in (3, 5, 8):
        path = _square_array(scene.path, count)
        for legs, times in itertools.product((FRESNEL, KIRCHHOFF), (1.0, 1.5)):
            accuracy = ChainAccuracy(tolerance=FINE, microlens_nodes=times)
            wave = point_wave(path, scene.source.centre, wavelength=scene.wavelength, legs=legs)
            one = PointWork(scene=replace(scene, path=path), accuracy=accuracy)
            field = least(partial(arriving_light, wave, accuracy))
            behind = least(partial(compute_point, wave, legs.to_detector, accuracy)) - field
            image = partial(
                wave_point_image, wave, to_detector=legs.to_detector, accuracy=accuracy, rng=np.random.default_rng(0)
            )
            fields[legs].append(speed * field / one.field_samples)
            work.append(one.nodes_and_samples)
            passes.append(speed * behind)
            checks.append(speed * (least(image, 1) - 2 * (field + behind)))
    node, sample = _units(work, passes)
    node_checked, sample_checked = _units(work, checks)
    return {
        "node behind all microlenses": node,
        "sample of the detector": sample,
        "sample of the field of a point, Kirchhoff": float(np.median(fields[KIRCHHOFF])),
        "sample of the field of a point, Fresnel": float(np.median(fields[FRESNEL])),
        "node behind all microlenses, by quadrature": node_checked,
        "sample of the detector, by quadrature": sample_checked,
    }


def _square_array(path: LightPath, count: int) -> LightPath:
    """The same microlens so many times to either side, before pixels that reach as far."""
    lenses, pixels = path.microlenses, path.pixels
    centres = square_centres(pitch=lenses.pitch, count=count)
    side = 2 * round(count * lenses.pitch / pixels.pitch / 2) + 1
    focal_lengths = np.full(len(centres), lenses.focal_lengths[0])
    return replace(
        path,
        microlenses=replace(lenses, centres=centres, focal_lengths=focal_lengths, layout="square"),
        pixels=replace(pixels, shape=(side, side), centre=(0.0, 0.0)),
    )


def _units(work: Sequence[tuple[int, int]], seconds: Sequence[float]) -> tuple[float, float]:
    taken = np.maximum(seconds, 1e-6)
    node, sample = nnls(np.array(work) / taken[:, np.newaxis], np.ones(taken.size))[0]
    return float(node), float(sample)


def main() -> None:
    """Measure every unit."""
    file = load(STUDY).file
    part, spread = file.light_spot, file.point_spread
    assert part is not None
    assert spread is not None
    scene, speed = light_scene(part), machine_speed()
    path, source = scene.path, scene.source

    lenses = replace(path.microlenses, focal_lengths=_DEFOCUS * path.microlenses.focal_lengths)
    defocused = replace(path, microlenses=lenses)

    def picture(
        legs: Legs, tolerance: float, *, light: LightPath = path, point: bool = False, repeats: int = 3
    ) -> float:
        def task() -> object:
            return chain_image(
                light, source.centre if point else source, wavelength=part.mean_wavelength, legs=legs,
                accuracy=ChainAccuracy(tolerance=tolerance), rng=np.random.default_rng(0),
            )  # fmt: skip

        return speed * least(task, repeats)

    def coherent_node(legs: Legs) -> float:
        """What a coherent disc adds to its middle point."""
        disc = replace(source, coherent=True)
        whole = least(
            lambda: chain_image(
                path, disc, wavelength=scene.wavelength, legs=legs, accuracy=ChainAccuracy(tolerance=FINE),
                rng=np.random.default_rng(0),
            ), 1,
        )  # fmt: skip
        return (speed * whole - point[legs]) / pupil_nodes(replace(scene, source=disc))

    def table(method: WaveMethod) -> float:
        accuracy, far = ChainAccuracy(tolerance=FINE), math.hypot(source.x, source.y) + source.diameter / 2
        half = farthest_read(path, source, far)
        task = partial(
            source_tables, path, source, (0.0, far), wavelength=scene.wavelength, method=method, accuracy=accuracy,
            half_width=half,
        )  # fmt: skip
        wave = point_wave(path, source.centre, wavelength=scene.wavelength, legs=KIRCHHOFF)
        assert isinstance(wave, PupilWave)  # waves to the array have one
        return speed * least(task) / (table_count(accuracy) * (2 * half / field_spacing(wave, accuracy)) ** 2)

    def samples(tolerance: float) -> float:
        work = LightWork(scene=scene, tolerance=tolerance)
        return work.source_points * work.patch.work(path, lit=work.lit_microlenses)

    pixels = path.pixels.shape[0] * path.pixels.shape[1] * path.microlenses.count
    point = {legs: picture(legs, FINE, point=True) for legs in (FRESNEL, KIRCHHOFF)}
    disc = {legs: picture(legs, COARSE) for legs in (FRESNEL, KIRCHHOFF)}
    patch = (picture(KIRCHHOFF, FINE) - disc[KIRCHHOFF]) / (samples(FINE) - samples(COARSE))
    behind = LightWork(scene=replace(scene, path=defocused), tolerance=FINE)
    edges = picture(BEHIND_ARRAY, FINE, light=defocused, repeats=1) - picture(KIRCHHOFF, FINE, light=defocused)
    measured = {
        "rays of a disc: pixel behind a microlens": picture(GEOMETRIC, FINE) / pixels,
        "rays of a point: pixel behind a microlens": picture(GEOMETRIC, FINE, point=True) / pixels,
        "sample of a patch": patch,
        "sample of a patch in double precision": picture(KIRCHHOFF, DOUBLE, repeats=1) / samples(DOUBLE),
        "sample of a patch, boundary wave": edges
        / (behind.source_points * behind.lit_microlenses * behind.patch.side**2),
        **units_of_points(part, speed),
        "sample of a table, Kirchhoff": table("kirchhoff"),
        "sample of a table, Fresnel": table("fresnel"),
        "node of a coherent disc, Fresnel": coherent_node(FRESNEL),
        "node of a coherent disc, Kirchhoff": coherent_node(KIRCHHOFF),
        "disc at 10 % beside its samples": disc[KIRCHHOFF] - patch * samples(COARSE),
    }
    case = every_case(spread)[0]
    methods: tuple[SpreadMethod, ...] = ("fresnel", "kirchhoff")
    for method in methods:
        image = least(
            lambda m=method: point_spread_of(case, method=m, window=spread.window, tolerance=spread.tolerance)  # type: ignore[misc]  # mypy knows no type of m
        )
        measured[f"image of a point, {method}"] = speed * image
    for name, seconds in measured.items():
        print(f"{name:45s} {seconds:.3g}")


if __name__ == "__main__":
    main()
