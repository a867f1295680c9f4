"""Readers in a process of their own: what they return comes over whole; a crash or a loop is an error in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.convert import child
from vbaa_calib.convert.child import read_in_child

from .odd_readers import bomb, crash, loop, refuse, sound


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "a file"
    path.write_bytes(bytes(range(256)))
    return path


def test_arrays_come_over_whole(file: Path) -> None:
    found = read_in_child(sound, file)
    assert found["bytes"].tobytes() == file.read_bytes()
    np.testing.assert_array_equal(found["grid"], np.arange(6.0).reshape(2, 3))


@pytest.mark.parametrize(
    ("reader", "words"),
    [(crash, "crashed"), (loop, "no end"), (bomb, "memory"), (refuse, "no mesh in it")],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_what_a_reader_does_to_itself_is_an_error(
    file: Path, reader: object, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child, "_SECONDS", 1.0)
    with pytest.raises(ValueError, match=words):
        read_in_child(reader, file)  # type: ignore[arg-type]
