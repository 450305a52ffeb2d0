"""What every part of a study file has in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict

from tradestudy.declarations.mistakes import MistakeAt


class Part(BaseModel):
    """A mapping in a study file: unknown keys are mistakes, values never change after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @classmethod
    def mistakes_of_names(cls, tree: Mapping[str, Any]) -> list[MistakeAt]:  # noqa: ARG003 - for parts that refer to names
        """Names that refer to nothing, looked for in the plain values, so that other mistakes do not hide them."""
        return []
