"""Report and scene with frame-wise contacts beside refined ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.table.files import write_contacts
from vbaa_calib.cli.main import main
from viz.scene.layout import LOOK

from ..estimator.test_next_touch import given


@pytest.mark.slow
def test_both_are_drawn_and_another_recording_is_refused(tmp_path: Path) -> None:
    table, _ = given("sphere", np.inf, 37)
    refined = replace(table, distance_std_m=0.6 * table.distance_std_m, point_world_m=table.point_world_m + 5e-4)
    for name, one in (("contacts", table), ("refined", refined), ("other", table.picked(slice(3, None)))):
        write_contacts(tmp_path / f"{name}.csv", one.rows())
    report, scene = tmp_path / "report.html", tmp_path / "scene.html"
    both = [str(tmp_path / "refined.csv"), "--framewise", str(tmp_path / "contacts.csv")]
    assert main(["report", *both, "-o", str(report)]) == 0
    assert "frame by frame" in report.read_text()
    assert main(["view", *both, "--plain", "--html", str(scene)]) == 0
    assert LOOK["framewise"][1] in scene.read_text()
    assert main(["report", *both[:2], str(tmp_path / "other.csv"), "-o", str(tmp_path / "no.html")]) == 2
    assert not (tmp_path / "no.html").exists()
