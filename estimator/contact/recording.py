"""From a recording on disk to contacts: from pictures one at a time, or from a stream of centrelines."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import chain, islice, tee
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from estimator.table.contacts import Contact, Measured
from vbaa_calib.core.arrays import MOMENT_REMEDY, PLAUSIBLE, Rows, check_each, spread_evenly
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import read_picture
from vbaa_calib.core.polyline import arc_lengths
from vbaa_calib.detect.whisker.acceptance import decided, explained, of_antennas_shape
from vbaa_calib.detect.whisker.centreline import NOTHING, Centreline
from vbaa_calib.detect.whisker.corridor import Corridor, corridor, free_curve, pixels, width_px
from vbaa_calib.detect.whisker.finder import AntennaFinder, finder, same_paths_m_s2
from vbaa_calib.detect.whisker.paint import without_other_things
from vbaa_calib.rig import Rig
from vbaa_calib.session import READINGS, Centrelines, Frame, Session, Still, numbers_of, pictures_of, read_centrelines

from .contacts import Contacts
from .estimate import STREAM, ContactEstimator
from .inputs import Batch, OutlierSettings, outside, point_scatter
from .settings import ContactSettings

if TYPE_CHECKING:
    from vbaa_calib.detect.whisker.background import Background

Ground: TypeAlias = "Callable[[Still, str], Background | None]"
"""What lies behind the antenna in a camera's picture, by its name, as far as it is known."""
FramePictures: TypeAlias = "np.ndarray | Mapping[str, np.ndarray] | None"
"""A frame's picture (H, W[, 3]); of several cameras those by name."""


@dataclass(frozen=True, eq=False)
class FrameContact:
    """A frame and its estimated contact.

    Attributes
    ----------
    line : what was seen in its picture; None where ready centrelines took the place of pictures. others : of several
        cameras what was seen in each one's, by name.
    measured : what the contact was fitted to.
    antenna : its name, where there are several, or where its clamp moves; clamp (4,) is then the clamp's position in
        the world, m, and its angle in plane C, rad.
    """

    frame: Frame
    contact: Contact
    measured: Measured
    line: Centreline | None = None
    others: Mapping[str, Centreline] = field(default_factory=dict)
    antenna: str = ""
    clamp: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class _FirstDetection:
    """A frame, its picture (H, W) on the plane of paint, the first detection in it, whether the antenna is brighter
    than its background; and, where the antenna can be in view, the original picture (H, W[, 3]), its detector, and
    whether the background was subtracted."""

    frame: Frame
    image: np.ndarray
    line: Centreline
    bright: bool | None
    picture: np.ndarray | None = None
    looking: AntennaFinder | None = None
    bare: bool = False


@dataclass(frozen=True, eq=False)
class Detection:
    """The detected antenna in a picture, and the measurement from it.

    others : of several cameras what each saw, by name.
    """

    line: Centreline
    measured: Measured
    others: Mapping[str, Centreline] = field(default_factory=dict)

    @staticmethod
    def together(rig: Rig, several: Sequence[Detection]) -> Detection:
        """The detections of all of a rig's cameras in one frame, as one."""
        first, *rest = several
        others = dict(zip(rig.others, (each.measured for each in rest), strict=True))
        starts = [each.measured.start for each in several if np.isfinite(each.measured.start).all()]
        measured = replace(first.measured, others=others, start=starts[0] if starts else first.measured.start)
        return Detection(first.line, measured, dict(zip(rig.cameras, (each.line for each in several), strict=True)))


def gravity(rig: Rig, frame: Still) -> np.ndarray:
    """(3,) gravity in the antenna frame."""
    return rig.kinematics.world_antenna(frame.pan_rad, frame.tilt_rad)[0].T @ rig.gravity_world_m_s2


def measured(rig: Rig, frame: Frame, line: Centreline, **more: Any) -> Measured:
    """A centreline as a measurement, with the standard deviations of this rig's pictures, and its end where that is
    the tip."""
    changing = rig.image.paint.polarity is None
    share = ContactSettings.least_noise_changing if changing else ContactSettings.least_noise
    least = share * rig.image.noise_px
    sigma = np.hypot(np.maximum(line.effective_px * rig.image.noise_scale, least), line.row_px)
    if line.end == "tip":
        more["tip_px"] = np.array([*line.end_px, line.end_std_px])
    return _measured(frame, line.points_px, sigma, **more)


def _measured(frame: Frame, points_px: np.ndarray, sigma_px: np.ndarray, **more: Any) -> Measured:
    """The measurement of points (N, 2) with standard deviations (N,) and the frame's readings."""
    for name in ("moment_errors_Nm", "joint_errors_rad"):
        if any(errors := getattr(frame, name)):
            more[name] = np.array(errors)
    more |= {name: getattr(frame, name) for name in islice(READINGS.values(), 1, None)}
    return Measured(points_px, sigma_px, frame.moment_Nm, frame.pan_rad, frame.tilt_rad, time_s=frame.time_s, **more)


def prepared(rig: Rig, frame: Still) -> AntennaFinder | None:
    """The antenna detector for these joint angles; None where the lens cannot project the antenna."""
    pull = gravity(rig, frame).tolist()
    near, alike = (
        tuple(step * round(g / step) for g in pull)
        for step in (ContactSettings.same_gravity_m_s2, _same_paths_m_s2(rig))
    )
    return _finder(rig, near, alike)


@lru_cache(maxsize=256)
def _finder(rig: Rig, pull_m_s2: tuple[float, ...], paths_m_s2: tuple[float, ...]) -> AntennaFinder | None:
    """The antenna detector for this gravity (antenna frame), with the search paths tabulated for a similar one."""
    where = _corridor(rig, pull_m_s2)
    shape_px = max(ContactSettings.shape_px, ContactSettings.shape_widths * where.width_px)
    drift, focal = rig.drift, 0.5 * (rig.camera.matrix[0, 0] + rig.camera.matrix[1, 1])
    depth_m = max(float(rig.T_antenna_camera.inverse().translation_m[2]), 1e-3)
    drifted = (focal * drift.camera_turn_rad, focal * drift.camera_shift_m / depth_m, drift.picture_shift_px)
    clamp_px = float(np.hypot(ContactSettings.clamp_px, ContactSettings.drifted * np.linalg.norm(drifted)))
    where = replace(where, clamp_px=clamp_px, clamp_rad=ContactSettings.clamp_rad, shape_px=shape_px)
    found = finder(where, rig.camera, _tabled(rig, paths_m_s2))
    if found is None:
        return None
    looks = np.empty((0, 4)) if rig.image.looks is None else np.array(rig.image.looks)
    return replace(found.with_usual_height(rig.image.height or 0.0), looks=looks)


def _corridor(rig: Rig, pull_m_s2: tuple[float, ...]) -> Corridor:
    free = free_curve(rig.antenna.parameters, rig.antenna.length_m, np.array(pull_m_s2), rig.antenna.taper)
    antenna = rig.antenna
    return corridor(rig.camera, rig.T_antenna_camera.inverse(), free, antenna.diameter_m, taper=antenna.taper)


@lru_cache(maxsize=64)
def _tabled(rig: Rig, pull_m_s2: tuple[float, ...]) -> AntennaFinder | None:
    return finder(_corridor(rig, pull_m_s2), rig.camera)


@lru_cache(maxsize=8)
def _same_paths_m_s2(rig: Rig) -> float:
    """Resolution of gravity within which the same search paths are used."""
    where = _corridor(rig, (0.0, 0.0, 0.0))
    return max(
        same_paths_m_s2(where, rig.antenna.parameters, rig.antenna.length_m, rig.antenna.taper),
        ContactSettings.same_gravity_m_s2,
    )


def detect_again(estimator: ContactEstimator, firsts: Sequence[_FirstDetection]) -> list[Detection]:
    """Measures the antenna of each picture again along the shape of the first detection, unless that was certain.

    A line that was seen only in part, or twice, is not fitted, and so not measured again. Nor is one seen from the
    clamp to its tip, which a second measurement would not move.
    """
    rig = estimator.rig
    found = [
        Detection(each.line, measured(rig, each.frame, each.line if each.line.found else NOTHING)) for each in firsts
    ]
    unsure = [index for index, each in enumerate(firsts) if each.line.found and not _sure(each)]
    shapes = estimator.rough([found[index].measured for index in unsure]) if unsure else []
    for index, rough in zip(unsure, shapes, strict=True):
        if rough is not None:
            found[index] = _along(rig, firsts[index], *rough)
    return found


def _sure(detected: _FirstDetection) -> bool:
    """Whether a line of one polarity was detected from the clamp to its tip with hardly a gap."""
    line = detected.line
    if detected.bright is None or line.end != "tip":
        return False
    seen = line.measured
    last = len(seen) - int(seen[::-1].argmax())
    return float(seen[:last].mean()) >= ContactSettings.sure_detection


def _along(rig: Rig, detected: _FirstDetection, unknowns: np.ndarray, points_m: np.ndarray) -> Detection:
    seen_from = (rig.camera, rig.T_antenna_camera.inverse(), points_m)
    guide, width = pixels(*seen_from), width_px(*seen_from, rig.antenna.diameter_m * rig.antenna.taper.middle)
    assert detected.looking is not None
    picture = detected.image if detected.bare else detected.picture
    again = detected.looking.along(detected.image, guide, width, detected.bright, picture, detected.line.odds)
    if detected.picture is not None:
        again = without_other_things(detected.picture, again, rig.image.looks, width, rig.image.paint)
    where, changing = detected.looking.corridor, detected.bright is None
    # whatever was left out of the first look, since it was judged
    line = of_antennas_shape(detected.line, where, changing) if changing else detected.line
    if len(again.points_px) >= ContactSettings.second_detection * len(line.points_px):
        first, line = line, of_antennas_shape(again, where, changing)
        if line.found and changing:
            farther_px = arc_lengths(first.points_px)[-1] - arc_lengths(again.points_px)[-1]
            if first.found and line.seen < first.seen and farther_px < ContactSettings.farther_widths * width:
                line = first
    # what is doubted on a closer look, though not on the first, makes no contact
    return Detection(line, measured(rig, detected.frame, line if line.found else NOTHING, start=unknowns))


def _detections(estimator: ContactEstimator, firsts: Iterable[_FirstDetection]) -> Iterator[Detection]:
    """Second detections of pictures in order, as many at a time as memory allows."""
    coming = iter(firsts)
    for first in coming:
        most = min(ContactSettings.at_once_px // first.image.size, STREAM)
        yield from detect_again(estimator, [first, *islice(coming, max(most - 1, 0))])


def read_own(rig: Rig, path: Path) -> np.ndarray:
    """A picture of this rig's camera. Raises InputError when it cannot be read or has another size."""
    image = read_picture(path)
    if image.shape[1::-1] != tuple(rig.camera.image_size):
        size, calibrated = ("x".join(map(str, each)) for each in (image.shape[1::-1], rig.camera.image_size))
        raise InputError(
            f"is {size}, the rig's camera {calibrated}", where=path, remedy="use the resolution of the calibration"
        )
    return image


def read_ahead(rig: Rig, frames: Iterable[Frame]) -> Iterator[tuple[Frame, FramePictures]]:
    """Frames with their pictures, if any; a thread reads the next few ahead.

    Raises InputError, in order, for a picture that cannot be read or has another size.
    """

    cameras = rig.cameras

    def read(frame: Frame) -> FramePictures:
        if not rig.others:
            return None if frame.image is None else read_own(rig, frame.image)
        paths = {rig.camera_name: frame.image, **frame.others}
        return {name: read_own(one, path) for name, one in cameras.items() if (path := paths.get(name)) is not None}

    with ThreadPoolExecutor(1) as reader:
        coming = ((one, reader.submit(read, one)) for one in frames)
        waiting = deque(islice(coming, ContactSettings.pictures_ahead))
        while waiting:
            frame, pictures = waiting.popleft()
            yield frame, pictures.result()
            waiting.extend(islice(coming, 1))


def first_detection(
    estimator: ContactEstimator, frame: Frame, picture: np.ndarray | None, ground: Ground | None = None
) -> _FirstDetection:
    """First detection in a frame's picture (H, W[, 3]) of the rig's size, with a known background subtracted where
    that helps. picture : None where only another camera took one."""
    rig, paint = estimator.rig, estimator.rig.image.paint
    if picture is None:
        none = replace(NOTHING, reason="there is no picture")
        return _FirstDetection(frame, np.zeros((1, 1), np.uint8), none, paint.polarity)
    bright, image = paint.polarity, paint.plane(picture)
    known = math.isfinite(frame.pan_rad + frame.tilt_rad)
    looking = prepared(rig, frame) if known else None
    if looking is None:
        why = NOTHING.reason if known else "no joint angles were read near enough to the picture's instant"
        return _FirstDetection(frame, image, replace(NOTHING, reason=why), bright)
    less = subtracted(looking, image, None if ground is None else ground(frame, rig.camera_name))
    if less is not None and less[1].found:
        image, line, bright, bare = *less, None, True
    else:
        line, bare = explained(paint.find(looking, picture, image), image, looking.corridor, bright), False
    line = without_other_things(picture, line, rig.image.looks, looking.corridor.width_px, paint)
    return _FirstDetection(frame, image, line, bright, picture, looking, bare)


def subtracted(
    looking: AntennaFinder, image: np.ndarray, empty: Background | None
) -> tuple[np.ndarray, Centreline] | None:
    """A picture (H, W) less its background, and the first detection in it; None where the background is unknown or
    does not match this picture."""
    behind = None if empty is None else empty.behind(image)
    if behind is None:
        return None
    line = replace(looking, looks=looking.looks[:0]).find(image - behind, None)
    from vbaa_calib.detect.whisker.background import evened  # loads OpenCV

    return evened(image, behind, line, looking.corridor.width_px), line


def _in_order(estimator: ContactEstimator, firsts: Iterable[_FirstDetection]) -> Iterator[_FirstDetection]:
    """First detections in order; between two possible lines the previous frame decides. Until an antenna has been
    found, some pictures are also searched mirrored and rotated."""
    before, left = np.empty((0, 2)), ContactSettings.turned_looks
    for first in firsts:
        decided_one, before = after(first, before)
        left = 0 if len(before) else left
        if left and first.looking is not None and first.picture is not None:
            decided_one, left = _turned(estimator, decided_one), left - 1
        yield decided_one


def _turned(estimator: ContactEstimator, first: _FirstDetection) -> _FirstDetection:
    """A detection without an antenna, with its reason naming the rotation of the picture in which one is found, if
    any."""
    paint, looking, picture = estimator.rig.image.paint, first.looking, first.picture
    assert looking is not None
    assert picture is not None
    for words, rows, columns in ContactSettings.turned:
        other, image = (np.ascontiguousarray(each[::rows, ::columns]) for each in (picture, paint.plane(picture)))
        line = explained(paint.find(looking, other, image), image, looking.corridor, first.bright)
        if line.found:
            reason = f"{first.line.reason}; there is one if {words}"
            return replace(first, line=replace(first.line, reason=reason))
    return first


def after(first: _FirstDetection, before: np.ndarray) -> tuple[_FirstDetection, np.ndarray]:
    """A first detection, decided by the antenna's points (N, 2) in the previous frame, and its points now."""
    line = decided(first.line, before)
    return replace(first, line=line), line.guide_px if line.found else before


def estimate_pictures(
    estimator: ContactEstimator, frames: Sequence[Frame], ground: Ground | None = None
) -> Iterator[FrameContact]:
    """The contacts of frames from their pictures, in order, as many at a time as the estimator takes. Raises as
    `read_ahead`."""
    return estimate_taken(estimator, read_ahead(estimator.rig, frames), ground)


def estimate_taken(
    estimator: ContactEstimator, taken: Iterable[tuple[Frame, FramePictures]], ground: Ground | None = None
) -> Iterator[FrameContact]:
    """The contacts of frames with pictures of the rig's sizes, in order, in constant memory."""
    frames: deque[Frame] = deque()  # those whose contacts are still to come

    def noted() -> Iterator[tuple[Frame, FramePictures]]:
        for frame, pictures in taken:
            frames.append(frame)
            yield frame, pictures

    asked, kept = tee(detected(estimator, noted(), ground))
    for seen, contact in zip(kept, estimator.run(each.measured for each in asked), strict=True):
        yield frame_contact(frames.popleft(), seen, contact)


def frame_contact(frame: Frame, seen: Detection, contact: Contact) -> FrameContact:
    """A frame's contact, or the reason why nothing was detected in its picture."""
    answer = contact if seen.line.found or seen.others else replace(contact, reason=seen.line.reason)
    for name, line in seen.others.items():
        if not line.found:
            answer = replace(answer, reason=answer.reason.replace(f"{name} shows no antenna", f"{name}: {line.reason}"))
    return FrameContact(frame, answer, seen.measured, seen.line, seen.others)


def measured_recording(
    estimator: ContactEstimator, session: Session, frames: Sequence[Frame], ground: Ground | None = None
) -> Iterator[Measured]:
    """The measurements of every frame of a session's recording, in order, as `estimate_source` uses them."""
    if not pictures_of(frames):
        lines = read_centrelines(session).checked(frames, "recording.csv")
        return measured_lines(estimator.rig, frames, lines)
    return (each.measured for each in detected(estimator, read_ahead(estimator.rig, frames), ground))


def detected(
    estimator: ContactEstimator, taken: Iterable[tuple[Frame, FramePictures]], ground: Ground | None = None
) -> Iterator[Detection]:
    """The detections in the pictures of frames, in order, camera by camera."""
    rig = estimator.rig
    if rig.others:
        parts = list[Iterator[Detection]]()
        for (name, one), each in zip(estimator.cameras.items(), tee(taken, 1 + len(rig.others)), strict=True):
            parts.append(detected(one, _of_camera(each, name), ground))
        return (Detection.together(rig, several) for several in zip(*parts, strict=True))
    firsts = (first_detection(estimator, frame, cast("np.ndarray | None", one), ground) for frame, one in taken)
    return _detections(estimator, _in_order(estimator, firsts))


def _of_camera(taken: Iterable[tuple[Frame, FramePictures]], name: str) -> Iterator[tuple[Frame, FramePictures]]:
    """Frames with the pictures of one of several cameras."""
    for frame, pictures in taken:
        yield frame, pictures.get(name) if isinstance(pictures, Mapping) else pictures


def estimate_picture(estimator: ContactEstimator, frame: Frame, ground: Ground | None = None) -> FrameContact:
    """The contact of one frame from its picture, as `estimate_pictures` but without the motion test."""
    return next(estimate_taken(estimator, [(frame, read_own(estimator.rig, cast(Path, frame.image)))], ground))


def measured_lines(rig: Rig, frames: Sequence[Frame], lines: Mapping[int, np.ndarray]) -> Iterator[Measured]:
    """The measurements of every frame from extracted pixels, by frame (N, 3): u_px, v_px, sigma_px or NaN.

    Standard deviations that are absent are the points' own scatter, or the rig's pictures' where too little is seen;
    those that are far smaller than it are widened to it.
    """
    if rig.others:
        others = getattr(lines, "others", {})
        parts = [measured_lines(replace(rig, others={}), frames, lines)]
        parts += [measured_lines(one, frames, others.get(name, {})) for name, one in rig.others.items()]
        for first, *rest in zip(*parts, strict=True):
            yield replace(first, others=dict(zip(rig.others, rest, strict=True)))
        return
    absent_px, factor = _scatter(rig, frames, lines)
    coming = iter(frames)
    while some := list(islice(coming, STREAM)):
        every = [lines.get(frame.frame, np.empty((0, 3))) for frame in some]
        whole = np.concatenate(every)
        left_out = outside(whole[:, :2], rig.camera.image_size)
        sigma, end = np.where(np.isfinite(whole[:, 2]), factor * whole[:, 2], absent_px), 0
        for frame, points in zip(some, every, strict=True):
            own = slice(end, end := end + len(points))
            lost = int(left_out[own].sum())
            kept = (points[:, :2], sigma[own]) if not lost else (points[~left_out[own], :2], sigma[own][~left_out[own]])
            yield _measured(frame, *kept, outside_points=lost, sigma_factor=factor)


def _scatter(rig: Rig, frames: Sequence[Frame], lines: Mapping[int, np.ndarray]) -> tuple[float, float]:
    """Scatter, px, of points without a standard deviation; and the ratio of the others' scatter to their stated
    standard deviations, 1 where these are about right."""
    settings = OutlierSettings()
    chosen = spread_evenly(len(frames), settings.scatter_frames)
    some = [lines.get(frames[row].frame, np.empty((0, 3))) for row in chosen]
    some = [each[~outside(each[:, :2], rig.camera.image_size)] for each in some]
    stated = [each for each in some if np.isfinite(each[:, 2]).all()]
    absent = [each for each in some if not np.isfinite(each[:, 2]).any()]
    own_px = point_scatter([each[:, :2] for each in absent], [np.ones(len(each)) for each in absent])
    factor = point_scatter([each[:, :2] for each in stated], [each[:, 2] for each in stated])
    return own_px if own_px > 0.0 else rig.image.noise_px, factor if factor > settings.tolerated else 1.0


def estimate_together(
    estimator: ContactEstimator, frames: Sequence[Frame], lines: Mapping[int, np.ndarray]
) -> Iterator[tuple[slice, Batch, Contacts]] | None:
    """As `estimate_centrelines`, many frames at a time: which ones, their measurements, and their contacts. None for
    a rig with several cameras, and where frames have more than plain numbers."""
    rig = estimator.rig
    if rig.others or not isinstance(lines, Centrelines) or not isinstance(frames, Rows):
        return None
    columns = {name: numbers_of(frames, name) for name in (*READINGS.values(), "pan_rad", "tilt_rad", "time_s")}
    for name in READINGS.values():
        check_each(columns[name], PLAUSIBLE.moment_Nm, name, MOMENT_REMEDY)
    if not rig.moment_sensor.exists and np.isfinite(columns["moment_Nm"]).any():
        return None

    numbers, (absent_px, factor), taken = numbers_of(frames), _scatter(rig, frames, lines), list[Batch]()

    def batches() -> Iterator[Batch]:
        # the free ones of a few say how the rig has changed for the next
        most = STREAM if rig.drift.of_rig else ContactSettings.chunk
        for begin in range(0, len(frames), most):
            own = slice(begin, begin + most)
            points, counts = lines.together(numbers[own])
            points[:, 2] = np.where(np.isfinite(points[:, 2]), factor * points[:, 2], absent_px)
            batch = Batch.of_lines(rig, points, counts, {name: each[own] for name, each in columns.items()})
            taken.append(replace(batch, sigma_factor=factor))
            yield taken[-1]

    def found() -> Iterator[tuple[slice, Batch, Contacts]]:
        begin, parts = 0, list[Contacts]()
        for contacts in chain(estimator.run_together(batches()), [None]):
            parts += [] if contacts is None else [contacts]
            if parts and (contacts is None or sum(map(len, parts)) >= ContactSettings.chunk):
                several, whole = Contacts.joined(parts), Batch.padded(taken)
                end = begin + len(several)
                yield slice(begin, end), whole.picked(slice(0, end - begin)), several
                begin, parts, taken[:] = end, [], [whole.picked(slice(len(several), None))]

    return found()


def estimate_centrelines(
    estimator: ContactEstimator, frames: Sequence[Frame], lines: Mapping[int, np.ndarray]
) -> Iterator[FrameContact]:
    """The contacts of frames from extracted pixels (see `measured_lines`), in order, as many at a time as the
    estimator takes."""
    # a tee holds no more than what the estimator has taken in and not yet given back
    asked, kept = tee(measured_lines(estimator.rig, frames, lines))
    for frame, seen, contact in zip(frames, kept, estimator.run(asked), strict=True):
        yield FrameContact(frame, contact, seen)
