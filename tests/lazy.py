"""Modules that only some tests use: imported when they run, not when they are collected."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Lazy:
    """A module, imported when one of its names is used for the first time."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "_mock_name":  # which pytest asks every name of a test module for
            raise AttributeError(name)
        return getattr(import_module(self._name), name)
