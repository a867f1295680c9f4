"""The wizard where nobody can type."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

MAIN = "import sys; from vbaa_calib.cli.main import main; sys.exit(main(['wizard', *sys.argv[1:]]))"


def test_without_a_terminal_it_never_waits(tmp_path: Path) -> None:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "TERM": "xterm"}
    command = ["/bin/sh", "-c", 'exec "$@" <&-', "sh", sys.executable, "-c", MAIN, "rig"]
    closed = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert closed.returncode == 2
    assert "board_along_x_mm is not answered" in closed.stderr
    assert "\033" not in closed.stderr
