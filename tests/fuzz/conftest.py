"""A folder with one good file for every reader."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from ..hostile.conftest import good_files
from .fuzz import add_streams


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # hard links: a file that is changed is written anew
    work = Path(shutil.copytree(good_files(), tmp_path_factory.mktemp("fuzz") / "work", copy_function=os.link))
    return add_streams(work)
