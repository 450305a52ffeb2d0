"""Light behind one aperture: geometric, boundary wave, Fresnel, Kirchhoff, each with an error bar."""

from tradestudy.optics.propagation.aperture import METHODS, aperture_field, lens_wave
from tradestudy.optics.propagation.kernels import ApertureSamples, FresnelKernel, Kernel, KirchhoffKernel, direct_sum
from tradestudy.optics.propagation.lens import (
    LENS_PHASES,
    OBLIQUITIES,
    CircularLens,
    LensPhase,
    LensWave,
    Obliquity,
    PointSource,
    finite_image_distance,
)
from tradestudy.optics.propagation.result import ApertureField, Effort, Method, NumericalError
from tradestudy.optics.propagation.sampling import Limits, NodeCounts, needed_nodes
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints, Targets
from tradestudy.optics.propagation.wave_optics import (
    FieldAccuracy,
    nodes_for,
    propagate_samples,
    propagate_wave,
    sample_wave,
)

__all__ = [
    "LENS_PHASES",
    "METHODS",
    "OBLIQUITIES",
    "ApertureField",
    "ApertureSamples",
    "CircularLens",
    "Effort",
    "FieldAccuracy",
    "FresnelKernel",
    "Kernel",
    "KirchhoffKernel",
    "LensPhase",
    "LensWave",
    "Limits",
    "Method",
    "NodeCounts",
    "NumericalError",
    "Obliquity",
    "PointSource",
    "TargetGrid",
    "TargetPoints",
    "Targets",
    "aperture_field",
    "direct_sum",
    "finite_image_distance",
    "lens_wave",
    "needed_nodes",
    "nodes_for",
    "propagate_samples",
    "propagate_wave",
    "sample_wave",
]
