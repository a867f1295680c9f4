"""A program in a terminal of its own, typed to and read as a person would."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Sequence
from pathlib import Path

_MOVES = re.compile(r"\x1b(?:\[[0-9;]*[A-Za-z]|[78])")


class PseudoTerminal:
    """`vbaa` with `arguments` in a terminal of 80 by 30. `screen` is all that came, without colours and moves."""

    def __init__(self, arguments: Sequence[str], cwd: Path, term: str = "xterm") -> None:
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 80, 0, 0))
        environment = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "LINES", "NO_COLOR")}
        # a shell that runs the tests in the background has Ctrl-C ignored, and children inherit that
        code = (
            "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
            "from vbaa_calib.cli.main import main; sys.exit(main())"
        )
        self.process = subprocess.Popen(
            [sys.executable, "-c", code, *arguments],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            cwd=cwd,
            env={**environment, "TERM": term, "OMP_NUM_THREADS": "1", "PYTHONUTF8": "1"},
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        os.close(theirs)
        self.raw = ""
        self._read_to = 0

    @property
    def screen(self) -> str:
        """All that was written so far, line ends as in a file; what was written over stands on a line of its own."""
        return _MOVES.sub("", self.raw.replace("\r\x1b[K", "\n")).replace("\r\n", "\n")

    def until(self, words: str, timeout_s: float = 60.0) -> str:
        """What came since the last call up to and with `words`, blanks and line ends taken for the same."""
        pattern = re.compile(r"\s+".join(map(re.escape, words.split())))
        end = time.monotonic() + timeout_s
        while True:
            found = pattern.search(self.screen, self._read_to)
            if found:
                seen = self.screen[self._read_to : found.end()]
                self._read_to = found.end()
                return seen
            left = end - time.monotonic()
            assert left > 0, f"never {words!r} in:\n{self.screen[self._read_to :]}"
            assert self._more(left), f"ended without {words!r}:\n{self.screen[self._read_to :]}"

    def type(self, line: str) -> None:
        """A line, and Enter."""
        os.write(self._ours, f"{line}\n".encode())

    def press(self, key: bytes) -> None:
        """A key: b"\\x03" is Ctrl-C, b"\\x04" Ctrl-D."""
        os.write(self._ours, key)

    def ended(self, timeout_s: float = 60.0) -> int:
        """The exit code, once it has ended."""
        end = time.monotonic() + timeout_s
        while self._more(max(end - time.monotonic(), 0.0)):
            assert time.monotonic() < end, f"does not end:\n{self.screen[self._read_to :]}"
        return self.process.wait(max(end - time.monotonic(), 1.0))

    def close(self) -> None:
        """End it, whatever it does."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        os.close(self._ours)

    def _more(self, timeout_s: float) -> bool:
        """Read what there is. False at the end."""
        ready, _, _ = select.select([self._ours], [], [], min(timeout_s, 0.2))
        if not ready:
            return True
        try:
            data = os.read(self._ours, 65536)
        except OSError:  # a terminal whose other side was closed
            return False
        self.raw += data.decode("utf-8", "replace")
        return bool(data)
