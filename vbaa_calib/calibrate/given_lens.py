"""A lens from a file: it is read, gets a default covariance where the file has none, and is tested on new views."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from targets.board import Board, corner_points
from vbaa_calib.camera import Camera
from vbaa_calib.convert import guessed
from vbaa_calib.convert.values import Wanted
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import Diagnosis, InputError, Severity, VbaaError
from vbaa_calib.core.files import at, read_json, sha256
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.diagnose.boards import lens_reading_diagnoses
from vbaa_calib.geometry.covariance import independent_axes

from .check.boards import FOCUS, check_lens
from .check.finding import FAILS, HOLDS, Discrepancy
from .lens.board_shape import BoardShape
from .lens.intrinsics import LensSolution
from .lens.models import LENS_MODELS, DistortionModel, is_monotonic
from .lens.settings import LensSettings
from .lens.uncertainty import compensate, is_covered, pixel_grid, projection_jacobian
from .lens_from_views import solve_lens

_CONTRADICTED = "given_lens_contradicted"  # name of the diagnosis


@dataclass(frozen=True, eq=False)
class GivenLens:
    """A lens from a file, of any format that `vbaa convert` reads.

    camera : with its covariance. path : of the file. what : its format, in words. doubts : what the file itself says
    against its lens. assumed : the deviations that were assumed, in words; empty where the file states a covariance.
    other : of a file with two lenses, of raw and of rectified pictures, the one that was not asked for.
    """

    camera: Camera
    path: Path
    what: str
    doubts: tuple[Diagnosis, ...]
    assumed: str
    other: Camera | None = None

    @property
    def size_words(self) -> str:
        """First words of a message about the picture's size."""
        return f"the lens in {self.path.name} is for"

    def to_dict(self) -> dict[str, Any]:
        """The entry of rig.json."""
        uncertainty = f"assumed: {self.assumed}" if self.assumed else "stated in the file"
        return {"file": self.path.name, "format": self.what, "sha256": sha256(self.path), "uncertainty": uncertainty}


@validate_arguments
def read_lens(path: Path, wanted: Wanted | None = None) -> GivenLens:
    """The lens in a file.

    Raises InputError for a file that is none of those known, is broken, or has a lens that folds inside the picture.
    """
    path = Path(path)
    if path.is_dir():
        remedy = "convert it first: vbaa convert FOLDER -o camera.json"
        raise InputError("is a folder", where=path, remedy=remedy)
    form, wanted, other = guessed(path), wanted or Wanted(), None
    read = form.read(path, wanted)
    camera = read.camera
    if "rectified" in form.takes:
        with suppress(InputError):  # most state no projection
            other = form.read(path, replace(wanted, rectified=not wanted.rectified)).camera
    if not is_monotonic(_model_of(camera), camera.parameters, camera.image_size):
        what = f"its {_model_of(camera).name} lens folds inside the picture"
        raise InputError(what, where=path, remedy="calibrate the lens again, with a simpler --lens-model")
    if camera.model == "opencv" and not camera.distortion[12:].any():  # no tilt: the same lens without its two zeros
        kept = None if camera.covariance is None else camera.covariance[:16, :16]
        camera = replace(camera, distortion=camera.distortion[:12], covariance=kept, parameter_names=())
    std = 0.0 if camera.covariance is None else float(np.sqrt(camera.covariance[0, 0])) / camera.parameters[0]
    if std > LensSettings.vague_start:
        what = f"its focal length is known to {100 * std:.2g} % only"
        raise InputError(what, where=path, remedy="calibrate the lens again")
    remedy = "calibrate the lens with vbaa intrinsics where this is not meant"
    notes = tuple(Diagnosis("given_lens_note", f"{path.name}: {note}", remedy, "note") for note in read.notes)
    if camera.covariance is not None and std > 0.0:
        doubts = _own_doubts(path) if form.name == "vbaa" else ()
        return GivenLens(camera, path, form.what, (*doubts, *notes), "", other)
    camera, assumed = _with_assumed_covariance(camera, measured=wanted.rectified)
    return GivenLens(camera, path, form.what, notes, assumed, other)


def _model_of(camera: Camera) -> DistortionModel:
    # of several with as many coefficients the last one, in which all are free
    named = {(one.camera_model, one.distortion_count): one for one in LENS_MODELS.values()}
    return named[camera.model, len(camera.distortion)]


def _own_doubts(path: Path) -> tuple[Diagnosis, ...]:
    """The diagnoses that a camera.json or rig.json records of its lens."""
    data = read_json(path)
    lens = data if at(data, "grade") is not None else at(data, "quality", "lens")
    grade, verdict = at(lens, "grade"), at(lens, "verdict")
    if grade not in ("look at", "do not use"):
        return ()
    words = (
        f"{path.name} says of its lens: {verdict:.300}" if isinstance(verdict, str) else f"{path.name} says: {grade}"
    )
    severity: Severity = "wrong" if grade == "do not use" else "doubt"
    remedy = "calibrate the lens again, or mend what it names"
    return (Diagnosis("given_lens_doubted", words.rstrip("."), remedy, severity),)


def _with_assumed_covariance(camera: Camera, *, measured: bool = False) -> tuple[Camera, str]:
    """The camera with the covariance of a usual calibration, and a sentence on it. The errors of fx and fy are
    correlated, those of the coefficients independent; a lens without coefficients may have distortion, unless its
    pictures were rectified with `measured` ones."""
    measured |= bool(camera.distortion.any())
    corner_px = camera.image_size[0] * (
        LensSettings.corner_per_width if measured else LensSettings.uncorrected_per_width
    )
    if len(camera.distortion) < 4:
        camera = replace(camera, distortion=np.zeros(4), parameter_names=())
    width, focal = camera.image_size[0], camera.parameters[:2]
    std = np.zeros(len(camera.parameters))
    std[2:4] = LensSettings.centre_per_width * width
    moved = np.linalg.norm(
        projection_jacobian(camera, pixel_grid(camera.image_size, LensSettings.uncertainty_grid)), axis=-2
    )
    most = np.nanmax(moved.reshape(-1, len(std)), axis=0)
    # the corner's variance by each of k1, k2, p1, p2
    shares = np.sqrt([0.32, 0.32] if camera.model == "fisheye" else [0.32, 0.32, 0.18, 0.18])
    for index, share in enumerate(shares, start=4):
        std[index] = share * corner_px / most[index]
    covariance = np.diag(std**2)
    covariance[:2, :2] = LensSettings.focal_std**2 * np.outer(focal, focal)
    covariance[:2, :2] += (LensSettings.aspect_std / 2) ** 2 * np.outer(focal * (1, -1), focal * (1, -1))
    words = (
        f"one standard deviation of {100 * LensSettings.focal_std:g} % of the focal length, "
        f"{LensSettings.centre_per_width * width:.1f} px of the centre, {corner_px:.1f} px of distortion in the "
        "picture's corners"
    )
    return replace(camera, covariance=covariance), words


def given_solution(
    given: GivenLens, views: Sequence[BoardView], spec: Board, placed: Sequence[tuple[str, BoardView]] = ()
) -> LensSolution:
    """The known lens in the form of the lens step's solution. It is tested by the board's views, if any, and by the
    views that show plane C (`placed`, with their folders); the board's shape is solved from the former."""
    found, reasons = list(given.doubts), [f"The lens is the one in {given.path.name} ({given.what})."]
    if given.assumed:
        words = f"{given.path.name} states no uncertainty of its lens: assumed is {given.assumed}"
        remedy = (
            "leave --camera out: the pictures of the board determine the lens"
            if views
            else ("calibrate the lens with vbaa intrinsics, or put 15 pictures of the board into intrinsics/")
        )
        found.append(Diagnosis("lens_uncertainty_assumed", words, remedy))
    shape = BoardShape.unseen(spec)
    seen = [*views, *(view for _, view in placed)]
    misread = lens_reading_diagnoses((given.camera, given.other, seen, corner_points(spec)))
    found += [replace(one, words=f"{given.path.name}: {one.words}") for one in misread]
    if views:
        try:
            own = solve_lens(views, spec)
            contradiction, words = _contradiction(given, own, views)
            found += [contradiction] if contradiction and not misread else []
            shape = replace(own.board_shape, by_lens=None)
        except VbaaError as error:
            words = f"The pictures of the board cannot test it: {error}."
        reasons.append(words)
    if not misread and not any(one.name == _CONTRADICTED for one in found):
        words, remedy = f"{given.path.name} is contradicted by", "take the file of this lens as it is focused now"
        found += focus_changed(given.camera, placed, shape, Diagnosis(_CONTRADICTED, words, remedy))
    return LensSolution(given.camera, _model_of(given.camera).name, shape).with_diagnoses(found, reasons)


def focus_changed(
    camera: Camera, placed: Sequence[tuple[str, BoardView]], shape: BoardShape, what: Diagnosis
) -> list[Diagnosis]:
    """The diagnosis `what`, with the evidence added to its words, where views of the board on plane C (with their
    folders) contradict a lens; empty where they agree."""
    if not placed:
        return []
    focus = next(one for one in check_lens(camera, placed, shape, None)[0] if one.name == "lens_focus")
    if not focus.is_bad or focus.evidence is None:
        return []
    folders = " and ".join(f"{name}/" for name in dict.fromkeys(folder for folder, _ in placed))
    size = f"{focus.evidence.size:.2g} px over the picture, {focus.evidence.distance_std:.0f} standard deviations"
    severity: Severity = "wrong" if focus.level == FAILS else "doubt"
    # one view determines a part of the numbers only
    numbers = f" ({focus.words.partition(' against')[0]})" if focus.evidence.freedom == FOCUS else ""
    words = f"{what.words} the board in {folders}: {size}{numbers}"
    return [replace(what, words=words, remedy=f"{what.remedy}, or calibrate it again", severity=severity)]


def _contradiction(given: GivenLens, own: LensSolution, views: Sequence[BoardView]) -> tuple[Diagnosis | None, str]:
    """Whether the lens solved from the pictures contradicts the known one, and a sentence on it: χ² of the difference
    over the part of the picture that the views cover, net of camera rotation."""
    camera, other = given.camera, own.camera
    corners = np.concatenate([view.corners_px for view in views])
    pixels = pixel_grid(camera.image_size).reshape(-1, 2)
    pixels = pixels[is_covered(pixels, corners)]
    rays, _ = camera.unproject(pixels)
    moved, seen = other.project(rays)
    pixels, moved = pixels[seen], moved[seen]
    if len(pixels) < 3:
        return None, "The pictures of the board cover too little to test it."
    parts = [
        projection_jacobian(one, pixels) @ independent_axes(factor * one.covariance)
        for one, factor in ((camera, 1.0), (other, LensSettings.correlated**2))
        if one.covariance is not None
    ]
    difference, *parts = (compensate(camera, pixels, part) for part in ((moved - pixels)[..., None], *parts))
    axes, spread, _ = np.linalg.svd(np.concatenate(parts, axis=-1).reshape(2 * len(pixels), -1), full_matrices=False)
    known = spread > 1e-9 * spread[0]
    along = axes[:, known].T @ difference.ravel()
    deviation = np.hypot(spread[known], LensSettings.known_least_px * np.sqrt(len(pixels)))
    size_px = float(np.sqrt((difference**2).sum(axis=(1, 2)).mean()))
    distance = float(np.linalg.norm(along / deviation))
    evidence = Discrepancy(distance, int(known.sum()), size_px, LensSettings.known_floor_px, "px")
    expected_px = float(np.linalg.norm(deviation) / np.sqrt(len(pixels)))
    words = (
        f"{len(own.views)} pictures of the board have a lens that differs by {size_px:.2f} px rms where "
        f"they cover the picture ({expected_px:.2f} px expected)"
    )
    if evidence.level == HOLDS:
        return None, f"It holds: {words}."
    remedy = "leave --camera out to calibrate from these pictures; or take the right file, or pictures of this camera"
    severity: Severity = "wrong" if evidence.level == FAILS else "doubt"
    found = Diagnosis(_CONTRADICTED, f"{given.path.name} is contradicted: {words}", remedy, severity)
    return found, "The pictures of the board contradict it."
