"""A sample of what tests.campaigns.camera_files does in bulk."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.campaigns.camera_files import BOMBS, campaign, sources
from tests.study.camera_files import everybody
from tests.study.camera_files.test_import import refusal
from tests.study.camera_files.written import study


@pytest.mark.slow
def test_mutated_files_are_read_or_refused_with_a_message(tmp_path: Path) -> None:
    found = campaign(tmp_path, inputs=5, seed=7, keep=lambda *_: None)
    assert len(found) == 12 + len(everybody.RAW) + len(everybody.RECTIFIED)
    assert [line for tally in found.values() for line in tally.findings] == []


@pytest.mark.slow
def test_files_made_to_break_readers_are_refused_whatever_they_are_called(tmp_path: Path) -> None:
    for files, said in sources(tmp_path).values():
        for bomb in BOMBS:
            files[0].write_text(bomb)
            assert refusal(study(files[0].parent, rig=said))
