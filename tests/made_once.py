"""What several test files need and takes seconds to make: made once in a run, by whichever worker is first."""

from __future__ import annotations

import atexit
import functools
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock

FOLDER = "VBAA_TESTS_FOLDER"
"""In the environment: a run's folder, which its workers share."""


@functools.cache
def shared_folder() -> Path:
    """The run's; outside a run one of this process's own."""
    if FOLDER in os.environ:
        return Path(os.environ[FOLDER])
    folder = Path(tempfile.mkdtemp(prefix="vbaa-tests-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def made_once(name: str, make: Callable[[Path], object]) -> Path:
    """A folder that `make` fills. Never to be written to by a test."""
    folder, done = shared_folder() / name, shared_folder() / f"{name}.done"
    with FileLock(shared_folder() / f"{name}.lock"):
        if not done.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            done.touch()
    return folder
