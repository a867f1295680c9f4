"""Tapered antennas: diameter, stiffness and weight along the antenna."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vbaa_calib.core.errors import InputError

Profile = tuple[tuple[float, float], ...]
"""Rows of arc length from the clamp, m, and a value there; linear between rows, and two rows at one place a step."""


@dataclass(frozen=True)
class _TaperSettings:
    """Bounds of profiles."""

    ratio: float = 20.0  # of the thickest diameter to the thinnest
    rows: int = 12
    parts: int = 400  # of the antenna, for its small deflections


@dataclass(frozen=True, eq=False)
class Taper:
    """Diameter and stiffness along an antenna, relative to those at its clamp; places are in antenna lengths.

    Attributes
    ----------
    pieces : (P, 7) rows: start, end, diameter at both, n-th root of EI at both, and n: 4 where EI follows from the
        diameter, 1 where EI itself is known. (0, 7) for a uniform antenna.
    """

    pieces: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))

    def __bool__(self) -> bool:
        """Whether the antenna is not uniform."""
        return len(self.pieces) > 0

    @staticmethod
    def of(
        profile: Sequence[Sequence[float]] | None, stiffness_profile: Sequence[Sequence[float]] | None, length_m: float
    ) -> Taper:
        """The taper from profiles of diameter, m, and EI, in any unit, along an antenna; where one is missing, EI is
        proportional to the diameter's fourth power. Raises InputError for an invalid profile."""
        if profile is None and stiffness_profile is None:
            return Taper()
        names, bounds = ("profile", "stiffness_profile"), (_TaperSettings.ratio, _TaperSettings.ratio**4)
        tables = [
            np.array([[0.0, 1.0], [1.0, 1.0]]) if rows is None else _relative(rows, name, length_m, largest)
            for rows, name, largest in zip((profile, stiffness_profile), names, bounds, strict=True)
        ]
        ends = np.unique(np.concatenate([table[:, 0] for table in tables]))
        sides = [np.column_stack(_both_sides(table, ends)) for table in tables]
        power = np.full(len(ends) - 1, 4.0 if stiffness_profile is None else 1.0)
        root = sides[0] if stiffness_profile is None else sides[1]
        return Taper(np.column_stack([ends[:-1], ends[1:], sides[0], root, power]))

    def thinned(self, log_tip: float) -> Taper:
        """The taper with its diameters multiplied by a factor that changes linearly from 1 at the clamp to
        exp(log_tip) at the tip."""
        if log_tip == 0.0:
            return self
        pieces = self.pieces.copy() if self else np.array([[0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 4.0]])
        factor = np.exp(log_tip * pieces[:, :2])
        pieces[:, 2:4] *= factor
        pieces[:, 4:6] *= factor ** (4.0 / pieces[:, 6:])
        return Taper(pieces)

    def diameter(self, place: np.ndarray) -> np.ndarray:
        """Relative diameter (N,) at places (N,) in antenna lengths."""
        return self._between(place, 2)

    @property
    def middle(self) -> float:
        """Relative diameter half way."""
        return float(self.diameter(np.array([0.5]))[0])

    def stiffness(self, place: np.ndarray) -> np.ndarray:
        """Relative EI (N,) at places (N,) in antenna lengths."""
        power = self.pieces[self._piece(place), 6] if self else 1.0
        return self._between(place, 4) ** power

    @property
    def weight(self) -> float:
        """Weight of the whole antenna relative to a uniform one of the clamp's diameter."""
        if not self:
            return 1.0
        start, end, first, last = self.pieces[:, :4].T
        return float((end - start) @ (first**2 + first * last + last**2) / 3.0)

    def yielding(self, place: np.ndarray) -> np.ndarray:
        """(N,) deflection at places (N,) per force there, relative to a uniform antenna's; small deflections."""
        return self._softened(place, 2)

    def turning(self, place: np.ndarray) -> np.ndarray:
        """(N,) slope at places (N,) per force there, relative to a uniform antenna's; small deflections."""
        return self._softened(place, 1)

    def _softened(self, place: np.ndarray, power: int) -> np.ndarray:
        if not self:
            return np.ones(np.shape(place))
        share = (np.arange(_TaperSettings.parts) + 0.5) / _TaperSettings.parts
        softer = 1.0 / self.stiffness(share * np.asarray(place, float)[..., None])
        return np.asarray(((1 + power) * softer * (1.0 - share) ** power).mean(axis=-1))

    def _piece(self, place: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(self.pieces[:, 0], place, side="right") - 1, 0, len(self.pieces) - 1)

    def _between(self, place: np.ndarray, column: int) -> np.ndarray:
        place = np.asarray(place, float)
        if not self:
            return np.ones(place.shape)
        piece = self.pieces[self._piece(place)]
        share = np.clip((place - piece[..., 0]) / (piece[..., 1] - piece[..., 0]), 0.0, 1.0)
        return piece[..., column] + share * (piece[..., column + 1] - piece[..., column])


UNIFORM = Taper()


def _relative(rows: Sequence[Sequence[float]], name: str, length_m: float, largest: float) -> np.ndarray:
    """(K, 2) table of a profile: places in antenna lengths, values relative to the first. Raises InputError for an
    invalid profile."""
    what = f"antenna.{name}"
    table = np.array([tuple(row) for row in rows], float)
    if (
        table.ndim != 2
        or not 2 <= len(table) <= _TaperSettings.rows
        or table.shape[1] != 2
        or not np.isfinite(table).all()
    ):
        raise InputError(
            f"{what} is not of 2 to {_TaperSettings.rows} rows of two numbers", remedy="give [[s_m, value], …]"
        )
    s, values = table.T
    if (np.diff(s) < 0.0).any() or (s[2:] == s[:-2]).any():
        raise InputError(f"{what}: places do not grow", remedy="two rows at one place are a step, three nothing")
    if s[0] != 0.0 or abs(s[-1] - length_m) > 1e-6 * length_m or s[0] == s[1] or s[-1] == s[-2]:
        raise InputError(
            f"{what} runs from {s[0]:g} to {s[-1]:g} m, the antenna from 0 to {length_m:g} m",
            remedy="begin at the clamp, s = 0, and end at length_m",
        )
    if not values.min() > 0.0 or values.max() > largest * values.min():
        end = " ends in a point" if values.min() == 0.0 else f" falls to {values.min():g}"
        raise InputError(
            f"{what}{end}: no more than {largest:g} to 1 can be solved for",
            remedy=f"let it end blunt, at {values.max() / largest:.2g} or more: what is thinner bears no force",
        )
    s[-1] = length_m
    return np.column_stack([s / length_m, values / values[0]])


def _both_sides(table: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (N − 1,) of a table (K, 2) just after each part's start, and just before its end."""
    s, values = table.T

    def read(at: np.ndarray, row: np.ndarray) -> np.ndarray:
        row = np.clip(row, 1, len(s) - 1)
        return values[row - 1] + (values[row] - values[row - 1]) * (at - s[row - 1]) / (s[row] - s[row - 1])

    after, before = np.searchsorted(s, ends[:-1], side="right"), np.searchsorted(s, ends[1:], side="left")
    return read(ends[:-1], after), read(ends[1:], before)


def profiles_to_dict(antenna: Any) -> dict[str, Any]:
    """The entries `profile` and `stiffness_profile` of an antenna in session.yaml or rig.json, where it has them."""
    profiles = {name: getattr(antenna, name) for name in ("profile", "stiffness_profile")}
    return {name: [list(row) for row in rows] for name, rows in profiles.items() if rows is not None}
