"""A session's pictures changed, and what a refusal looks like."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from .conftest import Outcome

Damage = Callable[[Path], None]

PICTURES = {"noload": "noload/noload_001.png", "recording": "recording/frame_0003.png"}


def truncate(name: str, share: float = 0.7) -> Damage:
    """A file cut short."""

    def damage(root: Path) -> None:
        data = (root / name).read_bytes()
        (root / name).write_bytes(data[: int(len(data) * share)])

    return damage


def repaint(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    """A picture put in place of another."""

    def damage(root: Path) -> None:
        for path in sorted(root.glob(name)):
            picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert cv2.imwrite(str(path), change(picture))

    return damage


def grey(picture: np.ndarray) -> np.ndarray:
    return np.full_like(picture, 90)


def noise(picture: np.ndarray) -> np.ndarray:
    return np.random.default_rng(1).normal(90, 12, picture.shape).clip(0, 255).astype(np.uint8)


def smaller(picture: np.ndarray) -> np.ndarray:
    return cv2.resize(picture, (picture.shape[1] // 2, picture.shape[0] // 2))


def refused(said: Outcome, *words: str) -> None:
    assert said.code == 2, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert said.err.startswith("vbaa: ")
    assert "Traceback" not in said.err
    for word in words:
        assert word in said.err
