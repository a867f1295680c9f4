"""`vbaa bench` as one suite: what each subject leaves, and that it is the same again."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.metric import metric
from benchmarks.suite import SUBJECTS
from vbaa_calib.cli import main


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SUBJECTS.keys() - {"metric"}))
def test_every_subject_leaves_its_files_in_the_smallest_run(name: str, tmp_path: Path) -> None:
    least = str(SUBJECTS[name].least)
    assert main(["bench", name, "--quick", "--draws", least, "--out", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {*SUBJECTS[name].files, SUBJECTS[name].record}


@pytest.mark.slow
def test_a_real_subject_is_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """But for its times, on one lens; the record tells what it was made with."""
    one_lens = {"radial, 5": metric.lenses()["radial, 5"]}
    monkeypatch.setattr(metric, "lenses", lambda: one_lens)
    tables = []
    for folder in (tmp_path / "one", tmp_path / "two"):
        folder.mkdir()
        assert main(["bench", "metric", "--quick", "--draws", "200", "--out", str(folder)]) == 0
        with (folder / "metric.csv").open() as stream:
            tables.append([(row["method"], row["error_px"], row["marked"]) for row in csv.DictReader(stream)])
        assert (folder / "metric.png").stat().st_size > 10_000
    assert tables[0] == tables[1]
    record = json.loads((tmp_path / "two" / "metric.json").read_text())
    assert record["command"] == "vbaa bench metric --draws 200 --seed 0 --quick"
    assert record["machine"]["versions"]["numpy"] == np.__version__
    assert record["files"] == list(SUBJECTS["metric"].files)
    assert "200 random pixels of each lens, seed 0, quick" in capsys.readouterr().out
