"""Every family of hard cases."""

from __future__ import annotations

from tradestudy.verification.hard_cases.case import Family
from tradestudy.verification.hard_cases.depth_of_field import DEPTH_OF_FIELD
from tradestudy.verification.hard_cases.equation_27 import EQUATION_27
from tradestudy.verification.hard_cases.fields import FIELDS
from tradestudy.verification.hard_cases.phases import PHASES
from tradestudy.verification.hard_cases.propagation import PROPAGATION
from tradestudy.verification.hard_cases.study_files import STUDY_FILES
from tradestudy.verification.hard_cases.thin_lens import THIN_LENS
from tradestudy.verification.hard_cases.triangulation import TRIANGULATION


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
