"""The image-plane pattern of a circular lens by other people's packages, timed; needs none of this project.

    python outside_packages.py CASE

CASE is JSON: radius, distance, wavelength, pitch [m], count, clock ("wall" or "cpu").

For every line that it reads it computes all once more, and prints one JSON line: of each package and setting the
milliseconds, set-up included, and the relative L2 error of the intensity from the Airy pattern, which is exact for the
law that all of them compute. Packages that are not installed are left out.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from scipy.special import j1

Setting = tuple[str, Callable[[], np.ndarray], np.ndarray]


def airy(case: dict[str, float], x: np.ndarray) -> np.ndarray:
    """(2 J₁(v)/v)², v = k R r/b."""
    v = 2 * np.pi / case["wavelength"] * case["radius"] / case["distance"] * np.hypot(x[:, None], x)
    v = np.maximum(v, 1e-9)
    return (2 * j1(v) / v) ** 2


def prysm(case: dict[str, float]) -> Iterator[Setting]:
    """Matrix Fourier transform of a pupil sampled by yes and no."""
    from prysm import fttools, propagation

    count = int(case["count"])
    x = case["pitch"] * (np.arange(count) - count // 2)

    def image(n: int) -> np.ndarray:
        fttools.mdft.clear()  # the set-up is part of the time
        step = 2 * case["radius"] / n
        u = step * (np.arange(n) - n // 2)
        pupil = (np.hypot(u[:, None], u) <= case["radius"]).astype(complex)
        field = propagation.focus_fixed_sampling(
            pupil, step * 1e3, case["distance"] * 1e3, case["wavelength"] * 1e6, case["pitch"] * 1e6, count
        )
        return np.abs(field) ** 2

    for n in (256, 512, 1024, 2048):
        yield f"{n}² pupil samples", lambda n=n: image(n), x


def hcipy(case: dict[str, float]) -> Iterator[Setting]:
    """Matrix Fourier transform of a pupil, its samples averaged over finer ones."""
    import hcipy as hc

    count = int(case["count"])
    x = case["pitch"] * (np.arange(count) - (count - 1) / 2)

    def image(n: int, finer: int) -> np.ndarray:
        grid = hc.make_pupil_grid(n, 2 * case["radius"])
        shape = hc.make_circular_aperture(2 * case["radius"])
        pupil = hc.evaluate_supersampled(shape, grid, finer) if finer > 1 else shape(grid)
        focal = hc.make_uniform_grid([count, count], [count * case["pitch"]] * 2)
        lens = hc.FraunhoferPropagator(grid, focal, focal_length=case["distance"])
        return np.asarray(lens(hc.Wavefront(pupil, case["wavelength"])).intensity.shaped)

    for n, finer in ((128, 8), (256, 1), (256, 8), (512, 8), (1024, 8)):
        yield f"{n}² pupil samples, each of {finer}²", lambda n=n, finer=finer: image(n, finer), x


def poppy(case: dict[str, float]) -> Iterator[Setting]:
    """Matrix Fourier transform of a pupil whose rim has grey pixels."""
    import astropy.units as u
    import poppy as pp

    count = int(case["count"])
    x = case["pitch"] * (np.arange(count) - (count - 1) / 2)
    scale = case["pitch"] / case["distance"] * u.rad.to(u.arcsec) * u.arcsec / u.pixel

    def image(n: int) -> np.ndarray:
        wave = pp.Wavefront(wavelength=case["wavelength"] * u.m, npix=n, diam=2 * case["radius"] * u.m, oversample=1)
        wave *= pp.CircularAperture(radius=case["radius"] * u.m, gray_pixel=True)
        wave.propagate_to(pp.Detector(scale, fov_pixels=count))
        return np.asarray(wave.intensity)

    for n in (256, 512, 1024):
        yield f"{n}² pupil samples, grey rim", lambda n=n: image(n), x


def error(intensity: np.ndarray, truth: np.ndarray) -> float:
    """Relative L2, after the best common factor: every package has its own unit."""
    scaled = intensity * (np.sum(intensity * truth) / np.sum(intensity**2))
    return float(np.linalg.norm(scaled - truth) / np.linalg.norm(truth))


def installed(case: dict[str, float]) -> Iterator[tuple[str, Setting]]:
    """Every setting of every package that is there, with its release."""
    for package in (prysm, hcipy, poppy):
        with contextlib.suppress(PackageNotFoundError):
            release = version(package.__name__)
            for setting in package(case):
                yield f"{package.__name__} {release}", setting


def main() -> None:
    """Time every setting once for each line of the input."""
    case = json.loads(sys.argv[1])
    clock = time.process_time if case["clock"] == "cpu" else time.perf_counter
    settings = list(installed(case))
    for _, (_, compute, _) in settings:
        compute()
    for _ in sys.stdin:
        rows = []
        for release, (setting, compute, x) in settings:
            start = clock()
            intensity = compute()
            milliseconds = 1e3 * (clock() - start)
            rows.append(
                {
                    "package": release,
                    "setting": setting,
                    "milliseconds": milliseconds,
                    "error": float(f"{error(intensity, airy(case, x)):.2g}"),
                }
            )
        print(json.dumps(rows, ensure_ascii=False), flush=True)


if __name__ == "__main__":
    main()
