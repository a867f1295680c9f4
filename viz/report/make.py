"""From files to report.html, for `vbaa report`, `vbaa estimate` and `vbaa demo`; with pictures of the scene in three
dimensions, and of the recording with the detected antenna."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from markupsafe import Markup

from estimator.table.contacts import ContactTable, joint_angles
from estimator.table.files import read_contacts
from estimator.table.overview import readings_in_words
from vbaa_calib.core.errors import VbaaError, Verdict
from vbaa_calib.core.files import read_json, write_text
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session, read_recording
from viz.figures.scene import scene_views
from viz.files.outputs import PAGES, refuse_output
from viz.pages.page import render
from viz.report.recording import Report, SummaryRow, page
from viz.report.words import object_found, origin
from viz.scene.layout import LOOK
from viz.scene.readable import contact_scale, object_scale
from viz.scene.rig_items import session_pictures
from viz.scene.scene import Fact, Scene, build_scene, framewise, sentence

if TYPE_CHECKING:
    from estimator.contact.recording import Ground
    from estimator.object.estimate import ObjectEstimate


@dataclass(frozen=True)
class Sources:
    """Inputs of a report.

    contacts : contacts.csv or .parquet.
    rig : rig.json: adds friction, stiffness, the scene and the residual's scale.
    session : adds a picture of the recording; needs the rig.
    ground : the background that `vbaa estimate` subtracted from the pictures.
    truth : truth.json, drawn with the estimates.
    drift : what has changed since the calibration (`estimator.contact.drift.summary`).
    framewise : contacts.csv that the contacts were refined from, drawn with them.
    readings : what was read with the frames (`estimator.table.overview.Overview.numbers`).
    verdict : on the recording.
    antenna : the one of several that it is about.
    """

    contacts: Path
    rig: Path | None = None
    session: Path | None = None
    truth: Path | None = None
    ground: Ground | None = None
    drift: Mapping[str, Any] | None = None
    framewise: Path | None = None
    readings: Mapping[str, Any] | None = None
    verdict: Verdict | None = None
    antenna: str | None = None


def make_report(
    path: Path,
    sources: Sources,
    *,
    title: str,
    argv: Sequence[str] = (),
    summary: Sequence[SummaryRow] = (),
    force: bool = False,
) -> None:
    """Read the inputs, estimate the object, draw, and write the page, completely or not at all.

    `argv` is the command line that asked for it, `summary` holds errors against truth with the goal of each.
    Raises InputError when a source cannot be read, or the page exists and `force` is off.
    """
    refuse_output(path, PAGES, force)
    table = read_contacts(sources.contacts, antenna=sources.antenna)
    rig = None if sources.rig is None or table.clamp_moves else Rig.load(sources.rig)
    if rig is not None:
        joint_angles(rig.kinematics, table)  # refuses another rig's contacts
    contents = None if sources.truth is None else read_json(sources.truth)
    truth = None
    if contents is not None:
        from viz.scene.truth import true_contacts

        truth = true_contacts(table, contents, sources.truth)
    estimate, track, facts = object_found(table, rig)
    if sources.readings is not None:
        facts = (Fact("Readings", sentence(readings_in_words(sources.readings))), *facts)
    if rig is not None and rig.verdict.severity == "wrong":
        words = sentence(f"The verdict on the rig is wrong: {rig.verdict.causes}")
        facts = (Fact("Calibration", words, "look"), *facts)
    if sources.verdict is not None:
        facts = (*(Fact("Verdict", sentence(line), "look") for line in sources.verdict.lines), *facts)
    pictures = [_scene_picture(table, rig, estimate, contents, sources.session)]
    if sources.session is not None and rig is not None:
        pictures.append(_seen_picture(table, rig, sources.session, sources.ground))
    files = {name: getattr(sources, name) for name in ("contacts", "framewise", "rig", "session", "truth")}
    rows = origin(files, rig, argv)
    before = None if sources.framewise is None else framewise(sources.framewise, table)
    made = Report(title, table, rig, estimate, track, facts, truth, summary, pictures, rows, sources.drift, before)
    write_text(path, page(made), force)


def packed(image: np.ndarray) -> bytes:
    """(H, W, 3) uint8, blue, green, red, as a JPEG that is not wider than a page needs."""
    scale = 1600 / image.shape[1]
    if scale < 1.0:
        size = (1600, max(1, round(image.shape[0] * scale)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes()


def _scene_picture(
    table: ContactTable,
    rig: Rig | None,
    estimate: ObjectEstimate | None,
    truth: Mapping[str, Any] | None,
    session: Path | None,
) -> Markup:
    """The scene's pictures, or the reason why there are none. truth : truth.json's content."""
    if not table.located.any():
        return _picture("No picture of the scene: no frame has a located contact.")
    try:
        true = None
        if truth is not None:
            from viz.scene.truth import true_object

            true = true_object(truth)
        scene = build_scene(table, rig, estimate, true, with_words=False)
        if rig is not None and session is not None:
            main, frames = scene.instants.main, scene.instants.frame
            seen = session_pictures(session, frames[main : main + 1], rig.camera.image_size)[0]
            scene = replace(scene, pictures=tuple(seen if index == main else None for index in range(len(frames))))
        return _picture(
            "The scene, and what was touched close up. Points are contacts, arrows the object's forces on the "
            "antenna; `vbaa view` shows the scene to turn, zoom and follow in time.",
            b"",
            views=scene_views(scene),
            **_scene_key(scene),
        )
    except VbaaError as error:
        return _picture(f"No picture of the scene: {error}")


def _seen_picture(table: ContactTable, rig: Rig, session: Path, ground: Ground | None = None) -> Markup:
    """The recording's picture at the greatest force, with the detected antenna and the table's contact, or the
    reason why there is none."""
    from estimator.contact.estimate import ContactEstimator
    from estimator.contact.overlay import frame_picture
    from estimator.contact.recording import FrameContact, detected, read_ahead

    whole = np.linalg.norm(table.force_world_N, axis=1)
    force = np.where(np.isfinite(whole), whole, np.nan_to_num(np.hypot(table.force_y_N, table.force_z_N)))
    row = int(np.argmax(np.where(table.located, force, -1.0)))
    try:
        frames = {frame.frame: frame for frame in read_recording(load_session(session))}
        frame = frames.get(int(table.frame[row])) if table.located[row] else None
        if frame is None or frame.image is None:
            return _picture("No picture of the recording: it has none, or none with a located contact.")
        # what is seen is found anew, the numbers are the table's
        estimator = ContactEstimator(rig, str(table.model[row]), friction=table.assumed_friction_rad)
        seen = next(detected(estimator, read_ahead(estimator.rig, [frame]), ground))
        own = next(table.picked(np.array([row])).rows())
        contact = replace(own, pan_rad=frame.pan_rad, tilt_rad=frame.tilt_rad).estimate(rig.kinematics)
        image = frame_picture(estimator, FrameContact(frame, contact, seen.measured, seen.line, seen.others))
    except VbaaError as error:
        return _picture(f"No picture of the recording: {error}")
    return _picture(
        f"Frame {frame.frame}, the one of the greatest force, with what was seen of the antenna, the fitted shape, the "
        "contact and the force; `vbaa estimate --overlay` draws every frame so.",
        packed(image),
    )


def _picture(words: str, jpeg: bytes = b"", **drawn: Sequence[object]) -> Markup:
    """A picture of the report: a JPEG, or drawn `views` with their `colours` and `ramps`; without either `words`
    give the reason."""
    drawn = {"views": (), "colours": (), "ramps": ()} | drawn
    return Markup(render("picture.html.j2", words=words, jpeg=jpeg, **drawn))


def _scene_key(scene: Scene) -> dict[str, list[tuple[str, ...]]]:
    """The pictures' legend: `colours` with their meaning, and `ramps` (gradient in CSS, low end, title, high end)."""
    notes = {"spread": scene.spreads()[2], "cones": scene.cones()[2]}
    names = ["object"] if scene.object is not None and object_scale(scene) is None else []
    names += [name for name, (found, *_) in (("spread", scene.spreads()), ("cones", scene.cones())) if len(found)]
    names += ["truth"] if scene.truth is not None else []
    if scene.rig is not None:
        step = scene.level_grid(scene.rig)[1]
        names += ["antenna", "free", *["ghosts"] * bool(len(scene.rig.ghosts))]
        names += ["plane", "camera", *["grid"] * (step > 0)]
        notes["grid"] = f"{1e3 * step:g} mm"
    labels = {name: LOOK[name][1] for name in names} | {"antenna": "antenna at the greatest force"}
    scales = [one for one in (contact_scale(scene, "force"), object_scale(scene)) if one is not None]
    return {
        "colours": [(LOOK[name][0], ", ".join(filter(None, [labels[name], notes.get(name, "")]))) for name in names],
        "ramps": [(one.gradient, *one.ends) for one in scales],
    }
