"""How much of a sinusoid's contrast each step of a picture passes: defocus, diffraction, the pixel.

All are on the axis, rotationally symmetric unless said otherwise, and take spatial frequencies [cycles/m] in the plane
in which their blur is measured. They are 1 at frequency 0; negative values are contrast reversals.
"""

from tradestudy.imaging.transfer.defocus import disc_transfer
from tradestudy.imaging.transfer.diffraction import airy_transfer
from tradestudy.imaging.transfer.fresnel import fresnel_transfer
from tradestudy.imaging.transfer.kirchhoff_lattice import kirchhoff_transfers, lattice_defocus, lattice_points
from tradestudy.imaging.transfer.pixel import square_transfer

__all__ = [
    "airy_transfer",
    "disc_transfer",
    "fresnel_transfer",
    "kirchhoff_transfers",
    "lattice_defocus",
    "lattice_points",
    "square_transfer",
]
