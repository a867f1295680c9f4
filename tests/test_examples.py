"""The examples run, and say what they promise."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
PROMISED = {
    "01_pixels_to_millimetres": r"x =  120\.00 mm",
    "02_the_papers_two_points": r"l = 120\.000 mm, f_y = 30\.000 mN",
    "03_one_frame": r"ok: l = (149|150)\.\d\d ± 0\.\d\d mm",
    "04_a_recording_at_once": r"friction 0\.2 rad: .*2[567]\d ok\n  distance off by \S+ mm rms, (0\.[7-9]|1\.[0-3]) ",
    "05_an_object_felt": r"friction 0\.(29|30)\d ± 0\.00\d \(true 0\.3\)",
}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example(path: Path) -> None:
    """Runs without a warning on stderr and prints its result."""
    done = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert re.search(PROMISED[path.stem], done.stdout)
