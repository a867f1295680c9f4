"""Debug pictures: what was seen of the antenna in a frame and what was made of it, and a page that shows them all."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import jinja2
import numpy as np

from estimator.table.contacts import LOCATED, STATUSES, Contact
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import replacing_folder
from vbaa_calib.core.images import read_gray
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
from vbaa_calib.detect.whisker.antenna import LEAST_AXIS, corridor, free_curve, pixels, width_px
from vbaa_calib.detect.whisker.corridor import Corridor, normals
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame

from .estimate import ContactEstimator
from .recording import FrameContact, gravity

STATUS_COLOURS = {
    "ok": "#009e73",
    "no_contact": "#cbd5e1",
    "tip_contact": "#56b4e9",
    "unobservable": "#cc79a7",
    "low_signal": "#e69f00",
    "not_quasistatic": "#0072b2",
    "no_antenna": "#4b5563",
    "failed": "#d55e00",
}
"""As in the report; told apart by the colour-blind as well."""


def status_colour(status: str) -> tuple[int, int, int]:
    """Blue, green, red."""
    red, green, blue = bytes.fromhex(STATUS_COLOURS[status][1:])
    return blue, green, red


def numbers(contact: Contact) -> str:
    """Distance and force with their standard deviations, and the moment residual; empty where there are none."""
    parts = []
    if contact.status in LOCATED:
        force, std = 1e3 * contact.force_N, 1e3 * contact.force_std_N
        parts = [
            f"contact {1e3 * contact.distance_m:.2f} ± {1e3 * contact.distance_std_m:.2f} mm from the clamp",
            f"force {np.linalg.norm(force):.2f} mN (y {force[1]:.2f} ± {std[1]:.2f}, z {force[2]:.2f} ± {std[2]:.2f})",
        ]
    if np.isfinite(contact.moment_residual_Nm):
        parts.append(f"moment residual {1e6 * contact.moment_residual_Nm:.1f} µN·m")
    return "; ".join(parts)


def in_brief(contact: Contact) -> str:
    """Where and how hard, or why that is not known."""
    if contact.status not in LOCATED:
        return contact.reason
    distance, std = 1e3 * contact.distance_m, 1e3 * contact.distance_std_m
    return f"{distance:.2f} ± {std:.2f} mm from the clamp, {1e3 * np.linalg.norm(contact.force_N):.1f} mN"


def seen(item: FrameContact) -> str:
    """What was seen of the antenna."""
    if item.line is not None:
        return described(item.line)
    count = 0 if item.measured is None else len(item.measured.points_px)
    return f"{count} points from centrelines.csv, no picture"


CONTACT: Colour = (60, 220, 255)
_UNFITTED = ("no_contact", "no_antenna")
"""Statuses without a shape beside the free one to show."""
_RADIUS_95 = 2.448
"""In deviations: the ellipse of this size holds 95 % of a plane's normal distribution."""
_FORCE_SHARE = 0.15
"""Length of the force's arrow, of the antenna's."""
_CLOSE_UP, _CLOSE_UP_PX = 0.3, (8.0, 80.0)
"""The close-up's side, of the picture's shorter side, and how far it shows the contact's surroundings, px."""
_CLOSE_UP_LIGHT = 1.2
"""Factor on its grey levels."""
_SLOPE_STEP = 1e-5
"""Of the finite differences by a point, of its distance from the camera."""


@dataclass(frozen=True, eq=False)
class Marks:
    """Where a frame's contact lies in its picture, px.

    Attributes
    ----------
    shape : (M, 2) the fitted antenna; M is 0 where nothing was fitted. width : the antenna's.
    contact : (2,), NaN where it was not located. ellipse : (K, 2) around it, holds it with 95 % probability.
    force : (2,) head of the arrow from the contact along the force on the antenna.
    """

    shape: np.ndarray
    width: float
    contact: np.ndarray
    ellipse: np.ndarray
    force: np.ndarray

    @property
    def located(self) -> bool:
        """Whether there is a contact to draw."""
        return bool(np.isfinite(self.contact).all())


def corridor_of(rig: Rig, frame: Frame) -> Corridor | None:
    """Where the antenna may be in a frame's picture; None where the lens shows too little of it."""
    free = free_curve(rig.antenna.parameters, rig.antenna.length_m, gravity(rig, frame))
    where = corridor(rig.camera, rig.T_antenna_camera.inverse(), free, rig.antenna.diameter_m)
    return where if len(where.axis_px) >= LEAST_AXIS else None


def frame_picture(estimator: ContactEstimator, item: FrameContact) -> np.ndarray:
    """(H, W, 3) uint8, blue, green, red: a frame's picture with all that was seen and estimated drawn into it."""
    rig, frame, contact = estimator.rig, item.frame, item.contact
    width, height = rig.camera.image_size
    image = np.zeros((height, width), np.uint8) if frame.image is None else read_gray(frame.image)
    where = corridor_of(rig, frame)
    found = marks(estimator, item)
    grey = background(image, where)
    canvas = Canvas.over(grey)
    if where is not None:
        draw_corridor(canvas, where)
    draw(canvas, item, found)
    if where is not None:
        draw_clamp(canvas, where)
    if found.located:
        below = found.force[1] < found.contact[1]
        canvas.words("contact", found.contact, CONTACT, (9.0, 26.0 if below else -14.0))
        _close_up(canvas, grey, item, found)
    legend = strip(
        canvas.image.shape[1],
        canvas.unit,
        (contact.status, status_colour(contact.status)),
        (STATUSES[contact.status], f"frame {frame.frame}, {frame.time_s:.2f} s"),
        [numbers(contact), contact.reason, seen(item)],
        [*keys(item.line, where), *_keys(found)],
    )
    return np.vstack([canvas.image, legend])


def marks(estimator: ContactEstimator, item: FrameContact) -> Marks:
    """A frame's fitted shape, contact and force as they lie in its picture."""
    rig, contact = estimator.rig, item.contact
    T_camera_antenna = rig.T_antenna_camera.inverse()
    points = _fitted_m(estimator, item)
    shape = pixels(rig.camera, T_camera_antenna, points) if len(points) else np.empty((0, 2))
    width = width_px(rig.camera, T_camera_antenna, points, rig.antenna.diameter_m) if len(points) else 0.0
    if contact.status not in LOCATED:
        return Marks(shape, width, np.full(2, np.nan), np.empty((0, 2)), np.full(2, np.nan))
    head = contact.point_antenna_m + _FORCE_SHARE * rig.antenna.length_m * contact.force_N / max(
        float(np.linalg.norm(contact.force_N)), 1e-300
    )
    ends, _ = rig.camera.project(T_camera_antenna @ np.stack([contact.point_antenna_m, head]))
    rotation = rig.kinematics.T_world_antenna(item.frame.pan_rad, item.frame.tilt_rad).rotation
    return Marks(shape, width, ends[0], ellipse(rig, contact, rotation), ends[1])


def _fitted_m(estimator: ContactEstimator, item: FrameContact) -> np.ndarray:
    """(M, 3) the fitted antenna, antenna frame; M is 0 where nothing was fitted.

    The fit is done again, as it was: a picture is not worth keeping every fit of a recording for.
    """
    points = None
    if item.contact.status not in _UNFITTED:
        points = estimator.shape(item.measured)
    if points is None:
        return np.empty((0, 3))
    return points[np.isfinite(points).all(axis=1)]


def ellipse(rig: Rig, contact: Contact, rotation_world_antenna: np.ndarray) -> np.ndarray:
    """(49, 2) px: the picture of a located contact's covariance, which holds it with 95 % probability."""
    T_camera_antenna = rig.T_antenna_camera.inverse()
    point = T_camera_antenna @ contact.point_antenna_m
    turn = T_camera_antenna.rotation @ rotation_world_antenna.T
    slopes = _slopes(rig.camera, point) @ turn
    sizes, axes = np.linalg.eigh(slopes @ contact.covariance_world_m2 @ slopes.T)
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = _RADIUS_95 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(rig.camera.project(point[None])[0][0] + circle * np.sqrt(np.clip(sizes, 0.0, None)) @ axes.T)


def _slopes(camera: Camera, point_m: np.ndarray) -> np.ndarray:
    """(2, 3) px/m: how a camera-frame point's pixel moves with it."""
    step = _SLOPE_STEP * float(np.linalg.norm(point_m))
    ahead, behind = (camera.project(point_m + sign * step * np.eye(3))[0] for sign in (1.0, -1.0))
    return np.asarray((ahead - behind) / (2.0 * step)).T


def draw(canvas: Canvas, item: FrameContact, found: Marks, *, close: bool = False) -> None:
    """The fitted shape as a sleeve around the antenna, the seen centreline, the contact and its force."""
    if len(found.shape) >= 2:
        aside = normals(found.shape) * (0.5 * found.width + 3.5 * canvas.unit / canvas.scale)
        for side in (-aside, aside):
            canvas.line(found.shape + side, WHITE)
    if item.line is not None:
        draw_centreline(canvas, item.line, named=not close)
    else:
        canvas.graded(item.measured.points_px, sigma_colours(item.measured.sigma_px))
    if found.located:
        if not close:
            canvas.arrow(found.contact, found.force, CONTACT)
            canvas.ring(found.contact, 7.0, CONTACT, 2.0)
        canvas.line(found.ellipse, CONTACT, 2.0)


def _close_up(canvas: Canvas, grey: np.ndarray, item: FrameContact, found: Marks) -> None:
    """The contact's surroundings enlarged, in the corner that is farthest from the antenna."""
    rows, columns = canvas.image.shape[:2]
    size = int(_CLOSE_UP * min(rows, columns))
    reach = float(np.abs(found.ellipse - found.contact).max()) if len(found.ellipse) else 0.0
    radius = float(np.clip(max(2.0 * reach, 3.0 * found.width), *_CLOSE_UP_PX))
    part = canvas.cut(cv2.convertScaleAbs(grey, alpha=_CLOSE_UP_LIGHT), found.contact, radius, size)
    draw(part, item, found, close=True)
    corner = found.contact + np.array([-radius, radius])
    part.words(f"contact, {part.scale / canvas.scale:.0f} times larger", corner, CONTACT, (6.0, -6.0))
    cv2.rectangle(part.image, (0, 0), (size - 1, size - 1), CONTACT, 2)
    top, left = _free_corner(canvas, found, size)
    canvas.image[top : top + size, left : left + size] = part.image


def _free_corner(canvas: Canvas, found: Marks, size: int) -> tuple[int, int]:
    """Upper left corner (row, column) of a square in the corner of the canvas with the antenna farthest off."""
    rows, columns = canvas.image.shape[:2]
    corners = [(top, left) for top in (0, rows - size) for left in (0, columns - size)]
    taken = canvas.at(np.vstack([found.shape, found.contact, found.force]))
    middles = np.array([[left, top] for top, left in corners]) + 0.5 * size
    distance = np.abs(taken[None] - middles[:, None]).max(axis=-1)
    return corners[int(np.nan_to_num(distance, nan=np.inf).min(axis=1).argmax())]


def _keys(found: Marks) -> list[Key]:
    drawn = [Key("fitted shape, drawn around the antenna")] if len(found.shape) >= 2 else []
    if found.located:
        drawn += [Key("contact, 95 % ellipse", CONTACT, "ring"), Key("force on the antenna", CONTACT, "arrow")]
    return drawn


_PAGE = "index.html"
_OURS = '<meta name="generator" content="vbaa estimate --overlay">'
"""A folder whose page has this line may be replaced."""
_THUMBNAILS, _THUMBNAIL_WIDTH = "thumbnails", 320
_JPEG = [
    *(cv2.IMWRITE_JPEG_QUALITY, 92),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),  # thin coloured lines stay sharp
]


@dataclass(frozen=True)
class Entry:
    """One frame's line on the page: `name` of its picture without suffix, and what it says."""

    frame: int
    time_s: float
    status: str
    name: str
    words: str


def refuse_folder(path: Path, force: bool) -> None:
    """Raises InputError unless debug pictures may be written to `path`; a folder of other things is never replaced."""
    parent = Path(os.path.realpath(path)).parent
    if not parent.is_dir():
        raise InputError("its folder does not exist", where=path, remedy=f"create {path.parent} first")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError("its folder is read-only", where=path, remedy="write somewhere else")
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
    found: Iterable[FrameContact], estimator: ContactEstimator, path: Path, force: bool
) -> Iterator[Iterator[FrameContact]]:
    """The same frames, each drawn into the folder as it passes; the folder is there once all went well."""
    refuse_folder(path, force)
    with replacing_folder(path) as folder:
        (folder / _THUMBNAILS).mkdir()
        entries: list[Entry] = []
        yield _drawn(found, estimator, folder, entries)
        (folder / _PAGE).write_text(page(entries), encoding="utf-8")


def _drawn(
    found: Iterable[FrameContact], estimator: ContactEstimator, folder: Path, entries: list[Entry]
) -> Iterator[FrameContact]:
    for item in found:
        frame, status = item.frame, item.contact.status
        entry = Entry(frame.frame, frame.time_s, status, f"frame_{frame.frame:06d}_{status}", in_brief(item.contact))
        _write(frame_picture(estimator, item), estimator.rig.camera.image_size, folder, entry.name)
        entries.append(entry)
        yield item


def _write(image: np.ndarray, image_size: tuple[int, int], folder: Path, name: str) -> None:
    """The picture, and a thumbnail of its part above the legend."""
    rows = round(image.shape[1] * image_size[1] / image_size[0])
    small = (_THUMBNAIL_WIDTH, max(1, round(_THUMBNAIL_WIDTH * rows / image.shape[1])))
    thumbnail = cv2.resize(image[:rows], small, interpolation=cv2.INTER_AREA)
    for place, drawn in ((folder, image), (folder / _THUMBNAILS, thumbnail)):
        (place / f"{name}.jpg").write_bytes(cv2.imencode(".jpg", drawn, _JPEG)[1].tobytes())


def page(entries: list[Entry]) -> str:
    """The page: thumbnails in the order of the frames, and buttons that show one status alone. No scripts."""
    loader = jinja2.PackageLoader("estimator.contact", package_path="")
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    counts = Counter(entry.status for entry in entries)
    return environment.get_template("overlay.html.j2").render(
        generator=_OURS,
        entries=sorted(entries, key=lambda entry: entry.frame),
        counts={status: counts[status] for status in STATUS_COLOURS if counts[status]},
        meanings=STATUSES,
        colours=STATUS_COLOURS,
        thumbnails=_THUMBNAILS,
    )
