"""`vbaa track`: from contacts.csv to track.csv, events in words and as data."""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.setup import Setup
from estimator.cli.track import COLUMNS, configure, run
from estimator.table.contacts import ContactTable
from estimator.table.files import read_contacts, write_contacts

from .track_tables import rubbed, rubbed_table

COUNT = 40


def written(path: Path, table: ContactTable) -> Path:
    write_contacts(path, list(table.rows()))
    return path


def stroked() -> ContactTable:
    aside = np.where(np.arange(COUNT) >= 20, 12e-3, 0.0)
    return rubbed_table(rubbed(np.zeros(COUNT), aside, np.zeros(COUNT)), np.random.default_rng(0))


def arguments(*words: str | Path) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("--force", action="store_true")
    configure(parser)
    return parser.parse_args([str(word) for word in words])


def test_events_and_frames_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    contacts = written(tmp_path / "contacts.csv", stroked())
    result = run(arguments(contacts, "-o", tmp_path / "track.csv"))
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    kinds = [event["kind"] for event in result["events"]]
    assert kinds == ["first_contact", "slip_start"]
    assert result["events"][0]["time_s"] is None
    assert sum(result["phases"].values()) == result["frames"] == COUNT
    said = capsys.readouterr().err
    assert "the contact begins to slip" in said
    assert "cannot be told" in said
    with (tmp_path / "track.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS
    assert {row["phase"] for row in rows} >= {"sliding", "sticking"}
    assert float(rows[30]["slip_m_s"]) == pytest.approx(12e-3, rel=0.1)
    assert rows[30]["ringing"] == "false"


def test_contacts_are_smoothed_on_request(tmp_path: Path) -> None:
    rig = Setup(real=True, exact=False).rig()
    (tmp_path / "rig.json").write_text(json.dumps(rig.to_dict()))
    table = stroked()
    contacts = written(tmp_path / "contacts.csv", table)
    smoothed = tmp_path / "smoothed.csv"
    run(arguments(contacts, "--rig", tmp_path / "rig.json", "-o", tmp_path / "track.csv", "--smooth", smoothed))
    back = read_contacts(smoothed)
    assert len(back) == COUNT
    assert np.abs(back.point_world_m - table.point_world_m).max() > 1e-5
    assert (np.trace(back.covariance_world_m2, axis1=1, axis2=2) > 0.0).all()
