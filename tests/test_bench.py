"""`vbaa bench` as one suite: its registry, what it refuses before any work, what it leaves; one failure is one."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
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
    as_json,
    column,
    concatenated,
    least_seconds,
    machine,
    median_seconds,
    or_none,
    picked,
    replace_marked,
    rms,
    rms_known,
    table,
    write_csv,
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


def _no_figure() -> Figure:
    raise OSError("no room")


@pytest.mark.parametrize("how", ["a figure fails", "an empty table", "another name"])
def test_no_half_set_is_left_and_the_table_is_not_lost(how: str, stubs, tmp_path: Path, capsys) -> None:
    found = stub(SUBJECTS["metric"], [])(Options(0, 1, True))
    tables, figures = dict(found.tables), dict(found.figures)
    if how == "a figure fails":
        figures["metric.png"] = _no_figure
    else:
        tables["metric.csv" if how == "an empty table" else "more.csv"] = []
    stubs[0]["metric"].measure = lambda _: Findings("the table", tables, figures)
    (tmp_path / "metric.csv").write_text("old")
    assert main(["bench", "metric", "--out", str(tmp_path), "--force"]) == 1
    assert "the table" in capsys.readouterr().out
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("metric.csv", "old")]


def test_help_needs_none_of_the_libraries() -> None:
    """And so answers at once."""
    code = "import sys; from vbaa_calib.cli import main; main(['bench', '--help']); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("False")
    assert all(subject.name in done.stdout for subject in SUBJECTS.values())


def test_one_declaration_gives_table_csv_and_json(tmp_path: Path) -> None:
    rows = [Numbers("first", float("inf"), float("nan")), Numbers("first", 0.5, 2.0), Numbers("third", float("nan"))]
    assert table(rows[1:], "two", once=1) == "two\nname   error %\nfirst     50.0\nthird        –"
    assert table(rows[:2], once=1).splitlines()[2] == "          50.0"
    assert as_json({"rows": rows[:1], "count": np.int64(3), "curve": np.array([1.0, np.nan])}) == {
        "rows": [{"name": "first", "error": None, "ratio": None}],
        "count": 3,
        "curve": [1.0, None],
    }
    write_csv(tmp_path / "rows.csv", rows, force=False)
    assert (tmp_path / "rows.csv").read_text() == "name,error,ratio\nfirst,,\nfirst,0.5,2.0\nthird,,\n"


def test_a_page_keeps_what_is_beside_the_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- begin: benchmarks/x.py -->\nold\n<!-- end: benchmarks/x.py -->\nafter\n")
    replace_marked(page, "benchmarks/x.py", "new")
    assert page.read_text().split("\n")[::4] == ["before", "after"]
    assert "new" in page.read_text()
    assert "old" not in page.read_text()


def test_rows_of_arrays_and_their_means() -> None:
    assert rms_known(np.array([3.0, np.inf, np.nan, -4.0])) == rms(np.array([3.0, -4.0])) == pytest.approx(12.5**0.5)
    assert np.isnan(rms(np.array([3.0, np.nan])))
    assert (or_none(rms(np.array([]))), or_none(2.0)) == (None, 2.0)
    one = SimpleNamespace(a=np.arange(3), b=np.eye(3))

    @dataclass
    class Arrays:
        a: np.ndarray
        b: np.ndarray

    rows = concatenated([Arrays(one.a, one.b), picked(Arrays(one.a, one.b), np.array([2, 0]))])
    assert rows.a.tolist() == [0, 1, 2, 2, 0]
    assert rows.b.shape == (5, 3)


def ticks(monkeypatch: pytest.MonkeyPatch, durations: Iterator[float]) -> Callable[[], None]:
    """A function that takes as long as told, on a clock of its own."""
    now = [0.0]
    monkeypatch.setattr("benchmarks.harness.time.perf_counter", lambda: now[0])

    def work() -> None:
        now[0] += next(durations)

    return work


def test_timings_after_a_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slow first call counts for neither; the median and the least of the others."""
    assert least_seconds(ticks(monkeypatch, iter([9.0, 0.3, 0.1, 0.2])), 3) == pytest.approx(0.1)
    assert median_seconds(ticks(monkeypatch, iter([0.9, 0.3, 0.1, 0.2])), 3) == pytest.approx(0.2)
    assert median_seconds(ticks(monkeypatch, iter([9.0, 0.3])), 3) == pytest.approx(0.3), "once where it is slow"
