"""From files to report.html: the one way that `vbaa report`, `vbaa estimate` and `vbaa demo` take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite

if TYPE_CHECKING:
    from .recording import SummaryRow

SUFFIXES = (".html", ".htm")


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
    """

    contacts: Path
    rig: Path | None = None
    session: Path | None = None
    truth: Path | None = None
    picture: Path | None = None
    background: Path | None = None


def beside(contacts: Path) -> Path:
    """Where the report of contacts goes: report.html, or NAME_report.html for a NAME that is not contacts."""
    return contacts.with_name("report.html" if contacts.stem == "contacts" else f"{contacts.stem}_report.html")


def refuse_report(path: Path, force: bool) -> None:
    """Raises InputError for a name that is no page's, or a file in the way, before any work."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError("is not a .html", where=path, remedy="name it something.html")
    refuse_overwrite(path, force)


def make_report(
    path: Path,
    sources: Sources,
    *,
    title: str,
    argv: Sequence[str] = (),
    summary: Sequence[SummaryRow] = (),
    force: bool = False,
) -> None:
    """Read the sources, estimate the object, draw, and write the page.

    Parameters
    ----------
    argv : the command line that asked for it, written in the page.
    summary : errors against truth, with the goal of each.

    Raises
    ------
    InputError : a source cannot be read, or the page exists and `force` is off.
    """
    from estimator.table.files import read_contacts
    from estimator.table.joint_angles import joint_angles
    from vbaa_calib.core.files import read_json
    from vbaa_calib.rig import Rig
    from viz.scene.truth import true_contacts

    from .findings import object_findings
    from .pictures import SCENE_CAPTION, from_file, scene_picture, seen_picture
    from .recording import Report, write_report
    from .words import origin

    refuse_report(path, force)
    table = read_contacts(sources.contacts)
    rig = None if sources.rig is None else Rig.load(sources.rig)
    if rig is not None:
        joint_angles(rig.kinematics, table)  # refuses another rig's contacts
    contents = None if sources.truth is None else read_json(sources.truth)
    truth = None if contents is None else true_contacts(table, contents, sources.truth)
    findings = object_findings(table, rig, truth)
    if sources.picture is None:
        pictures = [scene_picture(table, rig, findings.estimate, contents, sources.session)]
    else:
        pictures = [from_file(sources.picture, SCENE_CAPTION)]
    if sources.session is not None and rig is not None:
        pictures.append(seen_picture(table, rig, sources.session, sources.background))
    files = {
        "contacts": sources.contacts,
        "rig": sources.rig,
        "session": sources.session,
        "truth": sources.truth,
    }
    report = Report(
        title=title,
        table=table,
        findings=findings,
        rig=rig,
        truth=truth,
        summary=summary,
        pictures=pictures,
        origin=origin(files, rig, argv),
    )
    write_report(path, report, force=force)
