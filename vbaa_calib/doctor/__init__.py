"""Is this installation healthy? What one look at it found."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import Any

from vbaa_calib.core.errors import Diagnosis

OK, LOOK, FAILS = "ok", "look", "fails"


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that was looked at.

    name : what was looked at. words : what was seen. numbers : for JSON.
    problems : what is wrong with it; none where it is well. A grave one means that something will not work.
    """

    name: str
    words: str
    problems: tuple[Diagnosis, ...] = ()
    numbers: dict[str, Any] = field(default_factory=dict)

    @property
    def status(self) -> str:
        return FAILS if any(problem.grave for problem in self.problems) else LOOK if self.problems else OK

    def to_dict(self) -> dict[str, Any]:
        problems = [problem.to_dict() for problem in self.problems]
        head = {"name": self.name, "status": self.status, "words": self.words}
        return head | {"problems": problems, "numbers": self.numbers}


def by_system(debian: str, macos: str, windows: str) -> str:
    """The remedy for the system at hand. Linux gets Debian's and Ubuntu's."""
    return {"darwin": macos, "win32": windows}.get(sys.platform, debian)


def pip(*words: str) -> str:
    """A pip command of this very Python, which need not be the one that `pip` belongs to."""
    return " ".join([sys.executable, "-m", "pip", *words])
