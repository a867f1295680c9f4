"""The verdict on a running recording: the one on the same recording afterwards, and no frame waits for it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from estimator import RecordingVerdict
from estimator.diagnose.consequences import changed_row
from estimator.table.files import read_contacts
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import Diagnosis, Verdict

from ..small_scene import small_rig
from .recordings import COUNT, write

WRONG = RecordingVerdict(Verdict.of([Diagnosis("moment_sign", "wrong sign", "turn it", "wrong")]), 0)


def test_a_running_recording_has_the_verdict_that_it_has_afterwards(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The moment's sign is turned: from the verdict on, rows are contradicted in every output; in the end all are."""
    bag = write(tmp_path / "turned.mcap", torque=lambda frame: {"y": -frame.moment_Nm})
    found, lines = {}, list[dict]()
    for verb, words, more in (
        ("estimate", (bag, "--rig", small_rig() / "rig.json"), ("--no-report", "--json")),
        ("live", (small_rig() / "rig.json", bag), ("--lines",)),
    ):
        output = ("-o", tmp_path / f"{verb}.csv", "--gap", "0.5")
        assert main(list(map(str, (verb, *words, *output, *more)))) == 1
        captured = capsys.readouterr()
        found[verb] = captured.err
        lines = [json.loads(line) for line in captured.out.splitlines()]
    rows = [(tmp_path / f"{verb}.csv").read_bytes() for verb in found]
    assert rows[0] == rows[1]
    contradicted = read_contacts(tmp_path / "live.csv").status == "contradicted"
    assert contradicted.any()
    assert not read_contacts(tmp_path / "live.csv").located.any()
    # of a recording on the disk the verdict is there with the 64th frame
    known = [line for line in lines if line["final"] or line["frame"] >= 63]
    assert [line["status"] == "contradicted" for line in known if not line["final"]] == contradicted[63:].tolist()
    assert [line["status"] == "contradicted" for line in known if line["final"]][-COUNT + 63 :] == (
        contradicted[63:].tolist()
    )
    assert found["live"].count("warning, frame ") == 1
    verdicts = [next(line for line in said.splitlines() if line.startswith("wrong: ")) for said in found.values()]
    assert verdicts[0] == verdicts[1]


@pytest.mark.parametrize("status", ["ok", "tip_contact", "no_contact", "low_signal"])
def test_only_rows_that_it_concerns_are_contradicted(status: str) -> None:
    verdict = replace(WRONG, first=10, rows=frozenset({3}))
    changed: Callable[[int], str] = lambda row: changed_row(verdict, row, status, "")[0]  # noqa: E731
    assert [row for row in range(13) if changed(row) != status] == [3, 10, 11, 12]
    for withheld in ("failed", "no_antenna", "unobservable", "not_quasistatic"):
        assert changed_row(verdict, 10, withheld, "why") == (withheld, "why")
