"""`vbaa bench` as one suite: its registry, what it refuses before any work, what it leaves, and one failure is one."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import subjects
from benchmarks.harness import (
    Findings,
    Line,
    Options,
    as_json,
    as_text,
    cell,
    least_seconds,
    machine,
    median_seconds,
    or_none,
    rms,
    rms_known,
    write_csv,
)
from benchmarks.subjects import SUBJECTS, Measured, Subject, write
from vbaa_calib.cli import bench as bench_cli
from vbaa_calib.cli import main
from vbaa_calib.core.errors import SolveError

SUITE = [subject for subject in SUBJECTS.values() if subject.suite]
NAMED = {"metric", "calibration", "vision", "estimator", "object", "chain"}
"""What the suite is to hold at least; `chain` is the whole way."""

WORK = {
    "metric": ("run",),
    "calibration": ("run",),
    "vision": ("methods", "hardships", "hostile"),
    "estimator": (
        *("estimator_grid.run", "estimator_rods.run", "estimator_speed.run", "estimator_hard.run"),
        *("estimator_hostile.hostile", "summary", "grid_text", "rod_text", "speed_text", "hard_text", "hostile_text"),
    ),
    "object": ("run", "object_onset.alarms", "object_onset.onsets", "object_onset.as_text"),
    "guided": ("run",),
    "coverage": ("run",),
    "paper": (
        *("paper_sensing.run", "paper_friction.run", "paper_yielding.run"),
        *("sensing_text", "friction_text", "yielding_text"),
    ),
}
"""What takes time, of each subject; those that are missing here have tests of their own."""


@dataclass(frozen=True)
class Numbers:
    """A row as benchmarks make them."""

    name: str
    error: float
    ratio: float | None = None


def stub(subject: Subject, seen: list[Options]) -> Callable[[Options], Findings]:
    """A subject that does nothing and leaves what the real one leaves."""

    def measure(options: Options) -> Findings:
        seen.append(options)
        rows = [Numbers(subject.name, float("nan")), Numbers("other", 0.5, 2.0)]
        return Findings(
            f"table of {subject.name}",
            {name: rows for name in subject.files if name.endswith(".csv")},
            {name: lambda path, _: path.write_bytes(b"drawn") for name in subject.files if name.endswith(".png")},
            {"rows": rows},
            f"headline of {subject.name}",
        )

    return measure


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[Options]:
    """All subjects are stubs; what they were asked for is kept."""
    asked: list[Options] = []
    stubs = {subject.name: SimpleNamespace(measure=stub(subject, asked)) for subject in SUBJECTS.values()}
    monkeypatch.setattr(subjects, "import_module", lambda name: stubs[name.rpartition(".")[2]])
    return asked


def broken(monkeypatch: pytest.MonkeyPatch, name: str, measure: Callable[[Options], Findings]) -> None:
    """One subject does something else, the others are as they were."""
    before = subjects.import_module
    monkeypatch.setattr(
        subjects,
        "import_module",
        lambda module: SimpleNamespace(measure=measure) if module.endswith(f".{name}") else before(module),
    )


def raising(_: Options) -> Findings:
    """As a subject whose peer is gone."""
    raise RuntimeError("the peer is gone")


@pytest.mark.parametrize("subject", SUBJECTS.values(), ids=list(SUBJECTS))
def test_laws_of_the_registry(subject: Subject) -> None:
    """A table and a figure each, named after their subject; with --quick less, and enough to say something."""
    assert {name.rpartition(".")[2] for name in subject.files} == {"csv", "png"}
    assert all(name.startswith(subject.name) for name in (*subject.files, subject.record))
    assert subject.draws[0] >= subject.draws[1] >= subject.least >= 1
    assert len(subject.about) <= 100
    assert machine(subject.packages).versions.keys() == {"vbaa-calib", *subject.packages}


def test_no_two_subjects_leave_the_same_file() -> None:
    names = [name for subject in SUBJECTS.values() for name in (*subject.files, subject.record)]
    assert len(set(names)) == len(names)
    assert {subject.name for subject in SUITE} >= NAMED


@pytest.mark.parametrize("name", WORK)
def test_every_subject_leaves_the_files_that_it_is_known_for(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The real `measure`, without the work below it: every result a pair that is text as well."""
    module = import_module(f"vbaa_calib.bench.{name}")
    for where in ("as_text", "headline", *WORK[name]):
        if "." in where or hasattr(module, where):
            monkeypatch.setattr(f"{module.__name__}.{where}", lambda *_, **__: "ab")
    found = module.measure(SUBJECTS[name].options(seed=0, quick=True))
    assert {*found.tables, *found.figures} == set(SUBJECTS[name].files)
    assert found.headline == "ab"


@pytest.mark.parametrize("name", sorted(SUBJECTS.keys() - WORK.keys()))
def test_the_others_name_their_files_too(name: str) -> None:
    """Those whose work is not made light of here: the names in their text are those in the registry."""
    text = (Path(subjects.__file__).parent / f"{name}.py").read_text(encoding="utf-8")
    assert set(re.findall(rf'"({name}\w*\.(?:csv|png))"', text)) == set(SUBJECTS[name].files)


def test_the_suite_runs_everything_says_where_it_is_and_sums_up(seen, tmp_path: Path, capsys) -> None:
    assert main(["bench", "--quick", "--seed", "7", "--out", str(tmp_path)]) == 0
    assert [(options.seed, options.quick, options.draws) for options in seen] == [(7, True, s.draws[1]) for s in SUITE]
    expected = {name for subject in SUITE for name in (*subject.files, subject.record)}
    assert {path.name for path in tmp_path.iterdir()} == expected
    out, err = capsys.readouterr()
    for place, subject in enumerate(SUITE, start=1):
        assert f"{place} of {len(SUITE)}: {subject.name}\n" in err
        assert f"{place} of {len(SUITE)}: {subject.name}, done in 0 s\n" in err
        assert out.count(f"table of {subject.name}\n") == 1
        assert f"headline of {subject.name}\n" in out.rpartition("what it comes down to")[2]
        assert ", ".join((*subject.files, subject.record)) in out


def test_all_is_every_subject(seen) -> None:
    assert main(["bench", "all", "--jobs", "2"]) == 0
    assert [(s.name, options.jobs) for s, options in zip(SUBJECTS.values(), seen, strict=True)] == [
        (subject.name, 2 if subject.jobs else 1) for subject in SUBJECTS.values()
    ]


def test_one_failure_does_not_lose_the_others(seen, monkeypatch, tmp_path: Path, capsys) -> None:
    broken(monkeypatch, "vision", raising)
    assert main(["bench", "--quick", "--out", str(tmp_path)]) == 1
    assert len(seen) == len(SUITE) - 1
    expected = {name for s in SUITE if s.name != "vision" for name in (*s.files, s.record)}
    assert {path.name for path in tmp_path.iterdir()} == expected
    out, err = capsys.readouterr()
    assert "failed: RuntimeError: the peer is gone" in out
    assert f"{len(SUITE) - 1} of {len(SUITE)} subjects measured" in out
    assert "vision, failed after" in err


def test_json_alone_stands_on_stdout(seen, monkeypatch, capsys) -> None:
    broken(monkeypatch, "vision", raising)
    assert main(["bench", "--quick", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["failed"] == {"vision": "RuntimeError: the peer is gone"}
    assert list(told["subjects"]) == [subject.name for subject in SUITE if subject.name != "vision"]
    assert main(["bench", "metric", "--json", "--seed", "3"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["subject"], told["seed"], told["draws"]) == ("metric", 3, 1_000_000)
    assert told["rows"][0] == {"name": "metric", "error": None, "ratio": None}


def test_a_record_names_all_that_the_numbers_were_made_with(seen, tmp_path: Path, capsys) -> None:
    assert main(["bench", "coverage", "--draws", "5", "--jobs", "2", "--seed", "4", "--out", str(tmp_path)]) == 0
    record = json.loads((tmp_path / "coverage.json").read_text())
    assert record["command"] == "vbaa bench coverage --draws 5 --seed 4 --jobs 2"
    assert record["machine"]["versions"]["numpy"] == np.__version__
    assert record["machine"]["cores"] >= 1
    assert record["files"] == list(SUBJECTS["coverage"].files)
    assert not [key for key in record if "date" in key]
    first = capsys.readouterr().out.splitlines()[0]
    assert f"numpy {np.__version__}" in first
    assert "5 calibrations of each rig, seed 4" in first


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
    ],
)
def test_what_makes_no_sense_is_refused_before_any_work(wrong: list[str], seen, tmp_path: Path, capsys) -> None:
    (tmp_path / "file").write_text("")
    assert main(["bench", *(word.format(folder=tmp_path) for word in wrong)]) == 2
    out, err = capsys.readouterr()
    assert (out, seen) == ("", [])
    assert err.startswith("vbaa: ")
    assert "; " in err, "every refusal has a remedy"


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(seen, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("vbaa_calib.core.files.os.access", lambda *_: False)
    assert main(["bench", "metric", "--out", str(tmp_path)]) == 2
    assert seen == []
    assert "read-only" in capsys.readouterr().err


@pytest.mark.parametrize("name", [name for s in SUITE for name in (*s.files, s.record)])
def test_no_file_of_any_subject_is_replaced_unasked(name: str, seen, tmp_path: Path, capsys) -> None:
    """Before the work of the first subject, even where the file is the last one's."""
    (tmp_path / name).write_text("mine")
    assert main(["bench", "--out", str(tmp_path)]) == 2
    assert seen == []
    assert f"{name}: exists already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_force_replaces(seen, tmp_path: Path) -> None:
    for name in SUBJECTS["metric"].files:
        (tmp_path / name).write_text("old")
    assert main(["bench", "metric", "--out", str(tmp_path), "--force"]) == 0
    assert (tmp_path / "metric.png").read_bytes() == b"drawn"
    with (tmp_path / "metric.csv").open() as stream:
        assert list(csv.DictReader(stream))[1] == {"name": "other", "error": "0.5", "ratio": "2.0"}


def spoilt(how: str, subject: Subject) -> Findings:
    """What a subject found, with one thing wrong."""
    found = stub(subject, [])(subject.options(0, quick=True))
    tables, figures = dict(found.tables), dict(found.figures)
    if how == "a figure fails":
        figures["metric.png"] = lambda path, force: path.read_text("no such encoding")
    elif how == "an empty table":
        tables["metric.csv"] = []
    elif how == "another name":
        tables["more.csv"] = tables["metric.csv"]
    return Findings("the table", tables, figures, {}, "")


@pytest.mark.parametrize("how", ["a figure fails", "an empty table", "another name"])
def test_no_half_set_is_left_and_the_table_is_not_lost(how: str, seen, monkeypatch, tmp_path: Path, capsys) -> None:
    broken(monkeypatch, "metric", lambda _: spoilt(how, SUBJECTS["metric"]))
    (tmp_path / "metric.csv").write_text("old")
    assert main(["bench", "metric", "--out", str(tmp_path), "--force"]) == 1
    assert "the table" in capsys.readouterr().out
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("metric.csv", "old")]


def test_an_empty_table_is_named(tmp_path: Path) -> None:
    subject = SUBJECTS["metric"]
    found = spoilt("an empty table", subject)
    with pytest.raises(SolveError, match=r"metric found nothing for metric\.csv"):
        write(tmp_path, Measured(subject, subject.options(0, quick=True), machine(()), found, 0.0), force=False)


def test_a_real_subject_from_end_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """Undistortion on one lens, few points: the files open, the second run is the first but for its times."""
    from benchmarks.metric import metric as metric_run
    from benchmarks.metric.metric import lenses

    monkeypatch.setattr(metric_run, "lenses", lambda: {"radial, 5": lenses()["radial, 5"]})
    tables = []
    for folder in (tmp_path / "one", tmp_path / "two"):
        folder.mkdir()
        assert main(["bench", "metric", "--quick", "--draws", "200", "--out", str(folder)]) == 0
        with (folder / "metric.csv").open() as stream:
            tables.append([(row["method"], row["error_px"], row["marked"]) for row in csv.DictReader(stream)])
        assert (folder / "metric.png").stat().st_size > 10_000
    assert tables[0] == tables[1]
    assert "200 random pixels of each lens, seed 0, quick" in capsys.readouterr().out


def test_help_needs_none_of_the_libraries() -> None:
    """And so answers at once."""
    code = "import sys; from vbaa_calib.cli import main; main(['bench', '--help']); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("False")
    assert all(f"\n  {subject.name} " in done.stdout for subject in SUBJECTS.values())


def test_the_summary_adds_up() -> None:
    lines = [Line("metric", "exact", 2.0, ("metric.csv",)), Line("vision", "", 3.0, (), "no camera")]
    text = as_text(lines).splitlines()
    assert [line.split() for line in text[1:3]] == [["metric", "2", "exact"], ["metric.csv"]]
    assert text[3].split(maxsplit=2) == ["vision", "3", "failed: no camera"]
    assert text[-1].split(maxsplit=2) == ["all", "5", "1 of 2 subjects measured"]


def test_numbers_for_json_and_tables(tmp_path: Path) -> None:
    rows = [Numbers("first", float("inf"), float("nan")), Numbers("second", 1.5)]
    assert as_json({"rows": rows, "count": np.int64(3), "curve": np.array([1.0, np.nan])}) == {
        "rows": [{"name": "first", "error": None, "ratio": None}, {"name": "second", "error": 1.5, "ratio": None}],
        "count": 3,
        "curve": [1.0, None],
    }
    write_csv(tmp_path / "rows.csv", rows, force=False)
    assert (tmp_path / "rows.csv").read_text() == "name,error,ratio\nfirst,,\nsecond,1.5,\n"
    assert (cell(None, 4, 1), cell(0.5, 6, 1, 100.0)) == ("   –", "  50.0")


def test_means() -> None:
    assert rms(np.array([3.0, -4.0])) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(rms(np.array([3.0, np.nan])))
    assert rms_known(np.array([3.0, np.inf, np.nan, -4.0])) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(rms(np.array([])))
    assert (or_none(rms(np.array([]))), or_none(2.0)) == (None, 2.0)


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


def test_what_is_not_installed_is_named_as_absent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    named = machine(("numpy", "no-such-package"))
    assert named.versions["no-such-package"] == "absent"
    assert "OMP_NUM_THREADS=1" in str(named)
    assert bench_cli.ALL not in SUBJECTS
