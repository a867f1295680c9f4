"""From files to report.html: the one way that `vbaa report`, `vbaa estimate` and `vbaa demo` take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from viz.files.outputs import PAGES, refuse_output

if TYPE_CHECKING:
    from .recording import SummaryRow


@dataclass(frozen=True)
class Sources:
    """What a report is made from.

    Attributes
    ----------
    contacts : contacts.csv or .parquet.
    rig : rig.json: adds friction, stiffness, the scene and the residual's scale.
    session : adds a picture of the recording; needs the rig.
    background : as `vbaa estimate` was given it.
    truth : truth.json, drawn beside the estimates.
    picture : of the scene, drawn already; without it one is drawn.
    drift : what has changed since the calibration (`estimator.contact.drift.summary`).
    """

    contacts: Path
    rig: Path | None = None
    session: Path | None = None
    truth: Path | None = None
    picture: Path | None = None
    background: Path | None = None
    drift: Mapping[str, Any] | None = None


def beside(contacts: Path) -> Path:
    """Where the report of contacts goes: report.html, or NAME_report.html for a NAME that is not contacts."""
    return contacts.with_name("report.html" if contacts.stem == "contacts" else f"{contacts.stem}_report.html")


def make_report(
    path: Path,
    sources: Sources,
    *,
    title: str,
    argv: Sequence[str] = (),
    summary: Sequence[SummaryRow] = (),
    force: bool = False,
) -> None:
    """Read the sources, estimate the object, draw, and write the page, whole or not at all.

    `argv` is the command line that asked for it, `summary` holds errors against truth with the goal of each.
    Raises InputError when a source cannot be read, or the page exists and `force` is off.
    """
    from estimator.table.files import read_contacts
    from estimator.table.joint_angles import joint_angles
    from vbaa_calib.core.files import read_json, write_text
    from vbaa_calib.rig import Rig
    from viz.scene.truth import true_contacts

    from .pictures import scene_from_file, scene_picture, seen_picture
    from .recording import Report, page
    from .words import object_found, origin

    refuse_output(path, PAGES, force)
    table = read_contacts(sources.contacts)
    rig = None if sources.rig is None else Rig.load(sources.rig)
    if rig is not None:
        joint_angles(rig.kinematics, table)  # refuses another rig's contacts
    contents = None if sources.truth is None else read_json(sources.truth)
    truth = None if contents is None else true_contacts(table, contents, sources.truth)
    estimate, track, facts = object_found(table, rig)
    if sources.picture is None:
        pictures = [scene_picture(table, rig, estimate, contents, sources.session)]
    else:
        pictures = [scene_from_file(sources.picture)]
    if sources.session is not None and rig is not None:
        pictures.append(seen_picture(table, rig, sources.session, sources.background))
    files = {name: getattr(sources, name) for name in ("contacts", "rig", "session", "truth")}
    rows = origin(files, rig, argv)
    made = Report(title, table, rig, estimate, track, facts, truth, summary, pictures, rows, sources.drift)
    write_text(path, page(made), force)
