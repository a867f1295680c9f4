"""What every subject of `vbaa bench` is given and what it gives back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Options:
    """What a subject is asked for.

    Attributes
    ----------
    draws : noise draws of each cell; what a draw is, is the subject's word.
    quick : less of everything, for a first look: the subject chooses where `draws` says nothing.
    jobs : processes, where a subject can use more than one.
    """

    seed: int
    draws: int
    quick: bool
    jobs: int = 1


@dataclass(frozen=True, eq=False)
class Findings:
    """What a subject found.

    Attributes
    ----------
    text : the tables for people.
    tables : file name → rows, all instances of one dataclass.
    figures : file name → what writes it, given the path and whether an older file may be replaced.
    numbers : what --json prints; NaN and infinity become null.
    headline : what it comes down to, in at most 100 characters; for the suite's summary.
    versions : of what else was measured than the packages that the subject is known to need.
    """

    text: str
    tables: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    figures: Mapping[str, Callable[[Path, bool], None]] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    headline: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
