"""Wave optics of a lens, with or without a microlens array and pixels behind it.

Start here:

* `point_spread` computes the point-spread function of a lens from focal length, f-number and wavelength. Its result has
  methods for width, encircled energy, Strehl ratio, MTF and a plot. `Pupil` adds a transmission and aberrations
  (Zernike coefficients, a function or a map) to the lens; `FocalLengths` adds field curvature and axial colour.
* `aperture_field` computes the complex field and the intensity that a point source produces anywhere behind a lens.
  Metrics such as `encircled_energy` and `modulation_transfer` accept the result of `point_spread`, and that of
  `aperture_field` on a regular grid.
* `microlens_image` computes the image of a point or a disc on the pixels behind a main lens and a microlens array, from
  the numbers in a `MicrolensCamera`. `chain_image` does the same for any `LightPath`: choose it to fix the number of
  the microlenses, their positions or their focal lengths.

Functions take and return NumPy arrays. Lengths are in metres, angles in radians. Sources, lenses, microlenses, pixels
and targets (the points at which a field is computed) share the same x and y axes: a source at x > 0 has its real image
at x < 0.

An argument of the wrong type raises Python's ``TypeError``, which names it: "focal_length must be a number in SI units,
not '50 mm'". Lists are accepted where arrays are, and whole numbers where real ones are. A value that does not make
sense raises ``OutOfRangeError`` with the values that do.

Fields, images and metrics come with an estimate of their numerical error. The exceptions are the fields of
`propagate_samples`, `diffraction_limited_peak`, `ChainImage.microlens_share`, and `at`, `moments` and `power_in` of
`PointSpread`. A function whose result misses the tolerance raises ``NotConvergedError``, with two exceptions. The
functions that take a `LightPath` return the image with ``within_tolerance`` False; they raise the error only if a check
shows that the sampling is wrong. `aperture_field` with node counts of your own returns the field with the error that
they cause. Errors are in ``tradestudy.errors``. A relative L2 error is the root of the sum of the squared errors,
divided by the root of the sum of the squared values; both sums extend over all targets, samples or pixels.

Examples
--------
Strehl ratio and MTF of an f/2.8 lens with a tenth of a wave (rms) of coma; then, with a microlens array behind this
lens, the fraction of the light through its pupil that falls on the pixels:

>>> from tradestudy import optics
>>> coma = optics.Pupil.from_waves({8: 0.1}, wavelength=550e-9)
>>> psf = optics.point_spread(focal_length=12.5e-3, f_number=2.8, wavelength=550e-9, pupil=coma)
>>> print(f"Strehl ratio {psf.strehl_ratio().value:.3f}, error below 1e-5: {psf.strehl_ratio().error < 1e-5}")
Strehl ratio 0.670, error below 1e-5: True
>>> along_x, along_y = (psf.modulation_transfer(200e3, angle=angle) for angle in (0.0, 1.5708))
>>> print(f"MTF at 200/mm: {along_x} along x, {along_y} along y")
MTF at 200/mm: 0.308 ± 0.008 along x, 0.437 ± 0.008 along y
>>> camera = optics.MicrolensCamera(
...     focal_length=12.5e-3,
...     f_number=2.8,
...     array_distance=12.9e-3,
...     microlens_focal_lengths=0.12e-3,
...     microlens_pitch=40e-6,
...     gap=0.13e-3,
...     pixel_pitch=4e-6,
...     pupil=coma,
... )
>>> spot = optics.microlens_image(
...     camera, optics.PointSource(distance=0.5), wavelength=550e-9, tolerance=1e-2
... )
>>> share = spot.share_on_pixels
>>> print(f"{share.value:.2f} of the light on {spot.pixels.shape} pixels, error below 0.02: {share.error < 0.02}")
0.98 of the light on (32, 32) pixels, error below 0.02: True
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tradestudy.optics._public import *  # noqa: F403  (listed there)


def __getattr__(name: str) -> Any:
    # Loaded on first use: checking a study needs a few laws, but neither SciPy nor Fourier transforms.
    # Python imports the modules of this package itself.
    if name == "__all__" or not (name.startswith("_") or find_spec(f"{__name__}.{name}")):
        public = import_module(f"{__name__}._public")
        if name == "__all__" or name in public.__all__:
            return getattr(public, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(import_module(f"{__name__}._public").__all__)
