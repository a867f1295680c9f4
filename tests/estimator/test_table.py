"""contacts.csv: what is written comes back, and what is wrong is refused in one line."""

from __future__ import annotations

import csv
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from estimator.table.contacts import Contact, ContactRow, ContactTable
from estimator.table.files import COLUMNS, EXTRA_COLUMNS, check_format, read_contacts, write_contacts
from tests.viz.touching import cylinder, touch
from vbaa_calib.core.errors import InputError
from vbaa_calib.session import Frame


@pytest.fixture
def rows() -> list[ContactRow]:
    found = touch(*cylinder(np.linspace(1.2, 1.9, 5), np.linspace(-0.02, 0.02, 5)), np.random.default_rng(1))
    extra = {"friction_angle_rad": -0.07, "friction_angle_std_rad": 0.02, "bias_std": 0.31, "condition": 4.5e3}
    extra |= {"pan_rad": 0.4, "tilt_rad": -0.1, "evidence": 55.0, "tangent_world": np.array([0.8, 0.0, 0.6])}
    found[2] = replace(found[2], **extra)
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
    assert header[len(COLUMNS) - 1] == "reason"
    assert header[len(COLUMNS) :] == [
        *("FX_N", "FY_N", "FZ_N"),
        *("friction_angle_rad", "friction_angle_std_rad", "bias_std", "condition"),
        *("pan_rad", "tilt_rad", "evidence", "friction_prior_rad", "TX", "TY", "TZ"),
    ]
    last = dict(zip(header, body[-1], strict=True))
    filled = {name for name, cell in last.items() if cell}
    assert filled == {"frame", "time_s", "status", "in_contact", "model", "reason"}
    assert "nan" not in (tmp_path / "contacts.csv").read_text().lower()


def test_an_existing_file_stays_without_force(rows: list[ContactRow], tmp_path: Path) -> None:
    (tmp_path / "contacts.csv").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_contacts(tmp_path / "contacts.csv", rows)
    assert (tmp_path / "contacts.csv").read_text() == "mine"


def test_what_ours_has_besides_is_optional(rows: list[ContactRow], tmp_path: Path) -> None:
    write_contacts(tmp_path / "contacts.csv", rows)
    with (tmp_path / "contacts.csv").open(newline="") as stream:
        table = [line[: len(COLUMNS)] for line in csv.reader(stream)]
    with (tmp_path / "contacts.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows(table)
    back = read_contacts(tmp_path / "contacts.csv")
    assert np.isnan(back.force_world_N).all()
    assert np.isnan([back.friction_angle_rad, back.friction_angle_std_rad, back.bias_std, back.condition]).all()


@pytest.mark.parametrize(
    ("line", "column", "cell", "complaint"),
    [
        (3, "distance_m", "nan", "distance_m is nan"),
        (3, "distance_m", "", "distance_m is empty"),
        (3, "distance_m", "far", "distance_m is 'far'"),
        (4, "force_y_std_N", "-1", "force_y_std_N is -1"),
        (4, "friction_angle_std_rad", "-1", "friction_angle_std_rad is -1"),
        (4, "friction_angle_rad", "steep", "friction_angle_rad is 'steep'"),
        (4, "condition", "inf", "condition is inf"),
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


def test_a_contact_becomes_a_row() -> None:
    contact = Contact(
        *("ok", "rod was asked for", "rod", True),
        distance_m=0.1,
        force_N=np.array([1.0, 2.0, 3.0]),
        friction_angle_rad=0.1,
        friction_angle_std_rad=0.02,
        tangent_world=np.array([0.0, 0.6, 0.8]),
        evidence=31.0,
        condition=70.0,
        bias={"elastica": 1.2, "rod": 0.3},
    )
    frame = Frame(image=None, pan_rad=0.3, tilt_rad=-0.2, moment_Nm=0.0, frame=7, time_s=0.5)
    row = ContactRow.of(frame, contact)
    assert (row.frame, row.time_s, row.status, row.model, row.distance_m) == (7, 0.5, "ok", "rod", 0.1)
    assert (row.force_y_N, row.force_z_N) == (2.0, 3.0)
    assert (row.friction_angle_rad, row.friction_angle_std_rad, row.bias_std, row.condition) == (0.1, 0.02, 0.3, 70.0)
    assert (row.pan_rad, row.tilt_rad, row.evidence, row.tangent_world[1]) == (0.3, -0.2, 31.0, 0.6)


def test_a_clock_since_1970_keeps_its_milliseconds(tmp_path: Path) -> None:
    sent = [ContactRow(frame=i, time_s=1763741766.123 + 0.001 * i, status="no_contact") for i in range(3)]
    write_contacts(tmp_path / "contacts.csv", sent)
    np.testing.assert_allclose(
        read_contacts(tmp_path / "contacts.csv").time_s, [row.time_s for row in sent], rtol=0, atol=1e-5
    )


def test_parquet_without_its_package_says_what_to_do(
    rows: list[ContactRow], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    path = tmp_path / "contacts.parquet"
    for action in (lambda: check_format(path), lambda: write_contacts(path, rows), lambda: read_contacts(path)):
        with pytest.raises(InputError, match=r"contacts\.parquet: Parquet needs the package pyarrow") as caught:
            action()
        assert "pip install vbaa-calib[parquet]" in caught.value.remedy
    assert not path.exists()


def test_parquet_loses_nothing(rows: list[ContactRow], tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    path = tmp_path / "contacts.parquet"
    write_contacts(path, rows)
    back, sent = read_contacts(path), ContactTable.from_rows(rows)
    for field in fields(ContactTable):
        if field.name != "reason":
            np.testing.assert_array_equal(getattr(back, field.name), getattr(sent, field.name), err_msg=field.name)
    assert back.reason[-1] == 'free, "shape"'
    with pytest.raises(InputError, match="exists already"):
        write_contacts(path, rows)


def test_a_parquet_file_that_is_none_is_refused(rows: list[ContactRow], tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    path = tmp_path / "contacts.parquet"
    with pytest.raises(InputError, match="no such file"):
        read_contacts(path)
    path.write_text("text")
    with pytest.raises(InputError, match="is not a valid Parquet file"):
        read_contacts(path)
    write_contacts(path, [replace(rows[0], status="fine")], force=True)
    with pytest.raises(InputError, match="line 1: status is 'fine'"):
        read_contacts(path)


@pytest.mark.parametrize("name", ["contacts.xlsx", "contacts", "contacts.CSV.gz"])
def test_other_formats_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"is neither \.csv nor \.parquet"):
        check_format(Path(name))


def test_a_tangent_that_is_no_direction_is_refused(rows: list[ContactRow], tmp_path: Path) -> None:
    write_contacts(tmp_path / "contacts.csv", rows)
    with pytest.raises(InputError, match="TX, TY, TZ is not of length 1"):
        read_contacts(edited(tmp_path / "contacts.csv", 4, "TX", "0.9"))
