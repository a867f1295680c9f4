"""Checks of the outputs' names, without heavy imports: the verbs call them before any work."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite

PAGES = (".html", ".htm")


def refuse_output(path: Path, suffixes: tuple[str, ...], force: bool, inputs: Iterable[Path | None] = ()) -> None:
    """Raises InputError for another suffix, an existing file without `force`, or one of the command's own inputs."""
    if path.suffix.lower() not in suffixes:
        names = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        raise InputError(f"is not a {names}", where=path, remedy=f"name it something{suffixes[0]}")
    refuse_overwrite(path, force, inputs)


def report_path(contacts: Path) -> Path:
    """Path of the report on contacts: report.html, or NAME_report.html where NAME is not contacts."""
    return contacts.with_name("report.html" if contacts.stem == "contacts" else f"{contacts.stem}_report.html")
