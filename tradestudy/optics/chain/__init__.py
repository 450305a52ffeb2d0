"""Light through main lens and microlens array onto the pixels, by rays and by waves, with error estimates."""

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

__all__ = [
    "EXACT_RAYS",
    "FRESNEL",
    "GEOMETRIC",
    "KIRCHHOFF",
    "KIRCHHOFF_FRESNEL",
    "ChainAccuracy",
    "ChainImage",
    "DiscSource",
    "Legs",
    "LightPath",
    "Microlenses",
    "PixelGrid",
    "chain_image",
    "hexagonal_centres",
    "separate_image",
    "spectral_image",
    "square_centres",
]
