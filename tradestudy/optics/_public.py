"""What `tradestudy.optics` offers, in one place."""

from __future__ import annotations

from tradestudy.optics.chain import (
    EXACT_RAYS,
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
    hexagonal_centres,
    separate_image,
    spectral_image,
    square_centres,
)
from tradestudy.optics.focal_lengths import FocalLengths
from tradestudy.optics.lens_point_spread import LensPointSpread, point_spread
from tradestudy.optics.microlens_camera import MicrolensCamera
from tradestudy.optics.propagation import (
    ApertureField,
    ApertureSamples,
    CircularLens,
    FieldAccuracy,
    FresnelKernel,
    KirchhoffKernel,
    Limits,
    NodeCounts,
    PointSource,
    TargetGrid,
    TargetPoints,
    aperture_field,
    propagate_samples,
)
from tradestudy.optics.propagation.pupil import Pupil
from tradestudy.optics.propagation.zernike import noll_order
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes, rectangle_nodes
from tradestudy.optics.refined_image import microlens_image
from tradestudy.optics.sampled_point_spread import Measured, PointSpread
from tradestudy.optics.spread_fields import as_point_spread
from tradestudy.optics.spread_metrics import (
    diffraction_limited_peak,
    encircled_energy,
    encircled_energy_radius,
    full_width_at_half_maximum,
    rms_width,
    strehl_ratio,
)
from tradestudy.optics.spread_shares import (
    modulation_transfer,
    pixel_shares,
    share_on_neighbouring_pixels,
    share_outside_disc,
    window_share,
)

__all__ = [
    "EXACT_RAYS",
    "FRESNEL",
    "GEOMETRIC",
    "KIRCHHOFF",
    "KIRCHHOFF_FRESNEL",
    "ApertureField",
    "ApertureSamples",
    "ChainAccuracy",
    "ChainImage",
    "CircularLens",
    "DiscSource",
    "FieldAccuracy",
    "FocalLengths",
    "FresnelKernel",
    "KirchhoffKernel",
    "Legs",
    "LensPointSpread",
    "LightPath",
    "Limits",
    "Measured",
    "MicrolensCamera",
    "Microlenses",
    "NodeCounts",
    "PixelGrid",
    "PointSource",
    "PointSpread",
    "Pupil",
    "QuadratureNodes",
    "TargetGrid",
    "TargetPoints",
    "aperture_field",
    "as_point_spread",
    "chain_image",
    "diffraction_limited_peak",
    "disc_nodes",
    "encircled_energy",
    "encircled_energy_radius",
    "full_width_at_half_maximum",
    "hexagonal_centres",
    "microlens_image",
    "modulation_transfer",
    "noll_order",
    "pixel_shares",
    "point_spread",
    "propagate_samples",
    "rectangle_nodes",
    "rms_width",
    "separate_image",
    "share_on_neighbouring_pixels",
    "share_outside_disc",
    "spectral_image",
    "square_centres",
    "strehl_ratio",
    "window_share",
]
