"""contacts.csv and contacts.parquet: what is written comes back, and what is wrong is refused in one line."""

from __future__ import annotations

import csv
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from pyarrow.parquet import read_metadata, read_table

from estimator.table.contacts import COLUMNS, REQUIRED, Contact, ContactRow, ContactTable, column_names, columns_of
from estimator.table.files import read_contacts, rewrite_contacts, write_contacts
from vbaa_calib.core.errors import InputError
from vbaa_calib.session import Frame

from ..viz.touching import cylinder, touch

CONTRACT = [
    *("frame", "time_s", "status", "in_contact", "model", "distance_m", "distance_std_m"),
    *("force_y_N", "force_y_std_N", "force_z_N", "force_z_std_N", "deflection_y_m", "deflection_z_m"),
    *("x_m", "y_m", "z_m", "X_m", "Y_m", "Z_m", "cov_XX", "cov_XY", "cov_XZ", "cov_YY", "cov_YZ", "cov_ZZ"),
    *("moment_residual_Nm", "reason"),
]
"""The columns that others rely on."""
FORMATS = Path(__file__).parents[2] / "docs" / "formats.md"


@pytest.fixture
def rows() -> list[ContactRow]:
    found = touch(*cylinder(np.linspace(1.2, 1.9, 5), np.linspace(-0.02, 0.02, 5)), np.random.default_rng(1))
    extra = {"friction_angle_rad": -0.07, "friction_angle_std_rad": 0.02, "bias_std": 0.31, "condition": 4.5e3}
    extra |= {"pan_rad": 0.4, "tilt_rad": -0.1, "evidence": 55.0, "tangent_world": np.array([0.8, 0.0, 0.6])}
    found[2] = replace(found[2], **extra)
    nothing = ContactRow(frame=5, time_s=0.5, status="no_contact", model="rod", reason='free,\n "shape"')
    return [*found, nothing]


@pytest.fixture
def written(rows: list[ContactRow], tmp_path: Path) -> Path:
    write_contacts(tmp_path / "contacts.csv", rows)
    return tmp_path / "contacts.csv"


def cells(path: Path) -> list[list[str]]:
    with path.open(newline="") as stream:
        return list(csv.reader(stream))


def rewritten(path: Path, table: list[list[str]]) -> Path:
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows(table)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_is_written_comes_back(suffix: str, rows: list[ContactRow], tmp_path: Path) -> None:
    """Nine digits in a CSV, all of them in a Parquet file; of a symmetric matrix the upper triangle."""
    path = tmp_path / f"contacts{suffix}"
    write_contacts(path, rows)
    back, sent = read_contacts(path), ContactTable.from_rows(rows)
    for field in fields(ContactTable):
        got, expected = getattr(back, field.name), getattr(sent, field.name)
        if expected.dtype.kind == "f":
            rtol, atol = (1e-8, 1e-20) if suffix == ".csv" else (0.0, 0.0)
            expected = np.triu(expected) if expected.ndim == 3 else expected
            got = np.triu(got) if got.ndim == 3 else got
            np.testing.assert_allclose(got, expected, rtol=rtol, atol=atol, err_msg=field.name)
        elif field.name != "reason":
            np.testing.assert_array_equal(got, expected)
    assert back.reason[-1] == 'free, "shape"'
    assert back.located.tolist() == [True] * 5 + [False]
    with pytest.raises(InputError, match="exists already"):
        write_contacts(path, rows)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_columns_are_written_as_their_rows_are(suffix: str, rows: list[ContactRow], tmp_path: Path) -> None:
    """Numbers of any size and digits, with some missing, and words with commas, quotes and ends of lines."""
    rng, more = np.random.default_rng(2), list[ContactRow]()
    for row in rows * 20:
        sizes = rng.normal(size=3) * 10.0 ** rng.integers(-30, 30, 3)
        clock_s, number = 1.7e9 + float(rng.random()), int(rng.integers(2**53))
        more.append(replace(row, frame=number, time_s=clock_s, force_world_N=sizes, reason=f'{row.reason}\r\n,"ä"'))
    more[1:3] = [replace(more[1], evidence=np.inf), replace(more[2], evidence=-0.0)]
    one, several = (tmp_path / f"{name}{suffix}" for name in ("one", "several"))
    write_contacts(one, more)
    write_contacts(several, [ContactTable.from_rows(part) for part in (more[:7], more[7:8], more[8:])])
    if suffix == ".csv":
        assert several.read_bytes() == one.read_bytes()
    else:
        assert read_table(several).schema == read_table(one).schema
        assert repr(read_table(several).to_pylist()) == repr(read_table(one).to_pylist())  # NaN is itself here


def test_columns_of_the_contract_come_first_and_unknown_numbers_are_empty(written: Path) -> None:
    header, *body = cells(written)
    assert header[: len(CONTRACT)] == CONTRACT == list(column_names(REQUIRED))
    assert tuple(header) == columns_of(named=False)
    last = dict(zip(header, body[-1], strict=True))
    filled = {name for name, cell in last.items() if cell}
    assert filled == {"frame", "time_s", "status", "in_contact", "model", "reason", "contact"}
    assert "nan" not in written.read_text().lower()


def test_a_contact_becomes_a_row() -> None:
    """Every number of the estimator's result has its place."""
    values = {
        field.name: np.full(column.shape, 0.125) if (column := field.metadata.get("column")) else {"rod": 0.3}
        for field in fields(Contact)
    }
    contact = Contact(**values | {"model": "rod", "status": "ok", "in_contact": True, "reason": "why"})
    frame = Frame(image=None, pan_rad=0.125, tilt_rad=0.125, moment_Nm=0.0, frame=7, time_s=0.125)
    row = ContactRow.of(frame, replace(contact, force_N=np.array([1.0, 2.0, 3.0])))
    assert (row.frame, row.status, row.model, row.reason, row.bias_std) == (7, "ok", "rod", "why", 0.3)
    assert (row.force_y_N, row.force_z_N) == (2.0, 3.0)
    others = {"frame", "status", "in_contact", "model", "reason", "bias_std", "force_y_N", "force_z_N", "contact"}
    others |= {"antenna", "clamp_world_m", "clamp_angle_rad"}
    assert all(np.all(getattr(row, field.name) == 0.125) for field in fields(row) if field.name not in others)


def test_the_documented_columns_are_the_declared_ones() -> None:
    rows = [f"| {', '.join(column_names([name]))} | {one.unit} | {one.meaning} |" for name, one in COLUMNS.items()]
    table = "\n".join(["| column | unit | what |", "|---|---|---|", *rows])
    assert table in FORMATS.read_text(encoding="utf-8")


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_rewriting_changes_statuses_alone(
    suffix: str, rows: list[ContactRow], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if the rows had been written so, to the byte of a CSV, over several row groups; a broken one leaves all."""
    monkeypatch.setattr("estimator.table.files._ROW_GROUP", 3)
    several = [replace(rows[number % len(rows)], frame=number) for number in range(11)]

    def changed(number: int, status: str, reason: str) -> tuple[str, str]:
        return ("contradicted", 'not so, "really"\nnot') if number in (1, 7, 10) else (status, reason)

    path, direct = tmp_path / f"contacts{suffix}", tmp_path / f"direct{suffix}"
    write_contacts(path, several, about={b"by": b"us"})
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError):
        rewrite_contacts(path, lambda number, status, reason: (status, str(1 // (9 - number))))
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1
    rewrite_contacts(path, changed, {b"done": b"yes"})
    pairs = [changed(number, row.status, row.reason) for number, row in enumerate(several)]
    write_contacts(
        direct, [replace(row, status=status, reason=why) for row, (status, why) in zip(several, pairs, strict=True)]
    )
    if suffix == ".csv":
        assert path.read_bytes() == direct.read_bytes()
        return
    one, other = read_table(path), read_table(direct)
    assert one.schema.equals(other.schema)
    for name in one.column_names:
        np.testing.assert_array_equal(one[name], other[name])
    about = read_metadata(path)
    assert (about.metadata[b"by"], about.metadata[b"done"], about.num_row_groups) == (b"us", b"yes", 4)


@pytest.mark.parametrize(
    ("column", "cell"),
    [
        ("", ""),
        ("status", "fine"),
        ("status", " ok "),
        ("in_contact", "TRUE"),
        ("in_contact", "maybe"),
        ("in_contact", "0"),
        ("frame", "0"),
        ("frame", "1.5"),
        ("time_s", "-1"),
        ("time_s", ""),
        ("distance_m", "-0.1"),
        ("distance_m", ""),
        ("distance_std_m", "-1e-4"),
        ("X_m", ""),
        ("TX", "0.5"),
        ("cov_XX", "-1.0"),
        ("force_y_N", "inf"),
        ("force_y_N", "nan"),
        ("force_y_N", " +0.5 "),
        ("force_y_N", "1_0"),
        ("contact", ""),
        ("contact", "1"),
        ("reason", "#1, é"),
    ],
)
def test_columns_and_rows_read_the_same(written: Path, tmp_path: Path, column: str, cell: str) -> None:
    """A large file is read a column at a time, unless something about it is to be refused or read with more care."""
    header, *body = cells(written)
    if column:
        body[3][header.index(column)] = cell
    outcomes = []
    for name, padding in (("small", 1), ("large", 60_000)):
        path = rewritten(tmp_path / f"{name}.csv", [[*header, "note"], *([*line, padding * "x"] for line in body)])
        try:
            table = read_contacts(path)
        except InputError as error:
            outcomes.append(str(error).replace(str(path), ""))
        else:
            outcomes.append({field: getattr(table, field) for field in COLUMNS})
    small, large = outcomes
    if isinstance(small, str):
        assert large == small
        return
    for field in COLUMNS:
        assert large[field].dtype == small[field].dtype
        np.testing.assert_array_equal(large[field], small[field])
