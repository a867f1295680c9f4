"""Numbers in the wrong unit that are possible all the same: told, not refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from .case import run


@pytest.mark.parametrize(("moment", "told"), [("-1.02", True), ("-0.00102", False), ("0.5", False)])
def test_a_free_antennas_moment_in_millinewton_metres(
    folder: Path, capsys: pytest.CaptureFixture[str], moment: str, told: bool
) -> None:
    capsys.readouterr()
    free = "session/recording/frame_0000.png --pan=0.197222 --tilt=-0.244346"
    code = run(f"check rig.json --free {free} --moment={moment} --json")
    findings = json.loads(capsys.readouterr().out)["session_findings"]
    (sensor,) = (finding for finding in findings if finding["name"] == "sensor_offset")
    assert ("give it in N·m" in (sensor["remedy"] or "")) == told
    assert (sensor["level"] == "holds") == (code == 0) == (moment == "-0.00102")
