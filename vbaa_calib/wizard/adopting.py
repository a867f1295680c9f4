"""What was in the session before the wizard came, or came into it without the wizard."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_text, sha256, write_text
from vbaa_calib.core.images import list_images, read_picture
from vbaa_calib.session import Session, load_session, read_loads, read_noload, read_sweep
from vbaa_calib.wizard.state.catalogue import PICTURES, READINGS
from vbaa_calib.wizard.state.journal import AcceptedPicture
from vbaa_calib.wizard.state.session_file import answers_of
from vbaa_calib.wizard.state.store import ASIDE, FOLDERS, WAYS, Store
from vbaa_calib.wizard.steps.board import make_board
from vbaa_calib.wizard.ui.base import Ui

_READERS: Mapping[str, Callable[[Session], Sequence[Any]]] = {
    "noload": read_noload,
    "loads": read_loads,
    "sweep": read_sweep,
}
_COLUMNS = ("pan_rad", "tilt_rad", "moment_Nm", "distance_m", "force_y_N", "force_z_N", "time_s")


def adopt(store: Store, ui: Ui) -> None:
    """Begin with a session that was made without the wizard: what is in it counts as answered and taken."""
    path = store.root / "session.yaml"
    if not store.is_new or not path.exists():
        return
    session, answers = load_session(store.root), answers_of(path)
    given = store.root / ASIDE / "given"
    given.mkdir(parents=True, exist_ok=True)
    for file in (path, *(store.root / folder / f"{folder}.csv" for folder in READINGS)):
        if file.is_file():
            write_text(given / file.name, read_text(file))
    journal = store.journal.with_answers({**make_board(store, answers), **answers})
    for step, words in PICTURES.items():
        folder = store.root / (FOLDERS.get(step) or WAYS.get(str(answers.get("plane_way")), "plane"))
        if not folder.is_dir():
            continue
        if folder.name in _READERS:
            rows = _READERS[folder.name](session)
            taken = tuple(_accepted(folder, row.image, _row_readings(row)) for row in rows)
        else:
            taken = tuple(_accepted(folder, image, {}) for image in list_images(folder))
        if taken:
            journal = journal.with_step(step, taken=taken)
            ui.say(f"{len(taken)} pictures {words} are there already")
    # at once: a stop in between must not leave half of it unlisted
    store.save(journal)


def _accepted(folder: Path, image: Path, readings: Mapping[str, float]) -> AcceptedPicture:
    read_picture(image)
    if image.parent.resolve() != folder.resolve():
        raise InputError(
            f"lies outside {folder}", where=image, remedy="move it there, and correct its row in the table"
        )
    file = f"{folder.name}/{image.name}"
    return AcceptedPicture(file=file, source=image.name, sha256=sha256(image), readings=dict(readings))


def _row_readings(row: Any) -> dict[str, float]:
    return {name: getattr(row, name) for name in _COLUMNS if getattr(row, name, None) is not None}


def set_unlisted_aside(store: Store, ui: Ui) -> None:
    """Set aside pictures in the session's folders that wizard.json does not name: of a stop, or put there by hand."""
    unlisted = store.unlisted()
    if unlisted:
        names = [path.relative_to(store.root).as_posix() for path in unlisted]
        place = store.set_aside(unlisted, "found")
        shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        ui.say(f"not taken by the wizard, and set aside in {place}: {shown}")
