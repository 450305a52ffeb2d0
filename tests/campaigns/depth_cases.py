"""Random cameras that measure depth before random scenes, whose disparity error is derived from the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tradestudy.study.loading import load_prepared
from tradestudy.study.prepared import PreparedStudy

STUDIES = Path(__file__).parents[2] / "studies"
KINDS = ("stereo", "focused", "unfocused")
_FILES = {"stereo": "stereo-100mm", "focused": "raytrix-r5", "unfocused": "r5-unfocused"}
_BASE = """\
format: 2
study: audit-{kind}
title: One camera of the audit
question: How far does each omission move its depth uncertainty?
cameras:
  one:
    from: {studies}/cameras/{file}.yaml
    depth: {{disparity_error: derived}}
    calibration:
      stability:
        temperature: {{standard_deviation: 5 K}}
        calibrated_at: {{temperature: 20 degC, pressure: 1013.25 hPa}}
        housing_expansion: 23 ppm/K
{array}
        focal_length_expansion: 10 ppm/K
        glass_index: 1.52
{more}
scene:
  distances: {{from: 0.5 m, to: 2 m, points: 21, spacing: log}}
  wavelength: 550 nm
  picture:
    texture: {{contrast: 15 %, correlation_length: 1 mm}}
    matching_window: 15 px
    light: {{electrons: 4000 electrons, at_f_number: 8}}
    read_noise: 17 electrons
    full_well: 100000 electrons
    bit_depth: 12
    field_angle: 0 deg
    spectrum: [{{wavelength: 500 nm, weight: 1}}, {{wavelength: 600 nm, weight: 1}}]
"""


def base_study(kind: str, folder: Path) -> PreparedStudy:
    """The study whose values are replaced; read once for each kind."""
    more = "    stated: null" if kind == "stereo" else ""
    array = "" if kind == "stereo" else "        array_expansion: 7 ppm/K"
    file = folder / f"{kind}.yaml"
    text = _BASE.format(kind=kind, studies=STUDIES.as_posix(), file=_FILES[kind], more=more, array=array)
    file.write_text(text, encoding="utf-8")
    return load_prepared(file, ())


def random_study(base: PreparedStudy, kind: str, rng: np.random.Generator) -> PreparedStudy:
    """A camera and a scene that could be: where it is focused, what it looks at, in which light."""

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    f = log(6.0, 50.0)  # mm
    f_number = log(1.4, 22.0)
    focus = f * log(5.0, 40.0)
    wavelength = rng.uniform(400.0, 1000.0)
    width = rng.uniform(0.02, 0.3) * wavelength
    values = {
        "scene.distances.from": f"{focus * rng.uniform(0.6, 0.95)} mm",
        "scene.distances.to": f"{focus * rng.uniform(1.05, 2.5)} mm",
        "scene.wavelength": f"{wavelength} nm",
        "cameras.one.calibration.stability.temperature.standard_deviation": f"{log(0.1, 30.0)} K",
        "scene.picture.texture.contrast": f"{log(3.0, 40.0)} %",
        "scene.picture.texture.correlation_length": f"{log(0.3, 10.0) * 5.5e-3 * focus / f} mm",
        "scene.picture.matching_window": f"{rng.integers(9, 31)} px",
        "scene.picture.light.electrons": f"{log(300.0, 2e4)} electrons",
        "scene.picture.light.at_f_number": f_number,
        "scene.picture.read_noise": f"{log(1.0, 30.0)} electrons",
        "scene.picture.bit_depth": int(rng.integers(8, 15)),
        "scene.picture.field_angle": f"{rng.uniform(0.0, 25.0)} deg",
        "scene.picture.spectrum.0.wavelength": f"{wavelength - width / 2.0} nm",
        "scene.picture.spectrum.1.wavelength": f"{wavelength + width / 2.0} nm",
    }
    lens = "cameras.one.lenses" if kind == "stereo" else "cameras.one.main_lens"
    values |= {f"{lens}.focal_length": f"{f} mm", f"{lens}.f_number": f_number}
    if kind == "stereo":
        values |= {
            "cameras.one.focus_distance": f"{focus} mm",
            "cameras.one.baseline": f"{focus * log(0.02, 0.4)} mm",
            "cameras.one.calibration.errors.yaw.standard_deviation": f"{log(1e-5, 0.3)} deg",
        }
    elif kind == "focused":
        values["cameras.one.focus.total_covering_plane"] = f"{focus * rng.uniform(0.6, 1.0)} mm"
    else:
        values["cameras.one.focus.distance"] = f"{focus} mm"
    return base.with_values(values)
