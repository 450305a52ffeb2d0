"""Random plenoptic cameras and sources for the audit of the chain's stated error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave, leg_kernel
from tradestudy.optics.chain.detector_patch import MicrolensPlane, direct_detector_field
from tradestudy.optics.chain.image import chain_image
from tradestudy.optics.chain.microlens_nodes import cell_nodes
from tradestudy.optics.chain.scene import (
    FRESNEL,
    KIRCHHOFF,
    KIRCHHOFF_FRESNEL,
    Legs,
    LightPath,
    Microlenses,
    PixelGrid,
    hexagonal_centres,
    square_centres,
)
from tradestudy.optics.propagation.kernels import direct_sum
from tradestudy.optics.propagation.lens import LENS_PHASES, CircularLens, LensPhase, PointSource
from tradestudy.optics.quadrature import gauss_legendre

LEGS = (KIRCHHOFF, KIRCHHOFF_FRESNEL, FRESNEL, Legs(to_array="fresnel", to_detector="kirchhoff"))
RELAYS = ("keplerian", "galilean", "unfocused")


@dataclass(frozen=True, kw_only=True)
class ChainCase:
    """One random camera, source, wavelength, pair of laws and tolerance."""

    path: LightPath
    source: PointSource
    wavelength: float
    legs: Legs
    accuracy: ChainAccuracy
    relay: str


def random_chain_case(rng: np.random.Generator) -> ChainCase:
    """Draw a camera: small arrays, since the error does not know how many pixels there are.

    Lens types, relays, shapes of aperture, lattices, gaps, lens phases and laws are all drawn; the microlens gap lies
    about the one that matches the f-numbers.
    """
    focal_length = 10 ** rng.uniform(-3, -2.1)
    radius = focal_length / rng.uniform(4, 12) / 2
    distance = focal_length * 10 ** rng.uniform(0.6, 1.8)
    phase: LensPhase = LENS_PHASES[rng.integers(3)]
    main = CircularLens(
        radius=radius,
        focal_length=focal_length,
        lens_phase=phase,
        focus_distance=distance * rng.uniform(0.8, 1.25) if phase == "stigmatic" else None,
    )
    image = 1 / (1 / focal_length - 1 / distance)
    pitch = rng.uniform(15e-6, 40e-6)
    gap = pitch * image / (2 * radius) * rng.uniform(0.7, 1.2)
    relay = RELAYS[rng.integers(3)]
    if relay == "unfocused":
        depth, types = 0.0, np.array([gap])
    else:
        depth = rng.uniform(1.5, 5.0) * gap
        depth = depth if relay == "keplerian" else -min(depth, 0.4 * image)
        types = rng.uniform(0.85, 1.2, 3) / (1 / depth + 1 / gap)
    array = image + depth
    hexagonal = rng.random() < 0.5
    centres = hexagonal_centres(pitch=pitch, rings=1) if hexagonal else square_centres(pitch=pitch, count=3)
    square = not hexagonal and rng.random() < 0.4
    microphase: LensPhase = "perfect" if relay != "unfocused" and rng.random() < 0.25 else "parabolic"
    seen = 1.2 * pitch * np.sqrt(rng.random())
    bearing = rng.uniform(0, 2 * math.pi)
    count = int(rng.integers(11, 20))
    path = LightPath(
        main_lens=main,
        microlenses=Microlenses(
            centres=centres,
            focal_lengths=types[np.arange(len(centres)) % types.size],
            aperture="square" if square else "circular",
            aperture_width=pitch * rng.uniform(0.75, 1.0),
            pitch=pitch,
            layout="hexagonal" if hexagonal else "square",
            gaps="clear" if rng.random() < 0.25 else "opaque",
            lens_phase=microphase,
        ),
        array_distance=array,
        detector_distance=gap,
        pixels=PixelGrid(pitch=3.2 * pitch / count, shape=(count, count)),
    )
    source = PointSource(
        x=-seen * math.cos(bearing) * distance / array,
        y=-seen * math.sin(bearing) * distance / array,
        distance=distance,
    )
    return ChainCase(
        path=path,
        source=source,
        wavelength=rng.uniform(400e-9, 700e-9),
        legs=LEGS[rng.integers(len(LEGS))],
        accuracy=ChainAccuracy(tolerance=10 ** rng.uniform(-4.5, -2)),
        relay=relay,
    )


def run(case: ChainCase, *, node_share: float = 1.0, accuracy: ChainAccuracy | None = None) -> ChainImage:
    """Image of a case, on a share of the nodes it asks for."""
    accuracy = accuracy or case.accuracy
    accuracy = replace(
        accuracy,
        pupil_nodes=accuracy.pupil_nodes * node_share,
        microlens_nodes=accuracy.microlens_nodes * node_share,
    )
    return chain_image(
        case.path,
        case.source,
        wavelength=case.wavelength,
        legs=case.legs,
        accuracy=accuracy,
        rng=np.random.default_rng(1),
    )


def finest(case: ChainCase) -> np.ndarray:
    """Pixels with every knob refined well beyond the case's own tolerance."""
    accuracy = ChainAccuracy(
        tolerance=max(1e-6, case.accuracy.tolerance / 100),
        pupil_nodes=1.25,
        microlens_nodes=1.25,
        field_sampling=1.4,
        diffraction_reach=1.4,
        pixel_sampling=1.4,
    )
    return run(case, accuracy=accuracy).pixels


def nested_pixels(case: ChainCase, pixels: list[tuple[int, int]]) -> np.ndarray:
    """Pixels by plain nested summation, without tables, transforms or interpolation, on ample nodes."""
    path, k = case.path, case.wavelength
    second = case.legs.to_detector == "fresnel"
    wave = PupilWave(path=path, source=case.source, wavelength=k, method=case.legs.to_array)
    t, g = gauss_legendre(14)
    h = path.pixels.pitch
    at = np.array(
        [(path.pixels.edges_x[j] + h * a, path.pixels.edges_y[i] + h * b) for i, j in pixels for a in t for b in t]
    )
    lenses = path.microlenses
    offset = np.linalg.norm(at[:, None] - lenses.centres, axis=-1).max() + lenses.cell_reach
    arriving = (np.linalg.norm(lenses.centres, axis=1).max() + path.main_lens.radius) / path.array_distance
    bent = lenses.cell_reach / lenses.focal_lengths.min()
    slope = offset / path.detector_distance + arriving + bent
    cell = cell_nodes(lenses, cycles=1.1 * lenses.aperture_width / 2 * min(slope, 2.0) / k)
    plane = MicrolensPlane(path=path, wavelength=k, paraxial=second, cell=cell)
    x, y = (c.ravel() for c in plane.positions)
    nodes = wave.nodes((x, y), density=1.3)
    field = direct_sum(wave.samples(nodes), wave.kernel, x, y, np.full(x.size, path.array_distance))
    detector = direct_detector_field(
        plane, leg_kernel(k, second), field.reshape(plane.positions[0].shape), plane.transmission(case.source), at,
        images=lenses.centres, target_reach=math.inf,  # the nodes resolve all points
    )  # fmt: skip
    weights = np.outer(g, g).ravel() * h**2
    return np.abs(detector.reshape(len(pixels), -1)) ** 2 @ weights / wave.power()
