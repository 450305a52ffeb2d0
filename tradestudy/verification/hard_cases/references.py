"""The stored references of hard cases; ``python -m tests.hard.generate_references`` writes them with mpmath."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

from tradestudy.verification.hard_cases.case import Reference


@cache
def references() -> Mapping[str, Mapping[str, Reference]]:
    """References by family and case."""
    text = files("tradestudy.verification.hard_cases").joinpath("references.json").read_text(encoding="utf-8")
    return {
        family: {
            name: Reference(
                value=row["value"],
                scale=row.get("scale", row["value"]),
                condition_number=float(row["condition_number"]),
            )
            for name, row in table.items()
        }
        for family, table in json.loads(text).items()
    }
