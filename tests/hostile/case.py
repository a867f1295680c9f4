"""One row of the suite, and what is demanded of it."""

from __future__ import annotations

import os
import resource
import shlex
import signal
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from vbaa_calib.cli.main import main
from vbaa_calib.wizard.store import LOCK

Damage = Callable[[Path], None]
"""What befalls a file, or the whole folder."""

LONGEST_S = 60.0
"""Of processor time. The wall clock may show more where others share the machine."""
BLOCKED_S = 90.0
"""On the wall clock: it waits for something that never comes."""
MOST_BYTES = 3 << 30
"""Address space that a refusal may take on top of what the process has."""


@dataclass(frozen=True)
class Case:
    """A row.

    Attributes
    ----------
    name : of the case. path : of the file that is damaged, relative to the folder that the command runs in; "": none.
    damage : done to `path`. line : the command, without `vbaa`.
    words : all of them are in the one line that is expected.
    """

    name: str
    path: str
    damage: Damage
    line: str
    words: tuple[str, ...]

    @property
    def verb(self) -> str:
        return self.line.split()[0]

    @property
    def id(self) -> str:
        return f"{self.name} in {self.path or 'call'}: {self.line}"


class TooLong(BaseException):
    """No Exception, so that the command line does not take it for a failure of its own."""


@contextmanager
def bounded(seconds: float = LONGEST_S, memory: int = MOST_BYTES) -> Iterator[None]:
    """Ends the block with TooLong after so many seconds of work; an allocation beyond the bound fails."""

    def late(number: int, _: object) -> None:
        raise TooLong("it waits" if number == signal.SIGALRM else f"no end within {seconds:g} s")

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    before = {number: signal.signal(number, late) for number in (signal.SIGALRM, signal.SIGPROF)}
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, BLOCKED_S)
    resource.setrlimit(resource.RLIMIT_AS, (used + memory, hard))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def tree(root: Path) -> dict[str, str]:
    """Everything below a folder, hidden files included: a file's size and time, a link's target, or what else it is.

    The lock of a wizard's folder does not count: it stays.
    """
    found = {}
    for folder, folders, names in os.walk(root):
        for path in (Path(folder, name) for name in (*folders, *names) if name != LOCK):
            mode = path.lstat().st_mode
            if stat.S_ISLNK(mode):
                what = os.readlink(path)
            elif stat.S_ISREG(mode):
                status = path.stat()
                what = f"{status.st_ino} {status.st_size} {status.st_mtime_ns}"
            else:
                what = stat.filemode(mode)
            found[str(path.relative_to(root))] = what
    return found


def run(line: str) -> int:
    """The command in this process, bounded in time and memory."""
    with bounded():
        return main(shlex.split(line))


def expect_refused(code: int, out: str, err: str, words: tuple[str, ...]) -> None:
    """Exit 2 and one clear line with these words; nothing else."""
    last = err.strip().splitlines()[-1] if err.strip() else ""
    assert code == 2, f"exit {code}: {err}"
    assert out == ""
    assert last.startswith("vbaa: "), err
    assert err.count("vbaa: ") == 1, err
    assert "Traceback" not in err
    assert "should not" not in err
    assert len(last) < 2000, f"{len(last)} characters"
    missing = [word for word in words if word not in last]
    assert not missing, f"{missing} not in: {last}"


Row = tuple[str, Damage, *tuple[str, ...]]
"""Name, damage, words."""


def cases(path: str, line: str, rows: tuple[Row, ...]) -> list[Case]:
    """Rows about one file and one command; the file's name is among the words that are expected."""
    return [Case(name, path, damage, line, (path.rpartition("/")[2], *words)) for name, damage, *words in rows]
