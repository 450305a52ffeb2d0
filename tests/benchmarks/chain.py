"""Seconds, memory and convergence of the chain on the light spot of the paper's Figure 7; run by hand.

    python tests/benchmarks/chain.py [point] [spot] [knobs]

``point``: one source point on and off axis. ``spot``: the 4 mm incoherent spot by each method. ``knobs``: the spot by
Kirchhoff on both legs with every knob refined twice alone, then all at once.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from tradestudy.optics.chain import (
    FRESNEL,
    GEOMETRIC,
    KIRCHHOFF,
    KIRCHHOFF_FRESNEL,
    ChainAccuracy,
    ChainImage,
    DiscSource,
    Legs,
    LightPath,
    Microlenses,
    PixelGrid,
    chain_image,
    square_centres,
)
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.point_image import compute_point
from tradestudy.optics.propagation.lens import CircularLens, PointSource

WAVELENGTH = 550e-9
KNOBS = (
    "pupil_nodes",
    "microlens_nodes",
    "field_sampling",
    "diffraction_reach",
    "pixel_sampling",
    "source_sampling",
)


def scene() -> LightPath:
    """Figure 7: f = 12.5 mm and f_L = 0.432 mm at f/3.8, 3 × 3 microlenses of 23 pixels, in focus at 150 mm."""
    return LightPath(
        main_lens=CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="parabolic"),
        microlenses=Microlenses(
            centres=square_centres(pitch=126.5e-6, count=3),
            focal_lengths=np.full(9, 0.432e-3),
            aperture="circular",
            aperture_width=0.432e-3 / 3.8,
            pitch=126.5e-6,
            layout="square",
            gaps="opaque",
            lens_phase="parabolic",
        ),
        array_distance=15.271e-3,
        detector_distance=0.587e-3,
        pixels=PixelGrid(pitch=5.5e-6, shape=(69, 69)),
    )


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Relative L2 over pixels."""
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def timed(source: PointSource | DiscSource, legs: Legs, accuracy: ChainAccuracy) -> tuple[ChainImage, float, float]:
    """Image, wall seconds and CPU seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    image = chain_image(
        scene(), source, wavelength=WAVELENGTH, legs=legs, accuracy=accuracy, rng=np.random.default_rng(0)
    )
    return image, time.perf_counter() - wall, time.process_time() - cpu


def memory() -> float:
    """Largest resident memory so far [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def point() -> None:
    """One source point: the computation alone (best of five), and with its error statement and direct check."""
    print("one point, Kirchhoff on both legs\n  source [mm]  tolerance  compute [s]  with statement [s]  stated   true")
    for x, y in ((0.0, 0.0), (1.3e-3, 0.7e-3)):
        source = PointSource(x=x, y=y, distance=0.15)
        reference = timed(source, KIRCHHOFF, ChainAccuracy(tolerance=1e-6, field_sampling=1.2, diffraction_reach=1.2))[
            0
        ]
        wave = PupilWave(path=scene(), source=source, wavelength=WAVELENGTH, paraxial=False)
        for tolerance in (1e-3, 1e-4, 1e-5):
            accuracy = ChainAccuracy(tolerance=tolerance)
            seconds = []
            for _ in range(5):
                start = time.perf_counter()
                compute_point(wave, False, accuracy)
                seconds.append(time.perf_counter() - start)
            image, wall, _ = timed(source, KIRCHHOFF, accuracy)
            print(
                f"  {x * 1e3:.1f}, {y * 1e3:.1f}     {tolerance:.0e}      {min(seconds):6.2f}       {wall:6.2f}"
                f"              {image.numerical_error:.1e}  {difference(image.pixels, reference.pixels):.1e}"
            )


def spot() -> None:
    """The 4 mm incoherent spot by each method."""
    source = DiscSource(diameter=4e-3, distance=0.15)
    print("4 mm incoherent spot\n  method              wall [s]  CPU [s]  stated   against Kirchhoff  peak [GB]")
    images = {}
    for name, legs in (
        ("Kirchhoff", KIRCHHOFF),
        ("Kirchhoff–Fresnel", KIRCHHOFF_FRESNEL),
        ("Fresnel", FRESNEL),
        ("geometric", GEOMETRIC),
    ):
        image, wall, cpu = timed(source, legs, ChainAccuracy(tolerance=1e-2))
        images[name] = image.pixels
        change = difference(image.pixels, images["Kirchhoff"])
        print(
            f"  {name:18s}  {wall:7.1f}  {cpu:7.1f}  {image.numerical_error:.1e}  "
            f"{change:.1e}            {memory():.2f}",
            flush=True,
        )


def knobs() -> None:
    """Every knob refined twice alone, then all at once."""
    source = DiscSource(diameter=4e-3, distance=0.15)
    settings = {"as is": ChainAccuracy(tolerance=1e-2)}
    settings |= {knob: ChainAccuracy(tolerance=1e-2, **{knob: 2.0}) for knob in KNOBS}
    settings["all at once"] = ChainAccuracy(tolerance=1e-2, **dict.fromkeys(KNOBS, 2.0))
    print("4 mm spot, Kirchhoff on both legs, each knob refined 2 ×")
    print("  knob               change   wall [s]  CPU [s]  stated  peak [GB]")
    base = None
    for name, accuracy in settings.items():
        image, wall, cpu = timed(source, KIRCHHOFF, accuracy)
        base = image.pixels if base is None else base
        print(
            f"  {name:18s} {difference(base, image.pixels):.1e}  {wall:7.1f}  {cpu:7.1f}  "
            f"{image.numerical_error:.1e}  {memory():.2f}",
            flush=True,
        )


if __name__ == "__main__":
    asked = sys.argv[1:] or ["point", "spot", "knobs"]
    for part in (point, spot, knobs):
        if part.__name__ in asked:
            part()
