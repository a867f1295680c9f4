"""Reading a scene file key by key: every refusal names the file, the key and what would be right."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose
from vbaa_calib.session import read_pose


def _is_finite(value: int | float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond the largest float
        return False


@dataclass(frozen=True)
class Section:
    """One mapping of a scene file.

    Attributes
    ----------
    values : the mapping.
    path : the file it stands in.
    key : its dotted name in the file, empty for the whole file.
    """

    values: Mapping[str, Any]
    path: Path
    key: str = ""

    def name(self, key: str) -> str:
        """The dotted name of a key in this section."""
        return f"{self.key}.{key}" if self.key else key

    def wrong(self, key: str, what: str, remedy: str) -> InputError:
        """The error for one key."""
        return InputError(f"{self.name(key)} {what}", where=self.path, remedy=remedy)

    def only(self, *known: str) -> Section:
        """This section, once it is sure that it holds no other keys: a misspelt key must not be ignored."""
        for key in self.values:
            if key not in known:
                raise self.wrong(str(key), "is not a known key", f"the keys here are {', '.join(known)}")
        return self

    def get(self, key: str, default: Any = None) -> Any:
        """The bare value; missing and without a default is an error."""
        value = self.values.get(key)
        if value is None and default is None:
            raise self.wrong(key, "is missing", "add it; the bundled scene demo.yaml shows every key")
        return default if value is None else value

    def has(self, key: str) -> bool:
        """Whether the key is there and not null."""
        return self.values.get(key) is not None

    def number(self, key: str, low: float = -math.inf, high: float = math.inf, default: float | None = None) -> float:
        """A finite number in [low, high]."""
        value = self.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
            raise self.wrong(key, f"is {value!r}", "a finite number is needed")
        if not low <= value <= high:
            raise self.wrong(key, f"is {value:g}", f"a number from {low:g} to {high:g} is needed")
        return float(value)

    def whole(self, key: str, low: int, high: int, default: int | None = None) -> int:
        """A whole number in [low, high]."""
        value = self.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.wrong(key, f"is {value!r}", f"a whole number from {low} to {high} is needed")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self.get(key, default)
        if not isinstance(value, bool):
            raise self.wrong(key, f"is {value!r}", "true or false is needed")
        return value

    def choice(self, key: str, choices: Sequence[str], default: str | None = None) -> str:
        """One of a few words."""
        value = self.get(key, default)
        if value not in choices:
            raise self.wrong(key, f"is {value!r}", f"one of {', '.join(choices)} is needed")
        return str(value)

    def array(self, key: str, shape: tuple[int, ...], default: Sequence[float] | None = None) -> np.ndarray:
        """Finite numbers of a given shape; a length of −1 is any."""
        value = self.get(key, default)
        sizes = " × ".join("n" if length < 0 else str(length) for length in shape)
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise self.wrong(key, "is not a list of numbers", f"{sizes} numbers are needed") from None
        fits = array.ndim == len(shape) and all(w in (-1, h) for w, h in zip(shape, array.shape, strict=True))
        if not fits or not np.isfinite(array).all():
            raise self.wrong(key, f"is {value!r}", f"{sizes} finite numbers are needed")
        return array

    def span(self, key: str, low: float, high: float, default: Sequence[float] | None = None) -> tuple[float, float]:
        """A range [first, last] within [low, high], first ≤ last."""
        first, last = self.array(key, (2,), default)
        if not low <= first <= last <= high:
            raise self.wrong(key, f"is [{first:g}, {last:g}]", f"a rising range within [{low:g}, {high:g}] is needed")
        return float(first), float(last)

    def direction(self, key: str) -> np.ndarray:
        """A unit vector (3,); the file may give it at any length."""
        vector = self.array(key, (3,))
        largest = float(np.abs(vector).max())
        if largest < 1e-9:
            raise self.wrong(key, "has no length", "a direction in x, y, z is needed")
        # scaled first: the square of a huge number is none
        return vector / largest / np.linalg.norm(vector / largest)

    def pose(self, key: str) -> Pose:
        """{translation_m: [x, y, z], rotation_xyzw: [x, y, z, w]}."""
        section = self.section(key).only("translation_m", "rotation_xyzw")
        parts = {
            "translation_m": section.array("translation_m", (3,)),
            "rotation_xyzw": section.array("rotation_xyzw", (4,)),
        }
        return read_pose(parts, self.path, self.name(key))

    def section(self, key: str, *, required: bool = True) -> Section:
        """A mapping below this one; empty when it may be missing and is."""
        value = self.get(key, None if required else {})
        if not isinstance(value, Mapping):
            raise self.wrong(key, f"is {value!r}", "a mapping of keys to values is needed")
        return Section(value, self.path, self.name(key))

    def sections(self, key: str) -> Iterator[Section]:
        """A list of mappings below this one, at least one."""
        value = self.get(key)
        if not isinstance(value, list) or not value:
            raise self.wrong(key, f"is {value!r}", "a list with at least one entry is needed")
        for index, entry in enumerate(value):
            if not isinstance(entry, Mapping):
                raise self.wrong(f"{key}[{index}]", f"is {entry!r}", "a mapping of keys to values is needed")
            yield Section(entry, self.path, self.name(f"{key}[{index}]"))
