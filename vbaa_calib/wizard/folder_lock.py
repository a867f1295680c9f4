"""One wizard at a time in a session's folder."""

from __future__ import annotations

from pathlib import Path
from typing import TextIO

from ..errors import InputError


def locked(path: Path) -> TextIO:
    """An open file that is locked until it is closed, or the process ends, however it ends.

    Raises InputError where another process has it, or where it cannot be written.
    """
    try:
        stream = path.open("a")
    except OSError as error:
        why = f"cannot be written ({error.strerror})"
        raise InputError(why, where=path.parent, remedy="name a folder that can be written") from None
    try:
        import fcntl

        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        stream.close()
        raise InputError(
            "another wizard works on this session", where=path.parent, remedy="end that one first"
        ) from None
    except (ImportError, OSError):  # no such locks there, as on some network drives; the files are whole all the same
        pass
    return stream
