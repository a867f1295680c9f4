"""Readers for the tests of reading in another process, which imports this module and nothing heavy with it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np


def sound(path: Path) -> dict[str, np.ndarray]:
    return {"bytes": np.frombuffer(path.read_bytes(), np.uint8), "grid": np.arange(6.0).reshape(2, 3)}


def crash(_: Path) -> dict[str, np.ndarray]:
    os.abort()


def loop(_: Path) -> dict[str, np.ndarray]:
    while True:
        pass


def bomb(_: Path) -> dict[str, np.ndarray]:
    return {"zeros": np.ones(4_000_000_000)}


def refuse(_: Path) -> dict[str, np.ndarray]:
    raise ValueError("no mesh in it")
