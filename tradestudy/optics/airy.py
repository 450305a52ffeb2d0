"""The Airy pattern's first dark ring, as a number that needs no import."""

from __future__ import annotations

import math
from typing import Final

FIRST_DARK_RING: Final = 3.8317059702075125 / math.pi
"""1.2197, first zero of J₁ over π: radius of the first dark ring in λ N, N the working f-number."""
