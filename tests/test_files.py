"""Files from outside: what is wrong is named in one line, and nothing is left half-written."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.core.csv_rows import number, read_csv
from vbaa_calib.core.errors import InputError, one_line
from vbaa_calib.core.files import read_yaml, refuse_overwrite, replacing, write_json, write_text
from vbaa_calib.core.folders import replacing_folder


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "given.txt"


def refused(caught: pytest.ExceptionInfo[InputError], path: Path, words: str) -> None:
    """The error is one line that names the file, says what is wrong, and what to do."""
    assert one_line(str(path)) in str(caught.value)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.remedy


class TestTables:
    """Cells between commas, semicolons or tabs; comments; numbers that are none."""

    PLAIN = "view,x_m,y_m\na,1.5,2\nb,3,4\n"

    @pytest.mark.parametrize(
        "text",
        [
            PLAIN,
            PLAIN.replace(",", ";"),
            PLAIN.replace(",", "\t"),
            PLAIN.replace(",", ";").replace("1.5", "1,5"),
            "# made by hand\n\n# twice, at noon\n" + PLAIN.replace("b,", "# b was lost, once\nb,"),
            "sep=;\n" + PLAIN.replace(",", ";"),
            "\ufeff" + PLAIN,
        ],
    )
    def test_they_read_alike(self, path: Path, text: str) -> None:
        path.write_text(text, encoding="utf-8")
        rows = read_csv(path, ("view", "x_m", "y_m"))
        assert [(row["view"], number(row, "x_m", path), number(row, "y_m", path)) for row in rows] == [
            ("a", 1.5, 2.0),
            ("b", 3.0, 4.0),
        ]
        assert [text.splitlines()[int(row["line"]) - 1][0] for row in rows] == ["a", "b"]

    @pytest.mark.parametrize("row", ["c;1.234;5", "c;1.234,5;5", "c;1,2,3;5"])
    def test_a_decimal_comma_is_no_guess(self, path: Path, row: str) -> None:
        """Next to decimal points, or as one of several, it may stand between thousands."""
        path.write_text(f"view;x_m;y_m\na;1,5;2\n{row}\n")
        with pytest.raises(InputError, match="line 3"):
            [number(each, "x_m", path) for each in read_csv(path, ("view", "x_m", "y_m"))]


class TestYaml:
    def test_numbers_as_people_write_them(self, path: Path) -> None:
        path.write_text("a: 193.0e9\nb: 1e-3\nc: -2E+5\nd: .5e1\ne: 7900\nf: 1.5\ng: 4.e2\n")
        assert read_yaml(path) == {"a": 193e9, "b": 1e-3, "c": -2e5, "d": 5.0, "e": 7900, "f": 1.5, "g": 400.0}


class TestCsv:
    @pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
    def test_line_ends_quotes_and_byte_order_mark(self, path: Path, end: str) -> None:
        path.write_bytes(b"\xef\xbb\xbf" + end.join(["a,b", '"x, y","say ""no"""', "z,"]).encode())
        assert read_csv(path, ["a", "b"]) == [
            {"a": "x, y", "b": 'say "no"', "line": "2"},
            {"a": "z", "b": "", "line": "3"},
        ]

    # one cell of a table: anything but what a reader may strip or a file cannot hold
    cell = st.text(st.characters(codec="utf-8", exclude_characters="\r\0"), max_size=8).map(str.strip)

    @settings(deadline=None)
    @given(
        st.lists(st.tuples(cell.filter(lambda text: text[:1] != "#"), cell, cell.filter(bool)), min_size=1, max_size=6)
    )
    def test_round_trip(self, rows: list[tuple[str, str, str]]) -> None:
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerows([("a", "b", "c"), *rows])
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "table.csv"
            path.write_text(stream.getvalue(), encoding="utf-8", newline="")
            read = read_csv(path, ["a", "b", "c"])
        assert [(row["a"], row["b"], row["c"]) for row in read] == rows

    @settings(deadline=None)
    @given(st.floats(allow_nan=False, allow_infinity=False))
    def test_numbers_survive_the_table(self, value: float) -> None:
        assert number({"x": repr(value), "line": "2"}, "x", Path("t.csv")) == value


class TestWriting:
    @pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt, OSError])
    def test_a_failure_leaves_nothing(self, path: Path, failure: type[BaseException]) -> None:
        def write() -> None:
            with replacing(path) as temporary:
                temporary.write_text("half")
                raise failure

        with pytest.raises(failure):
            write()
        assert list(path.parent.iterdir()) == []
        path.write_text("mine")
        with pytest.raises(failure):
            write()
        assert path.read_text() == "mine"
        assert list(path.parent.iterdir()) == [path]

    def test_an_existing_file_needs_force(self, path: Path) -> None:
        path.write_text("mine")
        with pytest.raises(InputError) as caught:
            write_text(path, "theirs", force=False)
        refused(caught, path, "exists already; give --force")
        assert path.read_text() == "mine"
        write_text(path, "theirs", force=True)
        assert path.read_text() == "theirs"

    @pytest.mark.parametrize("force", [False, True])
    def test_what_cannot_be_written_is_refused_before_the_work(self, tmp_path: Path, force: bool) -> None:
        fifo, file = tmp_path / "fifo", tmp_path / "file"
        os.mkfifo(fifo)
        file.write_text("mine")
        cases = {
            tmp_path: "is a folder",
            Path(os.devnull): "is not a regular file",
            fifo: "is not a regular file",
            file / "none" / "a.json": "cannot be written",
            file / "a.json": "cannot be written",
            tmp_path / ("n" * 300): "cannot be written",
            Path("a\0b"): "cannot be written",
        }
        for path, words in cases.items():
            with pytest.raises(InputError) as caught:
                refuse_overwrite(path, force)
            refused(caught, path, words)
        assert sorted(tmp_path.iterdir()) == [fifo, file]

    def test_json_is_never_nan(self, path: Path) -> None:
        with pytest.raises(ValueError, match="not JSON compliant"):
            write_json(path, {"a": math.nan})
        assert list(path.parent.iterdir()) == []
        write_json(path, {"a": 0.1})
        assert json.loads(path.read_text()) == {"a": 0.1}


def test_an_input_is_never_an_output(tmp_path: Path) -> None:
    given, link, other = tmp_path / "contacts.csv", tmp_path / "link.csv", tmp_path / "new.csv"
    given.write_text("mine")
    link.symlink_to(given)
    for path in (given, link):
        with pytest.raises(InputError, match="is an input of this command"):
            refuse_overwrite(path, True, (None, given, tmp_path / "not there"))
    refuse_overwrite(other, False, (given,))
    refuse_overwrite(given, True, (other,))


def test_ctrl_c_between_the_two_names_of_a_folder_loses_neither(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """The signal comes just after the old folder has lost its name; the new one takes that first."""
    target = tmp_path / "session"
    target.mkdir()
    (target / "kept").write_text("old")
    renamed = Path.rename

    def interrupted(self: Path, to: Path) -> Path:
        found = renamed(self, to)
        if self == target:
            os.kill(os.getpid(), signal.SIGINT)
        return found

    monkeypatch.setattr(Path, "rename", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    with pytest.raises(KeyboardInterrupt), replacing_folder(target) as temporary:
        (temporary / "kept").write_text("new")
    assert (target / "kept").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["session"]


def test_a_folder_has_one_writer_at_a_time(tmp_path: Path) -> None:
    target = tmp_path / "session"
    child = "import sys, time; from pathlib import Path; from vbaa_calib.core.folders import writing_alone\n"
    child += "with writing_alone(Path(sys.argv[1])): print('here', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", child, str(target)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "here\n"
        with pytest.raises(InputError, match="is being written by another command"), replacing_folder(target):
            pass
        other.kill()
    # the lock went with its process
    with replacing_folder(target) as temporary:
        (temporary / "kept").write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["session"]


def test_a_writer_that_was_killed_between_the_two_names_has_lost_nothing(tmp_path: Path) -> None:
    target, left = tmp_path / "session", tmp_path / ".session-old-abcdefgh"
    (left / "replaced").mkdir(parents=True)
    (left / "replaced" / "kept").write_text("old")
    (tmp_path / ".session-new-abcdefgh").mkdir()
    with pytest.raises(RuntimeError), replacing_folder(target):
        raise RuntimeError
    assert (target / "kept").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["session"]
