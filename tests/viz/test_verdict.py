"""A recording with a mistake is named, its rows must not be used, and the exit code says so; others are left alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyarrow.parquet import read_metadata, read_table

from benchmarks.mistakes.recordings import clean_recording
from benchmarks.mistakes.rigs import KINDS
from benchmarks.waiting.recordings import write_session
from estimator import RecordingVerdict
from estimator.table.contacts import LOCATED
from estimator.table.files import read_contacts
from vbaa_calib.cli.main import main
from viz.batch.recordings import BatchRecording
from viz.batch.results import Results
from viz.batch.work import BatchSettings, do

from ..csv_files import read_rows
from ..made_once import made_once
from ..recordings import DRIFT

FRAMES = 40


def _made(folder: Path) -> None:
    recording = clean_recording(KINDS[0], 1, FRAMES)
    (folder / "rig.json").write_text(json.dumps(recording.rig.to_dict()))
    write_session(folder / "clean", recording.frames, DRIFT)
    turned = (replace(one, moment_Nm=-one.moment_Nm) for one in recording.frames)
    write_session(folder / "turned", turned, DRIFT)


@pytest.fixture(scope="module")
def folder() -> Path:
    """Sessions clean, and turned: the same with the moments' sign turned; and rig.json."""
    return made_once("recordings_with_a_mistake", _made)


def estimated(
    folder: Path, name: str, output: Path, capsys: pytest.CaptureFixture[str], *more: str
) -> tuple[int, dict[str, Any], str]:
    """Exit code, numbers and words of `vbaa estimate`."""
    words = ["estimate", folder / name, "--rig", folder / "rig.json", "-o", output, "--jobs", "1", "--json", *more]
    code = main(list(map(str, words)))
    captured = capsys.readouterr()
    return code, json.loads(captured.out), captured.err


def test_a_clean_recording_has_no_verdict(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found, _ = estimated(folder, "clean", tmp_path / "contacts.csv", capsys, "--no-report")
    assert (code, found["verdict"]) == (0, {"severity": "none", "findings": []})
    assert read_contacts(tmp_path / "contacts.csv").located.sum() == found["status"]["ok"] > 10


def test_rows_of_a_wrong_recording_are_contradicted(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In every file alike, their numbers as the frames alone have them; named first; and no row is located."""
    code, found, said = estimated(folder, "turned", tmp_path / "contacts.csv", capsys)
    assert code == 1
    assert [one["name"] for one in found["verdict"]["findings"]] == ["moment_sign"]
    assert said.splitlines()[0].startswith("wrong: the moment readings have the wrong sign; change the sign")
    table = read_contacts(tmp_path / "contacts.csv")
    assert not table.located.any()
    assert "no_contact" not in table.status
    contradicted = table.status == "contradicted"
    assert contradicted.sum() == found["status"]["contradicted"] > 0
    assert all("wrong sign" in reason and "(remedy: " in reason for reason in table.reason[contradicted])
    page = Path(found["report"]).read_text(encoding="utf-8")
    assert "must not be used: the moment readings have the wrong sign" in page
    # as a batch, in one file by row groups, the digest with it
    results = Results(tmp_path / "results")
    results.prepare([])
    outcome = do(
        BatchRecording("one", folder / "turned", folder / "rig.json"), BatchSettings(reconstruct=True), results
    )
    assert outcome.row["verdict"] == found["verdict"]
    assert outcome.row["contradicted"] == found["status"]["contradicted"]
    assert not results.object("one").exists()
    assert results.done("one") == outcome.row
    (summary,) = results.write_summary([])
    assert summary["ok"] == 0
    (row,) = read_rows(results.summary)
    assert "wrong: the moment readings" in row["verdict"]
    again = do(BatchRecording("one", folder / "turned", folder / "rig.json"), BatchSettings(), results)
    assert again.state == "unchanged"
    # the numbers are those without a verdict
    judged, batched = read_table(results.contacts("one")), read_contacts(results.contacts("one"))
    monkeypatch.setattr("estimator.diagnose.RecordingWatch.verdict", lambda self: RecordingVerdict())
    plain = tmp_path / "plain.parquet"
    assert estimated(folder, "turned", plain, capsys, "--no-report")[0] == 0
    unjudged = read_table(plain)
    before, after = (np.array(one["status"]) for one in (unjudged, judged))
    changed = before != after
    assert set(after[changed]) == {"contradicted"}
    assert set(before[changed]) <= {*LOCATED, "no_contact", "low_signal"}
    numbers = [name for name in judged.column_names if name not in ("status", "reason")]
    for name, column in vars(batched).items():  # a CSV has nine digits
        if np.asarray(column).dtype.kind == "f":
            np.testing.assert_allclose(getattr(table, name), column, rtol=1e-8, atol=1e-9, err_msg=name)
        else:
            np.testing.assert_array_equal(getattr(table, name), column, name)
    for name in numbers:
        np.testing.assert_array_equal(judged[name], unjudged[name])
    assert read_metadata(results.contacts("one")).num_rows == FRAMES
    assert judged.schema.equals(unjudged.schema)
