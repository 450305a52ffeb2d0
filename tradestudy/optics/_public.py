"""What `tradestudy.optics` offers, in one place."""

from __future__ import annotations

from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.image import chain_image, separate_image, spectral_image
from tradestudy.optics.chain.scene import (
    EXACT_RAYS,
    FRESNEL,
    GEOMETRIC,
    KIRCHHOFF,
    KIRCHHOFF_FRESNEL,
    Legs,
    LightPath,
    Microlenses,
    PixelGrid,
    hexagonal_centres,
    square_centres,
)
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.lens_point_spread import LensPointSpread, point_spread
from tradestudy.optics.microlens_camera import MicrolensCamera, microlens_image
from tradestudy.optics.propagation.aperture import aperture_field
from tradestudy.optics.propagation.kernels import ApertureSamples, FresnelKernel, KirchhoffKernel
from tradestudy.optics.propagation.lens import CircularLens, FocalLengths, PointSource
from tradestudy.optics.propagation.pupil import Pupil, noll_order
from tradestudy.optics.propagation.result import ApertureField
from tradestudy.optics.propagation.sampling import Limits, NodeCounts
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, propagate_samples
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes, rectangle_nodes
from tradestudy.optics.sampled_point_spread import Measured, PointSpread, as_point_spread
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
