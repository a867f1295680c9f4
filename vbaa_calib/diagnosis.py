"""What a person has to know of a measurement, in two sentences: what was seen, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Diagnosis:
    """One thing that is wrong, or looks wrong, with what was measured.

    Attributes
    ----------
    name : stable, in snake_case: for scripts.
    words : what was seen, one clause, with its numbers.
    remedy : what to do.
    grave : the measurement must not be used as it is; else it deserves a look.
    """

    name: str
    words: str
    remedy: str
    grave: bool = False

    def __str__(self) -> str:
        return f"{self.words}; {self.remedy}"

    def to_dict(self) -> dict[str, str | bool]:
        """For JSON: the fields by name."""
        return {"name": self.name, "words": self.words, "remedy": self.remedy, "grave": self.grave}
