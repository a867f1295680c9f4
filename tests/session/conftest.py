"""A session that can be read."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from .files import GOOD, LOADS, NOLOAD, RECORDING, write


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A session with two rows in every table; nothing is in the pictures."""
    tables = {"noload/noload.csv": NOLOAD, "loads/loads.csv": LOADS, "recording/recording.csv": RECORDING}
    for name, text in tables.items():
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
        for picture in ("a.png", "b.png"):
            cv2.imwrite(str((tmp_path / name).with_name(picture)), np.zeros((8, 12), np.uint8))
    write(tmp_path, GOOD)
    return tmp_path
