"""What was in the session before the wizard came, or came into it behind its back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_text, sha256, write_text
from vbaa_calib.core.images import list_images, read_picture
from vbaa_calib.session import Session, load_session, read_loads, read_noload, read_sweep
from vbaa_calib.wizard.state.journal import PICTURES, Record, Taken
from vbaa_calib.wizard.state.session_file import COLUMNS, answers_of
from vbaa_calib.wizard.state.store import ASIDE, FOLDERS, WAYS, Store
from vbaa_calib.wizard.steps import board
from vbaa_calib.wizard.ui.interface import Desk


def adopt(store: Store, desk: Desk) -> None:
    """Begin with a session that was made without the wizard: what it says and shows counts as answered and taken."""
    path = store.root / "session.yaml"
    if not store.is_new or not path.exists():
        return
    session, found = load_session(store.root), answers_of(path)
    given = store.root / ASIDE / "given"
    given.mkdir(parents=True, exist_ok=True)
    tables = [folder / f"{folder.name}.csv" for folder in map(store.root.joinpath, COLUMNS)]
    for file in (path, *tables):
        if file.is_file():
            write_text(given / file.name, read_text(file))
    made = board.make_board(store, found)
    journal = store.journal.with_answers({**made, **found})
    for step, words in PICTURES.items():
        taken = _adopted(store, session, step, WAYS.get(str(found.get("plane_way")), "plane"))
        if taken:
            journal = journal.with_step(step, Record(taken))
            desk.say(f"{len(taken)} pictures {words} are there already")
    # at once: a stop in between must not leave half of it to be taken for strangers
    store.save(journal)


def _adopted(store: Store, session: Session, step: str, way: str) -> tuple[Taken, ...]:
    folder = store.root / FOLDERS.get(step, way)
    if not folder.is_dir():
        return ()
    rows = _rows(session, folder.name)
    if rows is None:
        return tuple(_taken(folder, image, {}) for image in list_images(folder))
    return tuple(_taken(folder, row.image, _row_readings(row)) for row in rows)


def _rows(session: Session, folder: str) -> Sequence[Any] | None:
    """The table of a folder; None where its pictures have none."""
    if folder == "noload":
        return read_noload(session)
    if folder == "loads":
        return read_loads(session)
    return read_sweep(session) if folder == "sweep" else None


def _taken(folder: Path, image: Path, readings: Mapping[str, float]) -> Taken:
    read_picture(image)
    if image.parent.resolve() != folder.resolve():
        raise InputError(f"lies outside {folder}", where=image, remedy="move it there, and mend its row in the table")
    return Taken(f"{folder.name}/{image.name}", image.name, sha256(image), readings)


def _row_readings(row: Any) -> dict[str, float]:
    names = ("pan_rad", "tilt_rad", "moment_Nm", "distance_m", "force_y_N", "force_z_N", "time_s")
    return {name: getattr(row, name) for name in names if getattr(row, name, None) is not None}


def put_strangers_aside(store: Store, desk: Desk) -> None:
    """Pictures in the session's folders that nobody was told of: left by a stop, or put there by hand."""
    strangers = store.strangers()
    if strangers:
        names = [path.relative_to(store.root).as_posix() for path in strangers]
        place = store.put_aside(strangers, "found")
        shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        desk.say(f"not taken by the wizard, and put aside into {place}: {shown}")
