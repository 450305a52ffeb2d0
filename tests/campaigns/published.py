"""A scoreboard: published measurements of depth cameras beside what the program predicts, hits and misses alike.

``python -m tests.campaigns.published`` takes seconds and writes ``published.md``. Each row says which inputs were free,
that is, taken from the same measurements, and which were not. ``tests/data/measured`` has the data and their sources.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

import tradestudy
from tests.campaigns import record
from tradestudy.answers.measured import predict
from tradestudy.calibration.measured_fits import exponent, ripple
from tradestudy.calibration.measured_table import read_measurements
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.optics.triangulation import stereo_depth

DATA = Path(__file__).parents[1] / "data" / "measured"
HEADER = ("set", "quantity", "free inputs", "inputs not free", "predicted", "measured", "verdict")
NOTE = (
    "A hit lies within the stated limit. Free inputs come from the same measurements; where there are any, the row "
    "says which points fitted them and which judge. The numbers of mrcal, MultiSense and the ZED are computed by their "
    "authors, and those of the RealSense are bounds of their maker: they test the law, not a camera."
)
NOT_PREDICTED = (
    ("VZense DS86, time of flight", "σ and bias over distance", "vzense_ds86.csv", "the program has no time of flight"),
    ("VZense DS86, time of flight", "σ over exposure time", "vzense_ds86_exposures.csv", "the same"),
    ("Kinect v1, fixed pattern", "σ over distance", "kinect_v1.csv", "the program has no fixed patterns"),
    (
        "VICAR, Mars rovers",
        "0.082 px along lines, 0.110 px along samples",
        "one number each",
        "needs the pictures: noise grows with their roughness",
    ),
    ("MER Pancam, Navcam, Hazcam", "geometry only", "one number each", "no depth error was published with it"),
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One published number beside its prediction."""

    of: str
    quantity: str
    free: str
    fixed: str
    predicted: float
    measured: float
    limit: float
    unit: str = ""
    bound: bool = False
    is_test: bool = True

    @property
    def hit(self) -> bool:
        """Whether the prediction lies within the limit, relative, or below the published bound."""
        if self.bound:
            return self.predicted <= self.measured
        return abs(self.predicted / self.measured - 1.0) <= self.limit

    def cells(self) -> tuple[str, ...]:
        """The row as text."""
        how = "below the bound" if self.bound else f"to {self.limit:.0%}"
        numbers = [f"{one:.4g} {self.unit}".strip() for one in (self.predicted, self.measured)]
        numbers[1] = f"< {numbers[1]}" if self.bound else numbers[1]
        verdict = f"{'hit' if self.hit else 'MISS'} ({how})" if self.is_test else "no test: fits and judges"
        return self.of, self.quantity, self.free, self.fixed, *numbers, verdict


def rig(focal_px: float, baseline: float, noise_px: float = 0.1) -> DepthCamera:
    """A stereo rig from its focal length [px], baseline [m] and disparity error [px]."""
    made = tradestudy.load(
        {
            "cameras": {
                "rig": {
                    "kind": "stereo",
                    "lenses": {"focal_length": f"{focal_px!r} px"},
                    "sensor": {"pixels": [4000, 3000], "pixel_pitch": "3 um"},
                    "baseline": f"{baseline!r} m",
                    "depth": {"disparity_error": f"{noise_px!r} px", "error_of": "disparity"},
                }
            },
            "scene": {"distances": ["1 m", "2 m"], "wavelength": "550 nm"},
        }
    )
    return made.prepared.case.cameras["rig"]


def sigma(focal_px: float, baseline: float, noise_px: float, distance: float) -> float:
    """Depth uncertainty [m] of a rig at a distance [m]."""
    return float(predict(rig(focal_px, baseline, noise_px), np.array([distance])).sigma[0])


def oak() -> Iterator[Row]:
    """The stereo head on a flat target, whose errors show sub-pixel locking."""
    table, nominal = read_measurements(DATA / "oak_75mm_800p.csv"), 882.5 * 0.075
    z, e = table.distance, table.absolute_error
    found = ripple(e * nominal / z**2, nominal / z, signed=False)
    fixed = "882.5 px, 75 mm (data sheet)"
    product = found.scale.value * nominal
    yield Row(
        of="OAK 75 mm, 800p",
        quantity="f·B from the ripple",
        free="none",
        fixed=fixed,
        predicted=nominal,
        measured=product,
        limit=0.02,
        unit="px m",
    )
    blind = predict(rig(882.5, 0.075), z).absolute_error
    yield Row(
        of="OAK 75 mm, 800p",
        quantity="median of mean absolute error over predicted",
        free="none",
        fixed=f"{fixed}, 0.1 px (default)",
        predicted=1.0,
        measured=float(np.median(e / blind)),
        limit=0.25,
    )
    near = z <= 5.0
    half = ripple((e * nominal / z**2)[near], (nominal / z)[near], signed=False)
    largest, scale = half.mean.value + half.amplitude.value, half.scale.value
    turns = scale * nominal / z + half.phase / (2.0 * np.pi) - 0.25
    far = [np.flatnonzero((np.round(turns) == one) & ~near) for one in np.unique(np.round(turns))]
    maxima = [points[np.argmax(e[points] / z[points] ** 2)] for points in far if points.size > 1]
    maxima = [k for k in maxima if abs(turns[k] - round(turns[k])) <= 0.25]
    ratio = largest * z[maxima] ** 2 / nominal / e[maxima]
    worst = float(ratio[np.argmax(np.abs(ratio - 1.0))])
    yield Row(
        of="OAK 75 mm, 800p",
        quantity=f"worst of {len(maxima)} maxima beyond 5 m, predicted over measured",
        free="f·B and one disparity error, fitted up to 5 m; judged beyond",
        fixed="none",
        predicted=worst,
        measured=1.0,
        limit=0.15,
    )


def others() -> Iterator[Row]:
    """The sets and single numbers with one prediction each."""
    table = read_measurements(DATA / "stereo_rms_32_points.csv")
    law = predict(rig(800.0, 0.075), table.distance)
    predicted = exponent(table.distance, law.rms).value
    measured = exponent(table.distance, table.rms).value
    yield Row(
        of="unnamed stereo camera, 32 points",
        quantity="exponent of RMS in Z",
        free="none; the level is not judged",
        fixed="the law",
        predicted=predicted,
        measured=measured,
        limit=0.025,
    )
    for name, focal, baseline, noise, distance in (
        ("RealSense D455, 848 × 480", 431.657, 0.094862, 0.11, 4.0),
        ("RealSense D435, 848 × 480", 424.0, 0.050, 0.08, 2.0),
    ):
        yield Row(
            of=name,
            quantity=f"depth error at {distance:g} m",
            free="none",
            fixed=f"f, B, {noise:g} px (maker)",
            predicted=100.0 * sigma(focal, baseline, noise, distance) / distance,
            measured=2.0,
            limit=0.0,
            unit="%",
            bound=True,
        )
    yield Row(
        of="ZED, first model",
        quantity="depth per 0.5 px at 25 m, to first order",
        free="none",
        fixed="120 mm, 670 px",
        predicted=float(0.5 / predict(rig(670.0, 0.12), np.array([25.0])).px_per_m[0]),
        measured=3.89,
        limit=0.02,
        unit="m",
    )
    d = 670.0 * 0.12 / 25.1
    yield Row(
        of="ZED, first model",
        quantity="depth at 25.1 m with an offset of 3.5 px",
        free="the offset, from this depth",
        fixed="120 mm, 670 px",
        predicted=float(stereo_depth(d + 3.5, 0.12, 670.0)),
        measured=12.0,
        limit=0.02,
        unit="m",
        is_test=False,
    )
    yield Row(
        of="MultiSense S21",
        quantity="depth error at 5 m for 0.5 px",
        free="none",
        fixed="210 mm, 932 px",
        predicted=1e3 * sigma(932.0, 0.21, 0.5, 5.0),
        measured=63.0,
        limit=0.02,
        unit="mm",
    )
    yield from mrcal()


def mrcal() -> Iterator[Row]:
    """The triangulation example of mrcal; it triangulates 529.5 m per metre of translation times the baseline."""
    focal, baseline = 2084.0, 1.835
    z = 529.5 * baseline
    of, fixed, free = (
        "mrcal, triangulation",
        "f 2084 px, B 1.835 m",
        f"range {z:.0f} m, from the sensitivity to translation",
    )
    per_px = z**2 / (focal * baseline)
    slope = predict(rig(focal, baseline), np.array([z])).px_per_m[0]
    yield Row(
        of=of,
        quantity="sensitivity per px",
        free=free,
        fixed=fixed,
        predicted=float(1.0 / slope),
        measured=246.0,
        limit=0.01,
        unit="m",
    )
    turned = rig(focal, baseline).read(np.array([z]), 0.0, {"yaw": np.full((1, 1), 1e-9)}).inverse_depth[0, 0]
    yield Row(
        of=of,
        quantity="sensitivity per degree of yaw",
        free=free,
        fixed=fixed,
        predicted=float(abs(1.0 / turned - z) / 1e-9 * np.pi / 180.0),
        measured=8949.7,
        limit=0.01,
        unit="m",
    )
    yield Row(
        of=of,
        quantity="sensitivity per px at the true range of 873 m",
        free="none",
        fixed=fixed,
        predicted=873.0**2 / (focal * baseline),
        measured=246.0,
        limit=0.01,
        unit="m",
    )
    for correlation, measured in ((0.0, 104.58), (0.1, 104.06)):
        noise = 0.3 * np.sqrt(2.0 * (1.0 - correlation**2))  # mrcal's number scales the standard deviation
        yield Row(
            of=of,
            quantity=f"σ for 0.3 px per camera, correlation {correlation:g}",
            free=free,
            fixed=fixed,
            predicted=float(noise * per_px),
            measured=measured,
            limit=0.01,
            unit="m",
        )


def raytrix() -> Iterator[Row]:
    """Spread of the corners of a plane board in four frames of a Raytrix R12, by all microlenses that see a corner."""
    made = tradestudy.load(
        {
            "cameras": {
                "r12": {
                    "from": "catalogue/raytrix-r12",
                    "depth": {
                        "estimator": "least-squares",
                        "microlenses": "all",
                        "disparity_error": f"{0.68 * 2.0**0.5!r} px",
                    },
                }
            },
            "scene": {"distances": ["0.2 m", "0.4 m"], "wavelength": "550 nm"},
        }
    )
    for frame in pd.read_csv(DATA / "raytrix_r12a.csv", comment="#").itertuples():
        z = np.array([frame.distance_mean_mm * 1e-3])  # type: ignore[operator]  # pandas types no columns
        yield Row(
            of="Raytrix R12A, focused plenoptic",
            quantity=f"spread of corners at {1e3 * z[0]:g} mm",
            free="0.68 px in each coordinate of a micro-image, from the same pictures",
            fixed="f, array, gap, pitch (calibrated by others)",
            predicted=1e3 * float(predict(made.prepared.case.cameras["r12"], z).sigma[0]),
            measured=float(frame.sigma_after_plane_mm),  # type: ignore[arg-type]
            limit=0.25,
            unit="mm",
        )


def rows() -> list[Row]:
    """Every published number with a prediction."""
    return [*oak(), *others(), *raytrix()]


def main() -> None:
    """Write the scoreboard."""
    found = rows()
    tests = [one for one in found if one.is_test]
    hits = sum(one.hit for one in tests)
    table = [one.cells() for one in found]
    table += [(of, what, "", "", "not predicted", f"`{data}`", why) for of, what, data, why in NOT_PREDICTED]
    note = f"{hits} of {len(tests)} tests are hits. {NOTE}"
    path = record.write(
        "published",
        "Published measurements beside predictions",
        "python -m tests.campaigns.published",
        HEADER,
        table,
        note=note,
    )
    print(path.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
