"""The last figures of a campaign, written beside it by the campaign itself and by nothing else."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from tradestudy import provenance

HERE = Path(__file__).parent


def write(
    name: str,
    title: str,
    command: str,
    header: Sequence[str],
    rows: Sequence[Sequence[object]],
    folder: Path = HERE,
    note: str = "",
) -> Path:
    """Write ``NAME.md``: when, with what, and a table of counts, with a note on what is counted."""
    versions = ", ".join(f"{library} {version}" for library, version in provenance.versions().items())
    lines = [
        f"# {title}",
        "",
        f"Written by `{command}` on {datetime.now(UTC):%Y-%m-%d %H:%M} UTC; do not edit.",
        f"{platform.system()} {platform.machine()}, {provenance.machine()['cores']} cores shared with other work; "
        f"code {provenance.code_hash()[:12]}; {versions}.",
        "",
        *((note, "") if note else ()),
        f"| {' | '.join(header)} |",
        f"|{'---|' * len(header)}",
        *(f"| {' | '.join(map(str, row))} |" for row in rows),
    ]
    path = folder / f"{name}.md"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
