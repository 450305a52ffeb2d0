"""Writes aperture_table.json: 30-digit fields behind a lens, by plain integration in multiple precision.

Nothing of the package is used: paths are absolute lengths, computed with 45 digits, so that no difference form is
needed; the integral over the disc is a Gauss–Legendre × trapezoid sum in polar coordinates (in the radius, not its
square), done twice: 22 digits must agree. Run by hand: ``python tests/optics/reference/generate_aperture_table.py``.
"""

from __future__ import annotations

import json
from pathlib import Path

import mpmath as mp

mp.mp.dps = 45
WAVELENGTH = 550e-9
MICRO = {"radius": 25e-6, "focal_length": 0.3e-3, "focus_distance": 5e-3}
MAIN = {"radius": 12.5e-3 / 7.6, "focal_length": 12.5e-3, "focus_distance": 0.15}


def gauss_legendre(count: int) -> list[tuple[mp.mpf, mp.mpf]]:
    """Nodes and weights on [0, 1]."""
    rule = []
    for i in range(1, count + 1):
        x = mp.cos(mp.pi * (i - mp.mpf(1) / 4) / (count + mp.mpf(1) / 2))
        for _ in range(8):
            before, value = mp.mpf(1), x
            for n in range(2, count + 1):
                before, value = value, ((2 * n - 1) * x * value - (n - 1) * before) / n
            slope = count * (x * value - before) / (x * x - 1)
            x -= value / slope
        rule.append(((x + 1) / 2, 1 / ((1 - x * x) * slope * slope)))
    return rule


def lens_path(case: dict, x: mp.mpf, y: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
    """Path from the source through the lens, and the squared transverse slope behind it."""
    a, f = mp.mpf(case["object_distance"]), mp.mpf(case["focal_length"])
    xs, ys = mp.mpf(case["source_x"]), mp.mpf(case["source_y"])
    b = a * f / (a - f)
    r = mp.sqrt(a * a + (x - xs) ** 2 + (y - ys) ** 2)
    slope = [(x - xs) / r, (y - ys) / r]
    phase = case["lens_phase"]
    if phase == "parabolic":
        lens = -(x * x + y * y) / (2 * f)
        turn = [-x / f, -y / f]
    elif phase == "stigmatic":
        a0 = mp.mpf(case["focus_distance"])
        b0 = a0 * f / (a0 - f)
        ra, rb = mp.sqrt(a0 * a0 + x * x + y * y), mp.sqrt(b0 * b0 + x * x + y * y)
        lens = (a0 - ra) + (b0 - rb)
        turn = [-x / ra - x / rb, -y / ra - y / rb]
    else:
        xi, yi = -xs * b / a, -ys * b / a
        ri = mp.sqrt(b * b + (x - xi) ** 2 + (y - yi) ** 2)
        lens = (mp.sqrt(a * a + xs * xs + ys * ys) - r) + (mp.sqrt(b * b + xi * xi + yi * yi) - ri)
        turn = [-slope[0] - (x - xi) / ri, -slope[1] - (y - yi) / ri]
    return r + lens, (slope[0] + turn[0]) ** 2 + (slope[1] + turn[1]) ** 2


def integrand(case: dict, x: mp.mpf, y: mp.mpf) -> mp.mpc:
    """Integrand over the aperture."""
    wavelength = mp.mpf(case["wavelength"])
    k = 2 * mp.pi / wavelength
    a, z = mp.mpf(case["object_distance"]), mp.mpf(case["distance"])
    xs, ys = mp.mpf(case["source_x"]), mp.mpf(case["source_y"])
    dx, dy = mp.mpf(case["x"]) - x, mp.mpf(case["y"]) - y
    if case["method"] == "fresnel":
        paths = a + ((x - xs) ** 2 + (y - ys) ** 2) / (2 * a) + z + (dx * dx + dy * dy) / (2 * z)
        lens = -(x * x + y * y) / (2 * mp.mpf(case["focal_length"]))
        return mp.expjpi(2 * (paths + lens) / wavelength) / (1j * wavelength * a) / (1j * wavelength * z)
    r = mp.sqrt(a * a + (x - xs) ** 2 + (y - ys) ** 2)
    s = mp.sqrt(dx * dx + dy * dy + z * z)
    path, slope = lens_path(case, x, y)
    if case["obliquity"] == "paper":
        size = (a / r) / r * (z / s) / s
    elif case["obliquity"] == "textbook":
        size = 1 / r * (mp.sqrt(1 - slope) + z / s) / 2 / s
    else:
        size = (a / r) / r * (1 + 1j / (k * r)) * (z / s) / s * (1 + 1j / (k * s))
    return mp.expjpi(2 * (path + s) / wavelength) * size / (1j * wavelength) ** 2


def on_disc(case: dict, rings: int, angles: int) -> mp.mpc:
    """Integral over the disc."""
    radius = mp.mpf(case["radius"])
    total = mp.mpc(0)
    for t, w in gauss_legendre(rings):
        ring = mp.mpc(0)
        for j in range(angles):
            c, s = mp.cos(2 * mp.pi * j / angles), mp.sin(2 * mp.pi * j / angles)
            ring += integrand(case, radius * t * c, radius * t * s)
        total += w * t * ring
    return total * radius**2 * 2 * mp.pi / angles


def on_axis(case: dict) -> mp.mpc:
    """Integral over the radius where source and target lie on the axis."""
    radius = mp.mpf(case["radius"])
    breaks = [radius * i / 8 for i in range(9)]
    return 2 * mp.pi * mp.quad(lambda r: integrand(case, r, mp.mpf(0)) * r, breaks)


def cases() -> list[dict]:
    """Every case of the table."""
    phases = ("parabolic", "stigmatic", "perfect")
    sources = ((0.0, 0.0), (0.6e-3, -0.3e-3))
    off = (-35e-6, 22e-6, 0.32e-3)
    targets = ((0.0, 0.0, 0.32e-3), off, (4e-6, 7e-6, 0.4e-3))
    table = [_case(MICRO, p, s, t, 4.5e-3) for p in phases for s in sources for t in targets]
    table += [_case(MAIN, p, (0.0, 0.0), (0.0, 0.0, z), 0.15) for p in phases for z in (13.6363e-3, 13.7e-3)]
    table += [
        _case(MICRO, p, sources[1], off, 4.5e-3, obliquity)
        for obliquity in ("textbook", "rayleigh-sommerfeld-1")
        for p in ("parabolic", "perfect")
    ]
    table += [_case(MICRO, "parabolic", sources[1], t, 4.5e-3) | {"method": "fresnel"} for t in targets[1:]]
    return table


def _case(lens: dict, phase: str, source: tuple, target: tuple, a: float, obliquity: str = "paper") -> dict:
    return {
        "method": "kirchhoff",
        "obliquity": obliquity,
        "lens_phase": phase,
        "wavelength": WAVELENGTH,
        **lens,
        "object_distance": a,
        "source_x": source[0],
        "source_y": source[1],
        "x": target[0],
        "y": target[1],
        "distance": target[2],
    }


def main() -> None:
    """Compute, compare with a finer rule, write."""
    rows = []
    for case in cases():
        axial = case["source_x"] == case["source_y"] == case["x"] == case["y"] == 0.0
        if axial:
            value = on_axis(case)
        else:
            value, finer = on_disc(case, 44, 108), on_disc(case, 50, 122)
            assert abs(value - finer) < mp.mpf(10) ** -22 * abs(finer), (case, value, finer)
            value = finer
        rows.append(case | {"real": mp.nstr(value.real, 30), "imag": mp.nstr(value.imag, 30)})
        print(rows[-1])
    Path(__file__).with_name("aperture_table.json").write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
