"""The data set of a batch: contacts as Parquet by recording, one summary table, objects; whole or not at all.

results/
  batch.json                                 what made it
  summary.csv                                a row for every recording, failed ones with their sentence
  contacts/recording=NAME/contacts.parquet   rows of contacts.csv; the digests of what made them in its metadata
  objects/NAME.vtp
  pieces/                                    only while it is made
"""

from __future__ import annotations

import csv
import io
import json
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimator.table.contacts import LOCATED, STATUSES
from estimator.table.files import parquet_writer
from estimator.table.overview import Overview, readings_in_words
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json, replacing, write_json, write_text
from vbaa_calib.core.folders import make_folder, writing_alone
from vbaa_calib.core.robust import finite_median, finite_or_none

SCHEMA = "vbaa.batch/1"
_KEY = b"vbaa.batch"
_SUMMARY = (
    *("recording", "state", "sentence", "path", "rig", "rig_sha256", "inputs_sha256", "digest", "version"),
    *("frames", *STATUSES, "distance_median_m", "distance_std_median_m", "force_median_N", "force_std_median_N"),
    *("moment_residual_rms_Nm", "free_frames", "drift_picture_px", "drift_moment_zero_std", "drift_beyond"),
    *("outside_points", "warnings", "pieces", "cpu_s", "object", "readings", "reasons"),
)
"""Columns of summary.csv; state is done or failed."""
_COUNTED = (
    *("frame", "status", "reason", "distance_m", "distance_std_m"),
    *("force_y_N", "force_z_N", "force_y_std_N", "force_z_std_N", "moment_residual_Nm"),
)
"""Columns of contacts of which the summary has numbers."""
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Results:
    """Where the parts of a data set lie."""

    root: Path

    def contacts(self, name: str) -> Path:
        return self.root / "contacts" / f"recording={name}" / "contacts.parquet"

    def object(self, name: str) -> Path:
        return self.root / "objects" / f"{name}.vtp"

    def piece(self, name: str, digest: str, index: int) -> Path:
        return self.root / "pieces" / name / digest[:16] / f"{index:06d}.parquet"

    @property
    def summary(self) -> Path:
        return self.root / "summary.csv"

    def prepare(self, argv: Sequence[str]) -> None:
        """Make the folder, or go on in one that a batch made. Raises InputError for any other."""
        own = self.root / "batch.json"
        make_folder(self.root)
        try:
            strange = any(self.root.iterdir()) and not own.exists()
        except OSError as error:
            what = f"cannot be read ({error.strerror})"
            raise InputError(what, where=self.root, remedy="take another name") from None
        if strange:
            raise InputError("holds other things than a batch's results", where=self.root, remedy="take another name")
        if own.exists() and read_json(own).get("schema") != SCHEMA:
            raise InputError(f"is not of {SCHEMA}", where=own, remedy="take another folder")
        write_json(own, {"schema": SCHEMA, "command": list(argv)})

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While one batch works here no other does. Raises InputError where one does already."""
        with writing_alone(self.root):
            self.remove_work()
            yield
            self.remove_work()

    def done(self, name: str) -> Row | None:
        """The summary of a recording whose contacts are there; None where they are not, or cannot be read."""
        import pyarrow
        from pyarrow.parquet import read_metadata

        try:
            return dict(json.loads((read_metadata(self.contacts(name)).metadata or {})[_KEY]))
        except (OSError, KeyError, ValueError, pyarrow.ArrowException):
            return None

    def every(self) -> list[Row]:
        """The summaries of all recordings whose contacts are there."""
        parts = sorted((self.root / "contacts").glob("recording=*"))
        return [row for part in parts if (row := self.done(part.name.partition("=")[2])) is not None]

    def write_summary(self, failed: Iterable[Row]) -> list[Row]:
        """summary.csv of all contacts that are there and of the recordings that failed; its rows."""
        rows = {str(row["recording"]): dict(row) for row in (*self.every(), *failed)}
        for name, row in rows.items():
            if self.object(name).exists():
                row["object"] = self.object(name).relative_to(self.root)
        text = io.StringIO()
        writer = csv.DictWriter(text, _SUMMARY, restval="", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        for _, row in sorted(rows.items()):
            words: Row = {} if "readings" not in row else {"readings": readings_in_words(row["readings"])}
            reasons = [f"{one['frames']} {one['reason']}" for one in row.get("reasons", ())[:3]]
            writer.writerow({name: _cell({**row, **words, "reasons": reasons}.get(name)) for name in _SUMMARY})
        write_text(self.summary, text.getvalue())
        return list(rows.values())

    def join(self, name: str, pieces: Sequence[Path], about: Row) -> Row:
        """Make the recording's contacts of its pieces, a row group at a time; its summary: `about`, and counts."""
        import pyarrow.parquet as parquet

        target, kept = self.contacts(name), []
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as temporary, parquet_writer(temporary, parquet.read_schema(pieces[0])) as writer:
            for piece in pieces:
                with parquet.ParquetFile(piece) as file:
                    for group in range(file.num_row_groups):
                        rows = file.read_row_group(group)
                        writer.write_table(rows)
                        kept.append({column: rows[column].to_numpy() for column in _COUNTED})
            row = {**about, **_numbers(kept)}
            writer.add_key_value_metadata({_KEY: json.dumps(row, allow_nan=False).encode()})
        return row

    def forget(self, name: str) -> None:
        """Remove a recording's pieces."""
        shutil.rmtree(self.root / "pieces" / name, ignore_errors=True)

    def remove_work(self) -> None:
        """Remove what is there only while results are made."""
        shutil.rmtree(self.root / "pieces", ignore_errors=True)


def _numbers(parts: Sequence[Mapping[str, np.ndarray]]) -> dict[str, Any]:
    """Of all contacts: how many of each status, and what is usual of them."""
    column = {name: np.concatenate([part[name] for part in parts]) for name in _COUNTED}
    located = np.isin(column["status"].astype(str), LOCATED)
    distance, distance_std, y, z, y_std, z_std = (column[name][located] for name in _COUNTED[3:-1])
    residual = column["moment_residual_Nm"]
    residual = residual[np.isfinite(residual)]
    overview = Overview()
    for frame, status, reason in zip(*(column[name].tolist() for name in _COUNTED[:3]), strict=True):
        overview.add_result(frame, str(status), str(reason))
    return {
        "reasons": overview.numbers()["reasons"],
        "frames": len(located),
        **{status: int((column["status"] == status).sum()) for status in STATUSES},
        "distance_median_m": finite_or_none(finite_median(distance)),
        "distance_std_median_m": finite_or_none(finite_median(distance_std)),
        "force_median_N": finite_or_none(finite_median(np.hypot(y, z))),
        "force_std_median_N": finite_or_none(finite_median(np.hypot(y_std, z_std))),
        "moment_residual_rms_Nm": float(np.sqrt(np.mean(residual**2))) if len(residual) else None,
    }


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, list | tuple):
        value = "; ".join(map(str, value))
    return " ".join(str(value).split())
