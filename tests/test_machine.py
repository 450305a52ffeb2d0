"""The description of the machine."""

from __future__ import annotations

from tradestudy import machine


def test_a_machine_is_identified_by_its_processor_and_cores() -> None:
    identity = machine.identity()
    assert set(identity) == {"processor", "architecture", "cores"}
    assert identity["processor"]
    assert int(identity["cores"]) >= 1
    assert machine.identity() == identity
