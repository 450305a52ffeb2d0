"""Hard cases: inputs at which formulas break down, computed by the textbook formula and by this program's.

Both formulas are evaluated in every run and compared with references of thirty digits, which are stored.
"""

from __future__ import annotations

from tradestudy.verification.case import Family
from tradestudy.verification.geometry import DEPTH_OF_FIELD, THIN_LENS, TRIANGULATION
from tradestudy.verification.propagation import PROPAGATION
from tradestudy.verification.study_files import STUDY_FILES
from tradestudy.verification.wave_optics import EQUATION_27, FIELDS, PHASES


def all_families() -> tuple[Family, ...]:
    """All families, in the order of the report."""
    return (
        THIN_LENS,
        TRIANGULATION,
        PHASES,
        FIELDS,
        EQUATION_27,
        DEPTH_OF_FIELD,
        PROPAGATION,
        STUDY_FILES,
    )
