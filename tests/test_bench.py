"""`vbaa bench` as one suite: what each subject leaves, and that it is the same again."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.suite import SUBJECTS
from vbaa_calib.cli.main import main


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SUBJECTS.keys() - {"metric"}))
def test_every_subject_leaves_its_files_in_the_smallest_run(name: str, tmp_path: Path) -> None:
    least = str(SUBJECTS[name].least)
    assert main(["bench", name, "--quick", "--draws", least, "--out", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {*SUBJECTS[name].files, SUBJECTS[name].record}
