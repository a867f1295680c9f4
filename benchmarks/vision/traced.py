"""Path-traced sessions (`vbaa simulate --render mitsuba`): what is seen of the antenna, and the contacts that follow.

Each session is calibrated and estimated as a user would, by default flags; centrelines and contacts are held against
the session's labels and truth. `python -m benchmarks.vision.traced SESSION… --out FOLDER`.
"""

from __future__ import annotations

import argparse
import csv
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.harness import Draws, column, covered, rms, table, write_csv
from estimator.contact.estimate import ContactEstimator
from estimator.contact.overlay import corridor_of
from estimator.contact.recording import FrameContact, detect_again, estimate_pictures, first_detection
from estimator.table.contacts import LOCATED, Measured
from vbaa_calib.calibrate.pipeline import calibrate
from vbaa_calib.core.console import progress, say
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.files import read_json
from vbaa_calib.core.images import list_images, read_gray, read_picture
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.session import Frame, load_session, read_recording

from .judge import Score, score, steger, thinned, within
from .scenes import Truth, aside_px, normals

_MOST_SEEN = 0.9
"""Share of the visible antenna that has a point, for a picture to count as seen."""
_EMPTY_PER_PICTURE = 24
_TRUE_DRAWS = 16


@dataclass(frozen=True)
class TracedRow:
    """One session's recording.

    Attributes
    ----------
    seen : share of the pictures whose line is ok and has a point on nine tenths of the visible antenna.
    rms_px, of_sigma, neighbours : of the points that are not false: rms, rms over rms of the stated deviations, and
        correlation of the standardised errors of neighbours along the line. false : share of false points.
    located : of the frames in contact. distance_mm : rms error of their contact distance.
    of_true : over that of true centrelines with the noise that ours state. covered : distances within 1.96 deviations.
    thinning, steger : share of the visible antenna with a point within half a pixel, and share of points further off.
    empty, false_lines : pictures without an antenna, and how many of them show one that is ok.
    """

    session: str = column("session")
    pictures: int = column("pictures", "d")
    seen: float = column("seen %", ".0f", 100, default=np.nan)
    rms_px: float = column("rms px", ".3f", default=np.nan)
    of_sigma: float = column("× sigma", ".2f", default=np.nan)
    neighbours: float = column("neighbours", ".2f", default=np.nan)
    false: float = column("false %", ".2f", 100, default=np.nan)
    located: float = column("located %", ".0f", 100, default=np.nan)
    distance_mm: float = column("l rms mm", ".2f", default=np.nan)
    of_true: float = column("× true", ".2f", default=np.nan)
    covered: float = column("covered %", ".0f", 100, default=np.nan)
    thinning_kept: float = column("thinning kept %", ".0f", 100, default=np.nan)
    thinning_false: float = column("false %", ".0f", 100, default=np.nan)
    steger_kept: float = column("Steger kept %", ".0f", 100, default=np.nan)
    steger_false: float = column("false %", ".0f", 100, default=np.nan)
    empty: int = column("empty", "d", default=0)
    false_lines: int = column("ok", "d", default=0)


def neighbour_correlation(scores: Sequence[Score]) -> float:
    """Of standardised errors, with those of the next point along the line; false points left out."""
    first, second = [], []
    for one in scores:
        whitened = one.errors_px / np.maximum(one.sigma_px, 1e-9)
        both = ~(one.false[:-1] | one.false[1:])
        first.append(whitened[:-1][both])
        second.append(whitened[1:][both])
    a, b = np.concatenate(first), np.concatenate(second)
    return float((a * b).mean() / np.sqrt((a**2).mean() * (b**2).mean())) if len(a) else float("nan")


def read_labels(folder: Path) -> dict[str, Truth]:
    """The true centrelines of a session's pictures, by their names in the session."""
    rows: dict[str, list[tuple[float, float, bool]]] = {}
    with (folder / "labels" / "centrelines.csv").open(encoding="utf-8", newline="") as table_:
        for row in csv.DictReader(table_):
            rows.setdefault(row["image"], []).append((float(row["u_px"]), float(row["v_px"]), row["visible"] == "1"))
    return {
        name: Truth(np.array([one[:2] for one in seen]), np.array([one[2] for one in seen]))
        for name, seen in rows.items()
    }


def _distances(items: Sequence[FrameContact], true_m: Mapping[int, float | None]) -> tuple[np.ndarray, np.ndarray]:
    """(K,) errors (m) of the located contacts of frames that touch, and over their deviations."""
    errors = [
        (item.contact.distance_m - true, item.contact.distance_std_m)
        for item in items
        if (true := true_m[item.frame.frame]) is not None and item.contact.status in LOCATED
    ]
    off, std = np.array(errors).reshape(-1, 2).T
    return off, off / std


def _with_true_points(measured: Measured, label: Truth, rng: np.random.Generator) -> Measured:
    """The same frame with true points and the noise that its own ones state."""
    path = label.path_px
    _, nearest = aside_px(path, measured.points_px)
    noise = measured.sigma_px * rng.standard_normal(len(nearest))
    return replace(measured, points_px=path[nearest] + noise[:, None] * normals(path)[nearest])


def _turned(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The same picture turned, shifted and mirrored, so that the antenna would lie elsewhere in it."""
    height, width = image.shape[:2]
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), float(rng.uniform(0, 360)), 1.0)
    turn[:, 2] += rng.uniform(-0.3, 0.3, 2) * width
    turned = cv2.warpAffine(image, turn, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(cv2.flip(turned, 1) if rng.uniform() < 0.5 else turned)


def false_lines(
    estimator: ContactEstimator, frame: Frame, pictures: Sequence[Path], rng: np.random.Generator
) -> tuple[int, int]:
    """How many pictures without an antenna, each turned many ways, and how many show a line that is ok."""
    total = wrong = 0
    for path in pictures:
        image = read_picture(path)
        for _ in range(_EMPTY_PER_PICTURE):
            total, turned = total + 1, _turned(image, rng)
            first = first_detection(estimator, frame, turned)
            wrong += first.line.found and detect_again(estimator, [first])[0].line.found
    return total, wrong


def _peer(points: np.ndarray, label: Truth) -> Score:
    return score(Centreline(points, np.zeros(len(points)), 0.0, 0.0, 1.0), label)


def measure_session(folder: Path, seed: int = 0) -> TracedRow:
    """One session by default flags; a row without numbers where it cannot be calibrated."""
    # no two sessions see the same empty pictures
    session, rng = load_session(folder), np.random.default_rng([seed, zlib.crc32(folder.name.encode())])
    frames = read_recording(session)
    try:
        rig = calibrate(session).rig
    except (InputError, SolveError) as error:
        say(f"{folder.name}: not calibrated: {error}")
        return TracedRow(folder.name, len(frames), seen=0.0)
    estimator = ContactEstimator(rig)
    items = list(progress(estimate_pictures(estimator, frames), folder.name, len(frames)))
    known = read_labels(folder)
    labels = [known[Path(frame.image or "").relative_to(session.root).as_posix()] for frame in frames]
    true_m = {one["frame"]: one["distance_m"] for one in read_json(folder / "truth.json")["frames"]}
    lines = [item.line for item in items]
    scores = [score(line, label) for line, label in zip(lines, labels, strict=True) if line is not None]
    seen = [one.kept >= _MOST_SEEN and line is not None and line.found for one, line in zip(scores, lines, strict=True)]
    every = Draws([one for one, line in zip(scores, lines, strict=True) if line is not None and line.found])
    errors, sigma = every.errors_px[~every.false], every.sigma_px[~every.false]
    off, standardised = _distances(items, true_m)
    reference = []
    for _ in range(_TRUE_DRAWS):
        measured = [_with_true_points(item.measured, label, rng) for item, label in zip(items, labels, strict=True)]
        given = [replace(item, contact=contact) for item, contact in zip(items, estimator.run(measured), strict=True)]
        reference.append(_distances(given, true_m)[0])
    touching = sum(one is not None for one in true_m.values())
    thin, ridge = [], []
    for frame, label in zip(frames, labels, strict=True):
        assert frame.image is not None
        where, image = corridor_of(rig, frame), read_gray(frame.image)
        if where is None:
            continue
        mask = within(where, rig.camera.image_size)
        thin.append(_peer(thinned(image, mask), label))
        ridge.append(_peer(steger(image, mask > 0, where.width_px, bright=None), label))
    bare = folder / "empty"
    empty = false_lines(estimator, frames[0], list_images(bare), rng) if bare.is_dir() else (0, 0)
    return TracedRow(
        folder.name,
        len(frames),
        seen=float(np.mean(seen)),
        rms_px=rms(errors),
        of_sigma=rms(errors) / rms(sigma),
        neighbours=neighbour_correlation([one for one, ok in zip(scores, seen, strict=True) if ok]),
        false=float(every.false.mean()),
        located=len(off) / max(touching, 1),
        distance_mm=1e3 * rms(off),
        of_true=rms(off) / rms(np.concatenate(reference)),
        covered=covered(standardised),
        thinning_kept=float(Draws(thin).kept.mean()),
        thinning_false=float(Draws(thin).false.mean()),
        steger_kept=float(Draws(ridge).kept.mean()),
        steger_false=float(Draws(ridge).false.mean()),
        empty=empty[0],
        false_lines=empty[1],
    )


TITLE = (
    "path-traced recordings, rigs calibrated from their own pictures; seen: a point on nine tenths of the visible "
    "antenna; × true: over the same frames with true centrelines and the stated noise"
)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sessions", nargs="+", type=Path)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(argv)
    rows = []
    for folder in args.sessions:
        rows.append(measure_session(folder))
        say(table(rows[-1:], TITLE))
    say(table(rows, TITLE))
    if args.out is not None:
        write_csv(args.out / "vision_traced.csv", rows, force=True)


if __name__ == "__main__":
    main()
