"""Compiled functions: where nothing can be kept, they work all the same."""

from __future__ import annotations

import tempfile
from typing import NoReturn

import pytest

from vbaa_calib.core import compiled


def _twice(value: float) -> float:
    return 2.0 * value


def _half(value: float) -> float:
    return 0.5 * value


def test_where_nothing_can_be_kept_it_is_said_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def read_only(**_: object) -> NoReturn:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(tempfile, "TemporaryFile", read_only)
    compiled._say_once.cache_clear()
    twice, half = compiled.kernel(_twice), compiled.kernel(_half)
    compiled._say_once.cache_clear()
    assert half(twice(3.0)) == 3.0
    assert capsys.readouterr().err.count("\n") == 1
