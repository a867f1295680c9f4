"""Presses in time: centrelines at the pictures' instants, moments at the readings', of the static rod."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.table.contacts import Measured

from ..rod_scenes import LENGTH_M, SIGMA_PX, World, camera_pose, frames

WORLD = World(camera_pose(0.6, 1.0))
PRESS_N = 0.02


@dataclass(frozen=True)
class Motion:
    """Presses of the antenna: each at a place, in a direction and as long as chance has it, with pauses between them.

    times_s : (P + 1,) where they begin. contact, turn_rad : (P,) part of the length, and the force's direction.
    """

    times_s: np.ndarray
    contact: np.ndarray
    turn_rad: np.ndarray

    @staticmethod
    def drawn(rng: np.random.Generator, length_s: float, press_s: float = 0.8) -> Motion:
        count = int(np.ceil(length_s / (0.6 * press_s))) + 1
        times = -0.3 + np.cumsum(rng.uniform(0.6, 1.4, count + 1) * press_s)
        return Motion(times, rng.uniform(0.45, 0.9, count), rng.uniform(-np.pi, np.pi, count))

    def at(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contact (B,), m, and lateral force (B, 2), N."""
        index = np.clip(np.searchsorted(self.times_s, times_s) - 1, 0, len(self.contact) - 1)
        share = (times_s - self.times_s[index]) / np.diff(self.times_s)[index]
        size = PRESS_N * np.clip(np.sin(np.pi * share / 0.7), 0.0, None) * (share < 0.7) * (share > 0.0)
        turn = self.turn_rad[index]
        return self.contact[index] * LENGTH_M, size[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def pictures(motion: Motion, times_s: np.ndarray, rng: np.random.Generator, world: World = WORLD) -> list[Measured]:
    """What the camera sees at these times."""
    contact, lateral = motion.at(times_s)
    several = frames(world, contact.tolist(), lateral.tolist(), [0.3] * len(times_s), rng, points=80)
    return [
        Measured(each.points_px, np.full(80, SIGMA_PX), np.nan, 0.0, 0.3, time_s=float(time_s))
        for each, time_s in zip(several, times_s, strict=True)
    ]


def readings(motion: Motion, times_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(R,) what the sensor reads at these times."""
    contact, lateral = motion.at(times_s)
    several = frames(WORLD, contact.tolist(), lateral.tolist(), [0.3] * len(times_s), rng, points=2)
    return np.array([each.moment_Nm for each in several])
