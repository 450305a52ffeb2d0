"""The headline study, computed once."""

from __future__ import annotations

from pathlib import Path

import pytest

import tradestudy
from tests.conftest import HeadlineRun
from tradestudy.api import Result, Study

STUDIES = Path(__file__).parents[2] / "studies"


@pytest.fixture(scope="session")
def headline() -> Study:
    return tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml")


@pytest.fixture(scope="session")
def headline_result(headline_run: HeadlineRun) -> Result:
    return tradestudy.open_result(headline_run.folder)
