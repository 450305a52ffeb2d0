"""Every hard case: ours is right where the usual formula breaks, against references that are made again here."""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hard.generate_references import FILE, table
from tradestudy.optics.propagation.paths import SphericalPath
from tradestudy.optics.thin_lens import focus_shift, image_distance, object_distance
from tradestudy.verification import all_families
from tradestudy.verification.case import (
    Family,
    NumericCase,
    OutcomeCase,
    Reference,
    allowed_error,
    judge,
    references,
    relative_error,
)

FAMILIES = all_families()
# A bound beyond this could hardly fail; what is worse conditioned has to be posed otherwise.
LARGEST_BOUND = 1e-2


def cases() -> Iterator[tuple[Family, NumericCase | OutcomeCase]]:
    return ((family, case) for family in FAMILIES for case in family.cases)


@pytest.mark.parametrize(("family", "case"), [pytest.param(f, c, id=f"{f.name}: {c.name}") for f, c in cases()])
def test_the_program_s_results_are_right(family: Family, case: NumericCase | OutcomeCase) -> None:
    verdict = judge(family, case, references().get(family.name, {}))
    assert verdict.met, verdict
    if isinstance(case, NumericCase):
        assert 0.0 < verdict.bound <= LARGEST_BOUND
        assert verdict.our_error <= verdict.bound


def test_the_table_is_what_its_generator_writes() -> None:
    made, stored = table(quick=True), references()
    assert {family: set(rows) for family, rows in made.items()} == {f: set(rows) for f, rows in stored.items()}
    for family, rows in made.items():
        for name, row in rows.items():
            if family == "fields":  # integrals, here by fewer nodes
                assert float(row["value"]) == pytest.approx(float(stored[family][name].value), rel=1e-9)
            else:
                assert row["value"] == stored[family][name].value
            assert row.get("scale", row["value"])[:9] == stored[family][name].scale[:9]
    assert FILE.read_text(encoding="utf-8").count('"value"') == sum(len(rows) for rows in made.values())


def test_names_are_unique_and_every_reference_has_thirty_digits() -> None:
    for family in FAMILIES:
        names = [case.name for case in family.cases]
        assert len(names) == len(set(names))
    for rows in references().values():
        for row in rows.values():
            value = Decimal(row.value)
            # Zeros, infinities and decimals that end are written short.
            assert not value.is_finite() or value == 0 or len(row.value.lstrip("-")) >= 3


def test_the_usual_formula_breaks_somewhere_in_every_family() -> None:
    """The catalogue would be no catalogue of hard cases otherwise: the usual formula misses the bound ours keeps."""
    for family in FAMILIES:
        verdicts = [judge(family, c, references()[family.name]) for c in family.cases if isinstance(c, NumericCase)]
        if verdicts:
            assert sum(not v.naive_error <= v.bound for v in verdicts) >= len(verdicts) / 4, family.name


def test_a_wrong_answer_is_detected() -> None:
    reference = Reference(value="1.00000000000000000000000000001", scale="1", condition_number=1.0)
    assert relative_error(1.0, reference) == pytest.approx(1e-29)
    assert relative_error(math.nan, reference) == math.inf
    assert relative_error(math.inf, Reference(value="inf", scale="inf", condition_number=math.inf)) == 0.0
    assert relative_error(-math.inf, Reference(value="inf", scale="inf", condition_number=math.inf)) == math.inf
    assert relative_error(1e300, Reference(value="inf", scale="inf", condition_number=math.inf)) == math.inf
    assert relative_error(1e-300, Reference(value="0", scale="0", condition_number=math.inf)) == math.inf
    thin_lens = FAMILIES[0]
    case = next(c for c in thin_lens.cases if isinstance(c, NumericCase) and c.name == "object at 10⁸ m")
    wrong = references()[thin_lens.name] | {
        case.name: Reference(value="0.0500000001", scale="0.0500000001", condition_number=1.0)
    }
    assert not judge(thin_lens, case, wrong).met


def test_the_bound_is_ten_magnified_roundings_beyond_a_trillionth() -> None:
    case = next(c for _, c in cases() if isinstance(c, NumericCase) and c.law.magnified and c.law.epsilon < 1e-10)
    for condition in (1.0, 1e3, 1e9):
        reference = Reference(value="1", scale="1", condition_number=condition)
        assert allowed_error(case, reference, "") == max(1e-12, 10.0 * condition * np.finfo(float).eps)


@given(
    z=st.floats(1e-5, 1e8),
    ratio=st.floats(-12.0, 1.0).map(lambda exponent: 10.0**exponent),
)
def test_path_differences_keep_their_digits_everywhere(z: float, ratio: float) -> None:
    rho = ratio * z
    with localcontext() as context:
        context.prec = 60
        distance, radius = Decimal(z), Decimal(rho)
        exact = (distance * distance + radius * radius).sqrt() - distance
        ours = Decimal(float(SphericalPath(x=0.0, y=0.0, distance=z).value(np.asarray(rho), np.asarray(0.0))))
        assert abs(ours - exact) < Decimal("1e-15") * exact


@given(a=st.floats(1e-6, 1e8), f=st.floats(1e-4, 1.0))
def test_the_thin_lens_keeps_its_digits_everywhere(a: float, f: float) -> None:
    if a == f:
        return
    with localcontext() as context:
        context.prec = 60
        far, focal = Decimal(a), Decimal(f)
        shift = focal * focal / (far - focal)
        assert abs(Decimal(float(focus_shift(a, f))) - shift) < Decimal("1e-15") * abs(shift)
        image = far * focal / (far - focal)
        assert abs(Decimal(float(image_distance(a, f))) - image) < Decimal("1e-15") * abs(image)
    if a > f:
        assert float(object_distance(focus_shift(a, f), f)) == pytest.approx(a, rel=1e-15)
