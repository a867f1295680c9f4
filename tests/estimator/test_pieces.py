"""A recording in pieces makes bit for bit the rows that it makes as a whole."""

from __future__ import annotations

from collections import Counter
from copy import deepcopy
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from estimator import ContactEstimator
from estimator.contact import estimate, pieces, recording, source
from estimator.contact.estimate import AFRESH, STREAM
from estimator.contact.pieces import cuts, learn, look, made, seam, solve
from estimator.contact.recording import FirstDetection
from estimator.contact.source import Source, estimate_source, open_source
from estimator.table.contacts import ContactRow
from estimator.table.files import write_contacts
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.whisker.centreline import NOTHING
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame, load_session

from ..recordings import write_recording, write_rig

OFTEN = AFRESH // 2
"""Frames after which the search begins afresh here, so that shorter recordings have pieces."""
FRAMES = OFTEN + 3 * STREAM + 1


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (estimate, pieces):
        monkeypatch.setattr(module, "AFRESH", OFTEN)


def in_pieces(path: Path, rig: Rig, most: int) -> list[ContactRow]:
    """Each piece by an estimator of its own, as another process would have it."""
    opened = open_source(path, rig)
    learnt, before, made_rows = None, None, []
    for piece in cuts(len(opened.frames), most):
        seen = look(ContactEstimator(rig), opened.cut(piece))
        known = learn(ContactEstimator(rig), seen, None if learnt is None else deepcopy(learnt))
        learnt = known[-1]
        found = solve(ContactEstimator(rig, jobs=2), seen, deepcopy(known))
        first, final = piece.start == 0, piece.stop == len(opened.frames)
        one = made(rig, opened.shutter, seen, found, first=first, final=final)
        made_rows += [*(seam(rig, opened.shutter, before, one) if before else ()), *one.rows]
        before = deepcopy(one)
    return made_rows


def as_one(path: Path, rig: Rig) -> list[ContactRow]:
    found = estimate_source(ContactEstimator(rig), open_source(path, rig))
    return [ContactRow.of(item.frame, item.contact) for item in found]


@pytest.mark.usefixtures("often")
@pytest.mark.parametrize(
    "frames",
    [
        OFTEN + 7,
        OFTEN + STREAM + 7,
        *(pytest.param(each, marks=pytest.mark.slow) for each in (FRAMES, FRAMES + 3 * OFTEN)),
    ],
)
def test_pieces_make_the_same_rows(tmp_path: Path, frames: int) -> None:
    """With drift that is learnt, motion and a rolling shutter across the seams."""
    path, rig = write_recording(tmp_path / "one", frames, rolling=True), Rig.load(write_rig(tmp_path / "rig.json"))
    whole = as_one(path, rig)
    parts = in_pieces(path, rig, OFTEN)
    write_contacts(tmp_path / "whole.csv", whole)
    write_contacts(tmp_path / "pieces.csv", parts)
    assert (tmp_path / "pieces.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    for own, other in zip(parts, whole, strict=True):
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in _floats(own, other))
    found = Counter(row.status for row in whole)
    assert len(whole) == frames
    assert min(found[name] for name in ("ok", "no_contact", "not_quasistatic")) > 20  # there is something to get wrong


def _floats(own: ContactRow, other: ContactRow) -> list[tuple[np.ndarray, np.ndarray]]:
    pairs = zip(vars(own).values(), vars(other).values(), strict=True)
    return [(np.asarray(a), np.asarray(b)) for a, b in pairs if np.asarray(a).dtype.kind == "f"]


@pytest.mark.usefixtures("often")
def test_what_the_first_free_frames_say_holds_for_all_pieces(tmp_path: Path) -> None:
    """The later pieces' contacts do depend on what the first one learnt: without it they differ."""
    path, rig = write_recording(tmp_path / "one", FRAMES), Rig.load(write_rig(tmp_path / "rig.json"))
    opened = open_source(path, rig)
    seen = look(ContactEstimator(rig), opened.cut(slice(OFTEN, OFTEN + STREAM)))
    first = look(ContactEstimator(rig), opened.cut(slice(0, OFTEN)))
    learnt = learn(ContactEstimator(rig), first, None)[-1]
    known, unknown = (solve(ContactEstimator(rig), seen, [each]) for each in (learnt, ContactEstimator(rig).drift))
    distances = [[contact.distance_m for contact in found[0].contacts] for found in (known, unknown)]
    assert learnt.frames > 0
    assert np.nanmax(np.abs(np.subtract(*distances))) > 1e-5


def test_the_frames_before_a_piece_tell_which_line_is_the_antenna(monkeypatch: pytest.MonkeyPatch) -> None:
    """And they are looked at only where they are needed, no further back than the last one that was certain."""
    path = np.stack([np.linspace(0.0, 100.0, 60), np.zeros(60)], axis=1)
    two = replace(NOTHING, verdict="ambiguous", reason="two", points_px=path, guide_px=path, other_line_px=path + 40.0)
    one = replace(two, verdict="ok", reason="", other_line_px=np.empty((0, 2)))
    lines = [one, NOTHING, two, two, NOTHING, two, two, one, two, NOTHING]
    looked = count()

    def first(_estimator: object, frame: Frame, _ground: object) -> FirstDetection:
        next(looked)
        return FirstDetection(frame, np.zeros((2, 2)), lines[frame.frame], None)

    monkeypatch.setattr(recording, "first_detection", first)
    monkeypatch.setattr(recording, "detections", lambda _, firsts: firsts)
    frames = [Frame(None, 0.0, 0.0, 0.0, frame=index, time_s=0.0) for index in range(len(lines))]
    whole = [each.line.verdict for each in recording.detected(None, frames)]  # type: ignore[arg-type]
    assert "ambiguous" not in whole
    for begin, needed in ((3, 3), (5, 5), (7, 0), (9, 0)):
        before = next(looked)
        part = [each.line.verdict for each in recording.detected(None, frames[begin:], earlier=frames[:begin][::-1])]  # type: ignore[arg-type]
        assert part == whole[begin:]
        assert next(looked) - before - 1 == len(lines) - begin + needed


def test_a_piece_of_pictures_has_few_of_the_frames_before_it_and_finds_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    frames = [Frame(None, 0.0, 0.0, 0.0, frame=index, time_s=float(index)) for index in range(10 * STREAM)]
    session = load_session(write_recording(tmp_path / "one", 1))
    for begin in (0, 3, STREAM, 5 * STREAM):
        part = Source(session, frames, None).cut(slice(begin, begin + 9))
        assert part.own()[0] == frames[begin : begin + 9]
        assert len(part.frames) <= STREAM + 9
        with monkeypatch.context() as patched:
            patched.setattr(source, "read_recording", lambda _: frames)
            assert [frame for frame, _ in part.earlier()] == frames[:begin][::-1]


def test_pieces_are_cut_where_the_search_begins_afresh() -> None:
    assert cuts(10, AFRESH) == [slice(0, 10)]
    assert [piece.start for piece in cuts(5000, 3 * AFRESH // 2)] == [0, 1024, 2048, 3072, 4096]
    with pytest.raises(InputError):
        cuts(10, AFRESH - 1)
