"""Debug pictures: the detected and the fitted antenna in each frame, and a page with all of them."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from estimator.table.contacts import LOCATED, STATUSES, Contact
from vbaa_calib.antenna.rungs import RUNGS, curves
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_folder_of
from vbaa_calib.core.folders import replacing_folder
from vbaa_calib.core.images import read_gray, read_picture
from vbaa_calib.core.polyline import normals
from vbaa_calib.detect.drawing.canvas import WHITE, Canvas, Colour, Key, strip
from vbaa_calib.detect.drawing.overlay import (
    background,
    described,
    draw_centreline,
    draw_clamp,
    draw_corridor,
    keys,
    sigma_colours,
)
from vbaa_calib.detect.whisker.acceptance import Stretch, stretches, why_lost
from vbaa_calib.detect.whisker.corridor import Corridor, corridor, free_curve, pixels, width_px
from vbaa_calib.detect.whisker.finder import LEAST_AXIS
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame

from .estimate import ContactEstimator
from .recording import FrameContact, gravity
from .settings import ContactSettings

STATUS_COLOURS = {
    "ok": "#009e73",
    "no_contact": "#cbd5e1",
    "tip_contact": "#56b4e9",
    "unobservable": "#cc79a7",
    "low_signal": "#e69f00",
    "not_quasistatic": "#0072b2",
    "no_antenna": "#4b5563",
    "failed": "#d55e00",
    "contradicted": "#9f1239",
}
"""As in the report; told apart by the colour-blind as well."""
CONTACT: Colour = (60, 220, 255)  # of contact, ellipse and force
_PAGE = "index.html"  # of the folder
_OURS = '<meta name="generator" content="vbaa estimate --overlay">'  # a folder whose page has this line may be replaced
_THUMBNAILS = "thumbnails"  # their folder


def _status_colour(status: str) -> tuple[int, int, int]:
    """Colour of a status: blue, green, red."""
    red, green, blue = bytes.fromhex(STATUS_COLOURS[status][1:])
    return blue, green, red


@dataclass(frozen=True, eq=False)
class _Marks:
    """Image coordinates of a frame's contact and antenna, px.

    shape : (M, 2) the fitted antenna; M is 0 where nothing was fitted. width : the antenna's.
    contact : (2,), NaN where it was not located. ellipse : (K, 2) around it, holds it with 95 % probability.
    force : (2,) head of the arrow from the contact along the force on the antenna.
    parts : what became of every stretch of the antenna, where some were not seen.
    """

    shape: np.ndarray
    width: float
    contact: np.ndarray
    ellipse: np.ndarray
    force: np.ndarray
    parts: Sequence[Stretch] = ()

    @property
    def located(self) -> bool:
        """Whether there is a contact to draw."""
        return bool(np.isfinite(self.contact).all())


def corridor_of(rig: Rig, frame: Frame) -> Corridor | None:
    """The corridor of possible antennas in a frame's picture; None where the lens projects too little of it."""
    antenna = rig.antenna
    free = free_curve(antenna.parameters, antenna.length_m, gravity(rig, frame), antenna.taper)
    where = corridor(rig.camera, rig.T_antenna_camera.inverse(), free, antenna.diameter_m, taper=antenna.taper)
    return where if len(where.axis_px) >= LEAST_AXIS else None


def frame_picture(estimator: ContactEstimator, item: FrameContact) -> np.ndarray:
    """(H, W, 3) uint8, blue, green, red: a frame's picture with everything detected and estimated drawn in; those of
    several cameras next to each other."""
    rig, frame = estimator.rig, item.frame
    # without a contact the fit is done again: a picture is not worth keeping every fit of a recording for
    fitted = None if item.contact.status in ("no_contact", "no_antenna") else _bent(estimator, item)
    if not rig.others:
        return _camera_picture(rig, item, fitted)
    several = [_camera_picture(replace(rig, others={}), item, fitted)]
    for name, one in rig.others.items():
        own = replace(frame, image=frame.others.get(name))
        seen = replace(item, frame=own, measured=item.measured.of_camera(name), line=item.others.get(name))
        several.append(_camera_picture(one, seen, fitted))
    height = max(map(len, several))
    return np.hstack([np.pad(each, ((0, height - len(each)), (0, 0), (0, 0))) for each in several])


def _camera_picture(rig: Rig, item: FrameContact, fitted: np.ndarray | None) -> np.ndarray:
    """One camera's debug picture, with the fitted antenna's nodes (M, 3), antenna frame."""
    frame, contact = item.frame, item.contact
    width, height = rig.camera.image_size
    image = np.zeros((height, width), np.uint8) if frame.image is None else read_gray(frame.image)
    where = corridor_of(rig, frame)
    found = _marks(rig, item, fitted)
    if (
        item.line is not None
        and item.line.seen < ContactSettings.whole
        and frame.image is not None
        and where is not None
    ):
        plane = rig.image.paint.plane(read_picture(frame.image))
        found = replace(found, parts=stretches(plane, item.line, where, rig.image.paint.polarity))
    grey = background(image, where)
    canvas = Canvas.over(grey)
    if where is not None:
        draw_corridor(canvas, where)
    _draw(canvas, item, found)
    if where is not None:
        draw_clamp(canvas, where)
    if found.located:
        below = found.force[1] < found.contact[1]
        canvas.words("contact", found.contact, CONTACT, (9.0, 26.0 if below else -14.0))
        _close_up(canvas, grey, item, found)
    numbers, drawn = [], [Key("fitted shape, drawn around the antenna")] if len(found.shape) >= 2 else []
    if found.located:
        drawn += [Key("contact, 95 % ellipse", CONTACT, "ring"), Key("force on the antenna", CONTACT, "arrow")]
        force, std = 1e3 * contact.force_N, 1e3 * contact.force_std_N
        numbers = [f"contact {1e3 * contact.distance_m:.2f} ± {1e3 * contact.distance_std_m:.2f} mm from the clamp"]
        parts = [f"{axis} {force[k]:.2f} ± {std[k]:.2f}" for k, axis in ((1, "y"), (2, "z")) if np.isfinite(force[k])]
        parts = [part.replace("-", "−") for part in parts]
        whole = f"{np.linalg.norm(force):.2f} mN" if len(parts) == 2 else "partly known, mN"
        numbers += [f"force {whole} ({', '.join(parts)})"] if parts else []
    if np.isfinite(contact.moment_residual_Nm):
        numbers.append(f"moment residual {1e6 * contact.moment_residual_Nm:.1f} µN·m")
    points = 0 if item.measured is None else len(item.measured.points_px)
    lost = "" if item.line is None or not item.line.found else why_lost(found.parts)[0]
    seen = f"{points} points from centrelines.csv, no picture" if item.line is None else described(item.line)
    legend = strip(
        canvas.image.shape[1],
        canvas.unit,
        (contact.status, _status_colour(contact.status)),
        (STATUSES[contact.status], f"frame {frame.frame}, {frame.time_s:.2f} s, {rig.camera_name}"),
        ["; ".join(numbers), contact.reason, seen, lost],
        [*keys(item.line, where, found.parts), *drawn],
    )
    return np.vstack([canvas.image, legend])


def _marks(rig: Rig, item: FrameContact, fitted: np.ndarray | None) -> _Marks:
    """A frame's fitted shape, contact and force in image coordinates."""
    contact = item.contact
    T_camera_antenna = rig.T_antenna_camera.inverse()
    points = np.empty((0, 3)) if fitted is None else fitted[np.isfinite(fitted).all(axis=1)]
    shape = pixels(rig.camera, T_camera_antenna, points) if len(points) else np.empty((0, 2))
    antenna_m = rig.antenna.diameter_m * rig.antenna.taper.middle
    width = width_px(rig.camera, T_camera_antenna, points, antenna_m) if len(points) else 0.0
    if contact.status not in LOCATED:
        return _Marks(shape, width, np.full(2, np.nan), np.empty((0, 2)), np.full(2, np.nan))
    force_N = np.nan_to_num(contact.force_N)
    size_N = max(float(np.linalg.norm(force_N)), 1e-300)
    head = contact.point_antenna_m + ContactSettings.force_share * rig.antenna.length_m * force_N / size_N
    ends, _ = rig.camera.project(T_camera_antenna @ np.stack([contact.point_antenna_m, head]))
    rotation = rig.kinematics.T_world_antenna(item.frame.pan_rad, item.frame.tilt_rad).rotation
    return _Marks(shape, width, ends[0], _ellipse(rig, contact, rotation), ends[1])


def _bent(estimator: ContactEstimator, item: FrameContact) -> np.ndarray | None:
    """(M, 3) nodes of the antenna bent by its located contact, antenna frame; else of the fitted shape, if any."""
    contact, antenna = item.contact, estimator.rig.antenna
    if contact.status not in LOCATED or not np.isfinite(contact.force_N).all():
        return estimator.shape(item.measured)
    angle, across = float(np.nan_to_num(contact.friction_angle_rad)), contact.force_N[1:]
    # the part along the antenna's normal, which turns with the antenna
    normal_N = np.linalg.norm(contact.force_N) * np.cos(angle) / max(float(np.linalg.norm(across)), 1e-300) * across
    rung = RUNGS[-1] if estimator.model == "auto" else estimator.model
    pull, contact_m = gravity(estimator.rig, item.frame)[None], np.array([contact.distance_m])
    parameters, length_m = antenna.parameters[None], antenna.length_m
    pushed = pull, contact_m, normal_N[None], np.array([angle])
    return curves(rung, parameters, length_m, *pushed, antenna.taper).points_m[0]


def _ellipse(rig: Rig, contact: Contact, rotation_world_antenna: np.ndarray) -> np.ndarray:
    """(49, 2) px: projected 95 % confidence ellipse of a located contact."""
    T_camera_antenna = rig.T_antenna_camera.inverse()
    point = T_camera_antenna @ contact.point_antenna_m
    turn = T_camera_antenna.rotation @ rotation_world_antenna.T
    step = 1e-5 * float(np.linalg.norm(point))
    ahead, behind = (rig.camera.project(point + sign * step * np.eye(3))[0] for sign in (1.0, -1.0))
    slopes = np.asarray((ahead - behind) / (2.0 * step)).T @ turn  # (2, 3) px/m: how the pixel moves with the point
    sizes, axes = np.linalg.eigh(slopes @ contact.covariance_world_m2 @ slopes.T)
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    # 2.448 standard deviations hold 95 % of a plane's normal distribution
    circle = 2.448 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(rig.camera.project(point[None])[0][0] + circle * np.sqrt(np.clip(sizes, 0.0, None)) @ axes.T)


def _draw(canvas: Canvas, item: FrameContact, found: _Marks, *, close: bool = False) -> None:
    """Draw the fitted shape as a sleeve around the antenna, the detected centreline, the contact and its force."""
    if len(found.shape) >= 2:
        lateral = normals(found.shape) * (0.5 * found.width + 3.5 * canvas.unit / canvas.scale)
        for side in (-lateral, lateral):
            canvas.line(found.shape + side, WHITE)
    if item.line is not None:
        draw_centreline(canvas, item.line, found.parts, named=not close)
    else:
        canvas.graded(item.measured.points_px, sigma_colours(item.measured.sigma_px))
    if found.located:
        if not close:
            canvas.arrow(found.contact, found.force, CONTACT)
            canvas.ring(found.contact, 7.0, CONTACT, 2.0)
        canvas.line(found.ellipse, CONTACT, 2.0)


def _close_up(canvas: Canvas, grey: np.ndarray, item: FrameContact, found: _Marks) -> None:
    """Draw an enlarged view of the contact in the corner that is farthest from the antenna."""
    rows, columns = canvas.image.shape[:2]
    size = int(ContactSettings.close_up * min(rows, columns))
    reach = float(np.abs(found.ellipse - found.contact).max()) if len(found.ellipse) else 0.0
    radius = float(np.clip(max(2.0 * reach, 3.0 * found.width), *ContactSettings.close_up_px))
    part = canvas.cut(cv2.convertScaleAbs(grey, alpha=ContactSettings.close_up_light), found.contact, radius, size)
    _draw(part, item, found, close=True)
    corner = found.contact + np.array([-radius, radius])
    part.words(f"contact, {part.scale / canvas.scale:.0f} times larger", corner, CONTACT, (6.0, -6.0))
    cv2.rectangle(part.image, (0, 0), (size - 1, size - 1), CONTACT, 2)
    corners = [(top, left) for top in (0, rows - size) for left in (0, columns - size)]
    taken = canvas.at(np.vstack([found.shape, found.contact, found.force]))
    middles = np.array([[left, top] for top, left in corners]) + 0.5 * size
    distance = np.abs(taken[None] - middles[:, None]).max(axis=-1)
    top, left = corners[int(np.nan_to_num(distance, nan=np.inf).min(axis=1).argmax())]
    canvas.image[top : top + size, left : left + size] = part.image


def refuse_folder(path: Path, force: bool) -> None:
    """Raises InputError unless debug pictures may be written to `path`; a folder with other content is never
    replaced."""
    refuse_folder_of(path)
    if not os.path.lexists(path):
        return
    if not path.is_dir() or path.is_symlink():
        raise InputError("is not a folder", where=path, remedy="take another name")
    if not force:
        raise InputError("exists already", where=path, remedy="give --force to replace it, or another name")
    page = path / _PAGE
    ours = page.is_file() and _OURS.encode() in page.read_bytes()[:500]
    if any(path.iterdir()) and not ours:
        raise InputError("holds other things than debug pictures", where=path, remedy="take another name")


@contextmanager
def overlaid(
    found: Iterable[FrameContact], estimator: ContactEstimator, path: Path, force: bool, remarks: Sequence[str] = ()
) -> Iterator[Iterator[FrameContact]]:
    """Passes the frames on, drawing each into a folder, which replaces `path` once all are done.

    remarks : on the whole recording, printed first on the page; complete only after the last frame.
    """
    refuse_folder(path, force)
    entries: list[dict[str, Any]] = []

    def drawn(folder: Path) -> Iterator[FrameContact]:
        for item in found:
            frame, contact = item.frame, item.contact
            image, name = frame_picture(estimator, item), f"frame_{frame.frame:06d}_{contact.status}"
            # a thumbnail is of the part above the legend
            width, height = estimator.rig.camera.image_size
            rows = round(image.shape[1] * height / width)
            small = (ContactSettings.thumbnail_px, max(1, round(ContactSettings.thumbnail_px * rows / image.shape[1])))
            thumbnail = cv2.resize(image[:rows], small, interpolation=cv2.INTER_AREA)
            # thin coloured lines stay sharp
            sharp = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
            for place, picture in ((folder, image), (folder / _THUMBNAILS, thumbnail)):
                encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 92, *sharp])[1]
                (place / f"{name}.jpg").write_bytes(encoded.tobytes())
            words = contact.reason
            if contact.status in LOCATED:
                where = f"{1e3 * contact.distance_m:.2f} ± {1e3 * contact.distance_std_m:.2f} mm from the clamp"
                size_mN = 1e3 * np.linalg.norm(contact.force_N)
                words = f"{where}, {size_mN:.1f} mN" if np.isfinite(size_mN) else where
            about = {"frame": frame.frame, "time_s": frame.time_s, "status": contact.status}
            entries.append(about | {"name": name, "words": words})
            yield item

    with replacing_folder(path) as folder:
        (folder / _THUMBNAILS).mkdir()
        yield drawn(folder)
        import jinja2

        loader = jinja2.PackageLoader("estimator.contact", package_path="")
        environment = jinja2.Environment(
            loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        counts = Counter(entry["status"] for entry in entries)
        page = environment.get_template("overlay.html.j2").render(
            generator=_OURS,
            entries=sorted(entries, key=lambda entry: entry["frame"]),
            counts={status: counts[status] for status in STATUS_COLOURS if counts[status]},
            meanings=STATUSES,
            colours=STATUS_COLOURS,
            thumbnails=_THUMBNAILS,
            remarks=remarks,
        )
        (folder / _PAGE).write_text(page, encoding="utf-8")
