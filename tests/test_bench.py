"""`vbaa bench` as one suite: its registry, what it refuses before any work, what it leaves; one failure is one."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from benchmarks import suite
from benchmarks.harness import (
    Findings,
    Options,
    column,
    machine,
)
from benchmarks.metric import metric
from benchmarks.suite import SUBJECTS, Subject
from vbaa_calib.cli import main

SUITE = [subject for subject in SUBJECTS.values() if subject.suite]


@dataclass(frozen=True)
class Numbers:
    """A row as benchmarks make them."""

    name: str = column("name")
    error: float = column("error %", ".1f", 100)
    ratio: float | None = column(default=None)


def stub(subject: Subject, seen: list[Options]) -> Callable[[Options], Findings]:
    """A subject that does nothing and leaves what the real one leaves."""

    def measure(options: Options) -> Findings:
        seen.append(options)
        rows = [Numbers(subject.name, float("nan")), Numbers("other", 0.5, 2.0)]
        return Findings(
            f"table of {subject.name}",
            {name: rows for name in subject.files if name.endswith(".csv")},
            {name: Figure for name in subject.files if name.endswith(".png")},
            {"rows": rows},
            f"headline of {subject.name}",
        )

    return measure


@pytest.fixture
def stubs(monkeypatch: pytest.MonkeyPatch) -> tuple[dict[str, SimpleNamespace], list[Options]]:
    """All subjects as stubs, by name, and what they were asked for."""
    asked: list[Options] = []
    made = {subject.name: SimpleNamespace(measure=stub(subject, asked)) for subject in SUBJECTS.values()}
    monkeypatch.setattr(suite, "import_module", lambda name: made[name.rpartition(".")[2]])
    return made, asked


def raising(_: Options) -> Findings:
    """As a subject whose peer is gone."""
    raise RuntimeError("the peer is gone")


def test_laws_of_the_registry() -> None:
    """A table and a figure each, named after their subject and no other; with --quick less, and enough."""
    names = [name for subject in SUBJECTS.values() for name in (*subject.files, subject.record)]
    assert len(set(names)) == len(names)
    for subject in SUBJECTS.values():
        assert {name.rpartition(".")[2] for name in subject.files} == {"csv", "png"}
        assert all(name.startswith(subject.name) for name in (*subject.files, subject.record))
        assert subject.draws[0] >= subject.draws[1] >= subject.least >= 1
        assert machine(subject.packages.split()).versions.keys() == {"vbaa-calib", *subject.packages.split()}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SUBJECTS.keys() - {"metric"}))
def test_every_subject_leaves_its_files_in_the_smallest_run(name: str, tmp_path: Path) -> None:
    least = str(SUBJECTS[name].least)
    assert main(["bench", name, "--quick", "--draws", least, "--out", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {*SUBJECTS[name].files, SUBJECTS[name].record}


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


def test_the_suite_runs_everything_and_one_failure_does_not_lose_the_others(stubs, tmp_path: Path, capsys) -> None:
    made, asked = stubs
    made["vision"].measure = raising
    assert main(["bench", "--quick", "--seed", "7", "--out", str(tmp_path)]) == 1
    good = [subject for subject in SUITE if subject.name != "vision"]
    assert [(options.seed, options.quick, options.draws) for options in asked] == [(7, True, s.draws[1]) for s in good]
    assert {path.name for path in tmp_path.iterdir()} == {name for s in good for name in (*s.files, s.record)}
    out, err = capsys.readouterr()
    assert "vision, failed after" in err
    assert "failed: RuntimeError: the peer is gone" in out
    assert f"{len(good)} of {len(SUITE)} subjects measured" in out
    assert main(["bench", "all", "--jobs", "2", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["failed"] == {"vision": "RuntimeError: the peer is gone"}
    assert told["subjects"]["metric"]["rows"][0] == {"name": "metric", "error": None, "ratio": None}
    assert [options.jobs for options in asked[len(good) :]] == [
        2 if subject.jobs else 1 for subject in SUBJECTS.values() if subject.name != "vision"
    ]


@pytest.mark.parametrize(
    "wrong",
    [
        ["nothing"],
        ["metric", "--draws", "199"],
        ["coverage", "--draws", "1"],
        ["--draws", "5"],
        ["all", "--draws", "5"],
        ["metric", "--draws", "many"],
        ["metric", "--jobs", "2"],
        ["--jobs", "2"],
        ["coverage", "--jobs", "0"],
        ["vision", "--seed", "-1"],
        ["--out", "{folder}/none"],
        ["metric", "--out", "{folder}/file"],
        ["--out", "{folder}"],
    ],
)
def test_what_makes_no_sense_is_refused_before_any_work(wrong: list[str], stubs, tmp_path: Path, capsys) -> None:
    """An older file of the last subject is reason enough."""
    (tmp_path / "file").write_text("")
    (tmp_path / SUITE[-1].record).write_text("mine")
    assert main(["bench", *(word.format(folder=tmp_path) for word in wrong)]) == 2
    assert (capsys.readouterr().out, stubs[1]) == ("", [])
    assert (tmp_path / SUITE[-1].record).read_text() == "mine"
