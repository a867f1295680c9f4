"""Writing whole folders: by one writer at a time, completely or not at all."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .errors import InputError, reason_of
from .files import disk_errors_named, signals_deferred, umask


def make_folder(path: Path) -> None:
    """Make a folder and its parents unless they exist. Raises InputError."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        what = f"cannot be made ({reason_of(error)})"
        raise InputError(what, where=path, remedy="name another folder") from None


@contextlib.contextmanager
def writing_alone(path: Path) -> Iterator[None]:
    """Context of the only writer of a folder, which need not exist. Raises InputError where another one is at work.

    The lock lies next to the folder and goes with the process that has it, however that ends.
    """
    from filelock import FileLock, Timeout

    place = path.resolve()
    lock_path = place.parent / f".{place.name}.lock"
    lock = FileLock(lock_path, blocking=False)
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise InputError(
            "is being written by another command", where=path, remedy="wait for its end, or take another name"
        ) from None
    except NotImplementedError:  # no locks there, as on some network drives
        pass
    except OSError as error:
        raise InputError(f"cannot be made ({error.strerror})", where=path, remedy="take another name") from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # some systems keep a file that is open
            lock_path.unlink(missing_ok=True)
        lock.release()


@contextlib.contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """Context with a temporary folder next to `path` that replaces it only if the block succeeds.

    The caller decides beforehand whether an existing folder may be replaced. Remains of a writer that was killed are
    removed; an old folder that it had moved away gets its name back. Raises InputError where another writer is at
    work.
    """
    parent, temporary, old = path.resolve().parent, None, None
    with writing_alone(path):
        _tidied(parent, path)
        try:
            with signals_deferred():
                try:
                    temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}-new-", dir=parent))
                except OSError as error:
                    what = f"cannot be made ({error.strerror})"
                    raise InputError(what, where=path, remedy="take another name") from None
            with disk_errors_named(path):
                yield temporary
            temporary.chmod(0o777 & ~umask())
            # between the two names nothing may interrupt: there would be neither the old nor the new
            with signals_deferred():
                if path.exists():
                    old = Path(tempfile.mkdtemp(prefix=f".{path.name}-old-", dir=parent))
                    path.rename(old / "replaced")
                try:
                    temporary.rename(path)
                except OSError:
                    if old is not None:
                        (old / "replaced").rename(path)
                    raise
        finally:
            if temporary is not None:
                shutil.rmtree(temporary, ignore_errors=True)
            if old is not None and path.exists():
                shutil.rmtree(old, ignore_errors=True)


def _tidied(parent: Path, path: Path) -> None:
    """Clean up after a writer that was killed between the two renames: the old folder gets its name back."""
    for left in sorted(parent.glob(f".{path.name}-old-????????")):
        if not path.exists() and (left / "replaced").is_dir():
            (left / "replaced").rename(path)
        shutil.rmtree(left, ignore_errors=True)
    for left in parent.glob(f".{path.name}-new-????????"):
        shutil.rmtree(left, ignore_errors=True)
