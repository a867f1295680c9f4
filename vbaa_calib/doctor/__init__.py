"""The findings of `vbaa doctor`, and what its remedies share."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import Any, Literal

from vbaa_calib.core.errors import Diagnosis


@dataclass(frozen=True, eq=False)
class HealthFinding:
    """The result of one check: what was seen, in words and as numbers for JSON, and the problems, if any."""

    name: str
    words: str
    problems: tuple[Diagnosis, ...] = ()
    numbers: dict[str, Any] = field(default_factory=dict)

    @property
    def status(self) -> Literal["ok", "look", "fails"]:
        return "fails" if any(problem.grave for problem in self.problems) else "look" if self.problems else "ok"

    def to_dict(self) -> dict[str, Any]:
        problems = [problem.to_dict() for problem in self.problems]
        head = {"name": self.name, "status": self.status, "words": self.words}
        return head | {"problems": problems, "numbers": self.numbers}


def by_system(debian: str, macos: str, windows: str) -> str:
    """The remedy for this operating system; every Linux gets Debian's."""
    return {"darwin": macos, "win32": windows}.get(sys.platform, debian)


def pip(*words: str) -> str:
    """A pip command for this Python (plain `pip` may belong to another)."""
    return " ".join([sys.executable, "-m", "pip", *words])
