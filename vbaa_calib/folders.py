"""Folders written whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError
from .files import disk_told


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path` that takes its place only when the block ends well.

    Whether what is there may be replaced is for the caller to settle before.
    """
    parent = path.resolve().parent
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=parent))
    except OSError as error:
        raise InputError(f"cannot be made ({error.strerror})", where=path, remedy="take another name") from None
    try:
        with disk_told(path):
            yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o777 & ~umask)
        if path.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{path.name}-old-", dir=parent))
            path.rename(old / "replaced")
            try:
                temporary.rename(path)
            except OSError:
                (old / "replaced").rename(path)
                raise
            finally:
                shutil.rmtree(old)
        else:
            temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
