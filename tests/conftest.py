"""A folder for the whole run, whatever the number of workers: see `made_once`."""

from __future__ import annotations

import gc
import os
import shutil
import tempfile

import pytest

from vbaa_calib.sources.files import silence_opencv

from .made_once import FOLDER

# FFmpeg's level is read once a process: before the first video, and tests write some
silence_opencv()
OWNED = pytest.StashKey[str]()
LONGEST = (
    "test_mistakes.py",
    "test_another_camera.py",
    "test_stiffness_photo.py",
    "test_fuzz.py",
    "test_first_hour.py",
)


def pytest_configure(config: pytest.Config) -> None:
    """Before the workers start: they inherit the environment."""
    if FOLDER not in os.environ:
        os.environ[FOLDER] = config.stash[OWNED] = tempfile.mkdtemp(prefix="vbaa-tests-")


def pytest_unconfigure(config: pytest.Config) -> None:
    if OWNED in config.stash:
        shutil.rmtree(config.stash[OWNED], ignore_errors=True)
        del os.environ[FOLDER]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first: as the last one each would leave the other worker idle."""
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))


def pytest_collection_finish() -> None:
    """What was imported stays: looking through it for garbage, as some tests and verbs do, takes half a second."""
    gc.collect()
    gc.freeze()
