"""contacts.csv: what is written comes back, and what is wrong is refused in one line."""

from __future__ import annotations

import csv
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from estimator.table import COLUMNS, EXTRA_COLUMNS, ContactRow, ContactTable, read_contacts, write_contacts
from tests.viz.touching import cylinder, touch
from vbaa_calib.errors import InputError


@pytest.fixture
def rows() -> list[ContactRow]:
    found = touch(*cylinder(np.linspace(1.2, 1.9, 5), np.linspace(-0.02, 0.02, 5)), np.random.default_rng(1))
    nothing = ContactRow(frame=5, time_s=0.5, status="no_contact", model="rod", reason='free,\n "shape"')
    return [*found, nothing]


def edited(path: Path, line: int, column: str, cell: str) -> Path:
    """The same file with one cell changed; line as in the error messages."""
    with path.open(newline="") as stream:
        table = list(csv.reader(stream))
    table[line - 1][table[0].index(column)] = cell
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows(table)
    return path


def test_what_is_written_comes_back(rows: list[ContactRow], tmp_path: Path) -> None:
    write_contacts(tmp_path / "contacts.csv", rows)
    back, sent = read_contacts(tmp_path / "contacts.csv"), ContactTable.from_rows(rows)
    assert len(back) == 6
    for field in fields(ContactTable):
        got, expected = getattr(back, field.name), getattr(sent, field.name)
        if expected.dtype.kind == "f":
            np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-20, err_msg=field.name)
        elif field.name != "reason":
            np.testing.assert_array_equal(got, expected)
    assert back.reason[-1] == 'free, "shape"'
    assert back.located.tolist() == [True] * 5 + [False]


def test_columns_of_the_contract_come_first_and_unknown_numbers_are_empty(
    rows: list[ContactRow], tmp_path: Path
) -> None:
    write_contacts(tmp_path / "contacts.csv", rows)
    with (tmp_path / "contacts.csv").open(newline="") as stream:
        header, *body = csv.reader(stream)
    assert tuple(header) == (*COLUMNS, *EXTRA_COLUMNS)
    assert header[:6] == ["frame", "time_s", "status", "in_contact", "model", "distance_m"]
    assert header[-4] == "reason"
    last = dict(zip(header, body[-1], strict=True))
    filled = {name for name, cell in last.items() if cell}
    assert filled == {"frame", "time_s", "status", "in_contact", "model", "reason"}
    assert "nan" not in (tmp_path / "contacts.csv").read_text().lower()


def test_an_existing_file_stays_without_force(rows: list[ContactRow], tmp_path: Path) -> None:
    (tmp_path / "contacts.csv").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_contacts(tmp_path / "contacts.csv", rows)
    assert (tmp_path / "contacts.csv").read_text() == "mine"


def test_force_in_the_world_is_optional(rows: list[ContactRow], tmp_path: Path) -> None:
    write_contacts(tmp_path / "contacts.csv", rows)
    with (tmp_path / "contacts.csv").open(newline="") as stream:
        table = [line[: len(COLUMNS)] for line in csv.reader(stream)]
    with (tmp_path / "contacts.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows(table)
    assert np.isnan(read_contacts(tmp_path / "contacts.csv").force_world_N).all()


@pytest.mark.parametrize(
    ("line", "column", "cell", "complaint"),
    [
        (3, "distance_m", "nan", "distance_m is nan"),
        (3, "distance_m", "", "distance_m is empty"),
        (3, "distance_m", "far", "distance_m is 'far'"),
        (4, "force_y_std_N", "-1", "force_y_std_N is -1"),
        (4, "status", "fine", "status is 'fine'"),
        (4, "in_contact", "perhaps", "in_contact is 'perhaps'"),
        (4, "in_contact", "false", "without being in contact"),
        (5, "frame", "1", "frame 1 stands already in line 3"),
        (5, "frame", "2.5", "frame is 2.5"),
        (5, "time_s", "-7", "time_s runs backwards"),
        (5, "time_s", "inf", "time_s is inf"),
        (6, "Y_m", "", "only some of X_m, Y_m, Z_m"),
        (6, "cov_YY", "-1", "covariance"),
        (6, "cov_XY", "1", "covariance"),
    ],
)
def test_bad_cells_are_refused_by_line(
    rows: list[ContactRow], tmp_path: Path, line: int, column: str, cell: str, complaint: str
) -> None:
    path = tmp_path / "contacts.csv"
    write_contacts(path, rows)
    with pytest.raises(InputError, match=complaint) as caught:
        read_contacts(edited(path, line, column, cell))
    assert f"{path} line {line}" in str(caught.value)


def test_a_missing_column_is_named(rows: list[ContactRow], tmp_path: Path) -> None:
    write_contacts(tmp_path / "contacts.csv", rows)
    with pytest.raises(InputError, match="moment_residual_Nm is missing"):
        read_contacts(edited(tmp_path / "contacts.csv", 1, "moment_residual_Nm", "moment"))
