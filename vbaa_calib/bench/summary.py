"""What the suite of benchmarks comes down to: one line for each subject."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Line:
    """One subject: its headline or why it failed, the seconds it took, the names of its files."""

    subject: str
    headline: str
    seconds: float
    files: tuple[str, ...]
    failure: str = ""


def as_text(lines: Sequence[Line]) -> str:
    """The table for people."""
    width = max(len(line.subject) for line in lines)
    told = [
        f"{line.subject:<{width}}{line.seconds:>8.0f}  {f'failed: {line.failure}' if line.failure else line.headline}"
        for line in lines
    ]
    rows = [f"{'subject':<{width}}{'s':>8}  what it comes down to"]
    for line, text in zip(lines, told, strict=True):
        rows.append(text)
        if line.files:
            rows.append(f"{'':<{width + 10}}{', '.join(line.files)}")
    total = sum(line.seconds for line in lines)
    good = sum(not line.failure for line in lines)
    rows.append(f"{'all':<{width}}{total:>8.0f}  {good} of {len(lines)} subjects measured")
    return "\n".join(rows)
