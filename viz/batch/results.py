"""The data set of a batch: contacts as Parquet by recording, one summary table, objects; written completely or not
at all.

results/
  batch.json                                 what made it
  summary.csv                                a row for every recording, failed ones with their sentence
  contacts/recording=NAME/contacts.parquet   rows of contacts.csv; the digests of what made them in its metadata
  objects/NAME.vtp
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimator.diagnose import RecordingVerdict
from estimator.diagnose.consequences import changed_row
from estimator.table.contacts import LOCATED, STATUSES, ContactTable
from estimator.table.files import rewrite_contacts, write_contacts
from estimator.table.overview import readings_in_words
from vbaa_calib.core.csv_rows import csv_text
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json, write_json, write_text
from vbaa_calib.core.folders import make_folder, writing_alone
from vbaa_calib.core.robust import finite_median, finite_or_none

SCHEMA = "vbaa.batch/1"
_KEY = b"vbaa.batch"
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Results:
    """Paths of a data set's parts, and its reading and writing."""

    root: Path

    def contacts(self, name: str) -> Path:
        return self.root / "contacts" / f"recording={name}" / "contacts.parquet"

    def object(self, name: str) -> Path:
        return self.root / "objects" / f"{name}.vtp"

    @property
    def summary(self) -> Path:
        return self.root / "summary.csv"

    def prepare(self, argv: Sequence[str]) -> None:
        """Make the folder, or continue in one that a batch made. Raises InputError for any other."""
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
        """Context in which no other batch works here. Raises InputError where one does already."""
        with writing_alone(self.root):
            self.remove_work()
            try:
                yield
            finally:
                self.remove_work()

    def done(self, name: str) -> Row | None:
        """The summary of a recording with contacts; None where these do not exist or cannot be read."""
        import pyarrow
        from pyarrow.parquet import read_metadata

        try:
            return dict(json.loads((read_metadata(self.contacts(name)).metadata or {})[_KEY]))
        except (OSError, KeyError, ValueError, pyarrow.ArrowException):
            return None

    def every(self) -> list[Row]:
        """The summaries of all recordings with contacts."""
        parts = sorted((self.root / "contacts").glob("recording=*"))
        return [row for part in parts if (row := self.done(part.name.partition("=")[2])) is not None]

    def write_summary(self, failed: Iterable[Row]) -> list[Row]:
        """Write summary.csv of all existing contacts and of the recordings that failed; returns its rows."""
        rows = {str(row["recording"]): dict(row) for row in (*self.every(), *failed)}
        for name, row in rows.items():
            if self.object(name).exists():
                row["object"] = self.object(name).relative_to(self.root)
        columns = (
            *(
                "recording",
                "state",
                "sentence",
                "verdict",
                "path",
                "rig",
                "rig_sha256",
                "inputs_sha256",
                "digest",
                "version",
            ),
            *(
                "frames",
                *STATUSES,
                "distance_median_m",
                "distance_std_median_m",
                "force_median_N",
                "force_std_median_N",
            ),
            *("moment_residual_rms_Nm", "free_frames", "drift_picture_px", "drift_moment_zero_std", "drift_beyond"),
            *("outside_points", "warnings", "cpu_s", "object", "readings", "reasons"),
        )
        table = []
        for _, row in sorted(rows.items()):
            words: Row = {} if "readings" not in row else {"readings": readings_in_words(row["readings"])}
            reasons = [f"{one['frames']} {one['reason']}" for one in row.get("reasons", ())[:3]]
            findings = row.get("verdict", {}).get("findings", ())
            verdict = [f"{one['severity']}: {one['words']}; {one['remedy']}" for one in findings]
            cells = {**row, **words, "reasons": reasons, "verdict": verdict}
            table.append({name: _cell(cells.get(name)) for name in columns})
        write_text(self.summary, csv_text(table, columns))
        return list(rows.values())

    def write(
        self,
        name: str,
        tables: Iterable[ContactTable],
        judged: Callable[[], RecordingVerdict],
        about: Callable[[RecordingVerdict], Row],
    ) -> Row:
        """Write a recording's contacts as they come; returns its summary: `about`, and numbers that include the
        verdict on the recording, which is asked for after the last row."""
        located: dict[str, array[float]] = {
            column: array("d")
            for column in ("distance_m", "distance_std_m", "force_y_N", "force_z_N", "force_y_std_N", "force_z_std_N")
        }
        places, residuals, verdict = array("q"), array("d"), RecordingVerdict()
        summary, metadata, whole = dict[str, Any](), dict[bytes, bytes](), dict[bytes, bytes]()

        def counted() -> Iterator[ContactTable]:
            nonlocal verdict
            begin = 0
            for table in tables:
                (own,) = np.isin(table.status, LOCATED).nonzero()
                places.extend((begin + own).tolist())
                for column, values in located.items():
                    values.extend(getattr(table, column)[own].tolist())
                residuals.extend(table.moment_residual_Nm[np.isfinite(table.moment_residual_Nm)].tolist())
                begin += len(table)
                yield table
            self.object(name).unlink(missing_ok=True)  # it is no longer these contacts'
            verdict = judged()
            kept = np.array([not verdict.concerns(place) for place in places], bool)
            distance, distance_std, y, z, y_std, z_std = (np.asarray(each)[kept] for each in located.values())
            summary.update(
                about(verdict),
                distance_median_m=finite_or_none(finite_median(distance)),
                distance_std_median_m=finite_or_none(finite_median(distance_std)),
                force_median_N=finite_or_none(finite_median(np.hypot(y, z))),
                force_std_median_N=finite_or_none(finite_median(np.hypot(y_std, z_std))),
                moment_residual_rms_Nm=float(np.sqrt(np.mean(np.square(residuals)))) if residuals else None,
            )
            whole[_KEY] = json.dumps(summary, allow_nan=False).encode()
            if not verdict.concerns_any:
                metadata.update(whole)

        write_contacts(self.contacts(name), counted(), force=True, about=metadata)
        if verdict.concerns_any:  # only then it counts as done
            rewrite_contacts(self.contacts(name), partial(changed_row, verdict), whole)
        return summary

    def remove_work(self) -> None:
        """Remove temporary files of writers that were killed."""
        for leftover in self.root.glob("contacts/recording=*/.contacts-*.parquet"):
            leftover.unlink(missing_ok=True)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, list | tuple):
        value = "; ".join(map(str, value))
    return " ".join(str(value).split())
