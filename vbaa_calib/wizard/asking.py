"""The questions of a step: asking, storing and taking back answers; and adopting a session made without the wizard."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from targets.sheet import fill_in, lay_out, paper_named, spec_document
from targets.write_sheet import as_pdf
from vbaa_calib.calibrate.pose.board_pose import solve_board_pose
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError
from vbaa_calib.core.files import read_text, replacing, sha256, write_text
from vbaa_calib.core.images import list_images, read_gray, read_picture
from vbaa_calib.detect.board.board_file import load_board
from vbaa_calib.detect.drawing.canvas import Canvas
from vbaa_calib.session import SILENT, Session, load_session, read_loads, read_noload, read_sweep
from vbaa_calib.session.jig import jig_doubts
from vbaa_calib.sources import Picture
from vbaa_calib.wizard.questions import (
    BOARD_ANSWERS,
    BY_KEY,
    OF_LENS_FILE,
    OF_MATERIAL,
    PICTURES,
    QUESTIONS,
    READINGS,
    Answers,
    Question,
    asked,
    keeps_jig,
    split_line,
    typed,
)
from vbaa_calib.wizard.session_state import BOARD, SessionState, scale_of
from vbaa_calib.wizard.steps import PictureCheck, Step
from vbaa_calib.wizard.store import ARCHIVE, FOLDERS, WAYS, AcceptedPicture, Store
from vbaa_calib.wizard.ui import Interrupted, LivePicture, Ui

_SHEET = "board.pdf"
_VOIDS = {"board": BOARD_ANSWERS, "paper": [key for key in BOARD_ANSWERS if key != "board"], "material": OF_MATERIAL}
"""Answers that another one makes void."""
_JIG = {key for key in BY_KEY if key.startswith("jig_")} | {"board_thickness_mm"}


def take_back(store: Store, step: str) -> bool:
    """Remove a step's last answer and what depends on it; False if there is none. The answer becomes the question's
    default.

    The answer on the way to plane C stays while that way has pictures in its folder.
    """
    answers = store.journal.answers
    remaining = _open_questions(step, answers)
    before = QUESTIONS[: QUESTIONS.index(BY_KEY[remaining[0].key])] if remaining else QUESTIONS
    asked = [q for q in before if q.step == step and not q.usual]
    answered = [q.key for q in asked if q.key in answers and q.needed(answers)]
    if not answered or (step == "board" and answers.get("board_given")):
        return False
    last = answered[-1]
    if last == "plane_way" and store.journal.of(step).taken:
        return False
    gone = {last, *(_VOIDS.get(last, ()))}
    store.retracted |= {key: value for key, value in answers.items() if key in gone}
    store.forget_answers(gone)
    return True


def _keep_answer(store: Store, key: str, value: Any) -> None:
    """Store an answer; if it differs from the one that was taken back, drop what depended on that."""
    other = store.retracted.get(key, value) != value
    if other:
        store.offer_no_more(_VOIDS.get(key, ()))
    store.answer({key: value}, other)


def answer_all(state: SessionState, ui: Ui, step: Step) -> None:
    """Ask all open questions of a step; `back` asks the previous one again.

    Raises Interrupted for a command that leaves the step, InputError where nobody answers.
    """
    store = state.store
    while True:
        answers = store.journal.answers
        questions = _open_questions(step.name, answers)
        first = questions[0].key if questions else ""
        if step.name == "board" and "measure_x_mm" not in answers and first != "board":
            if answers["board"] == "new" and "paper" not in answers:
                _keep_answer(store, "paper", BY_KEY["paper"].default)
                answers = store.journal.answers
            # it is known which board it is: board.yaml, the sheet, and how long its print should be
            store.answer(_make_board(store, answers))
            if "board_along_x_mm" not in answers:
                ui.say(
                    f"print {store.root / _SHEET} at 100 % (not fitted to the page), glue it on something flat and "
                    "stiff, and measure its two rulers from end line to end line"
                    if answers["board"] == "new"
                    else "measure the print of your board"
                )
            _forget_if_inconsistent(store, ui)
            continue
        if not questions or (questions[0].key == "source" and not ui.interactive and state.taken(step.name)):
            _take_usual(store, ui, step)
            return
        question = questions[0]
        question = replace(question, default=store.retracted.get(question.key, question.default))
        new = answers.get("board", "new") == "new"
        facts = {
            "measured_x": "the ruler along the sheet's lower edge" if new else "the pattern along x, from edge to edge",
            "measured_y": "the ruler along the sheet's left edge" if new else "the pattern along y, from edge to edge",
            "measure_x_mm": answers.get("measure_x_mm", float("nan")),
            "measure_y_mm": answers.get("measure_y_mm", float("nan")),
        }
        if question.key == "jig_translation_mm":
            show_axes(state, ui)
        try:
            value = ui.ask(question, facts)
        except Interrupted as interrupt:
            kind = interrupt.command
            if kind in ("redo", "quit") or (kind == "back" and not take_back(store, step.name)):
                raise
            if kind != "back":
                ui.say(f"{kind} is for pictures, and they come after the questions")
            continue
        if question.key == "board" and (paper := re.fullmatch(r"new\s+(\S+)", str(value), re.IGNORECASE)):
            try:
                _keep_answer(store, "paper", BY_KEY["paper"].read(paper[1]))
            except InputError as error:
                ui.say(f"not taken: {error}")
                continue
            value = "new"
        if question.key in ("board", "source"):
            value = absolute(Path(), str(value))
        _keep_answer(store, question.key, value)
        _forget_if_inconsistent(store, ui)
        if (doubts := _typed_doubts(state, question.key)) and not ui.keeps(doubts):
            store.retracted[question.key] = value
            store.forget_answers({question.key})


def _typed_doubts(state: SessionState, key: str) -> list[Diagnosis]:
    """Doubts about an answer that need no picture."""
    if key == "jig_translation_mm" and (jig := state.session.T_antenna_board) is not None:
        return jig_doubts(jig, state.session.antenna.length_m)
    if key not in ("material", *OF_MATERIAL):
        return []
    return state.session.antenna.material_doubts


def show_axes(state: SessionState, ui: Ui, live: Picture | None = None) -> None:
    """Draw the board's axes into a picture, and store it in the session: into the jig's picture, with the antenna as
    the answers place it; or into the last lens picture while the board is not in the jig yet."""
    in_jig = state.taken("plane") if state.store.folder("plane") == "plane" else ()
    if not (taken := in_jig or state.taken("lens")):
        return
    image = read_gray(state.store.path(taken[-1])) if live is None else live.image
    try:
        path, drawn = _draw_axes(state, image, in_jig=bool(in_jig))
    except VbaaError:  # the lens does not explain the picture, which is reported elsewhere
        return
    where = "the board's axes and the antenna as the answers put it" if in_jig else "the board's x and y"
    words = f"{where} are drawn in {path}"
    ui.live(LivePicture(image, PictureCheck(), 0.0, words, live=False, drawn=drawn))
    if len(in_jig) < 2 or live is None:
        ui.say(f"{words}: look whether that is so" if in_jig else words)


def _take_usual(store: Store, ui: Ui, step: Step) -> None:
    """Answer with their defaults the questions that are not asked, and print them."""
    usual = _open_questions(step.name, store.journal.answers, usual=True)
    if not usual:
        return
    store.answer({one.key: one.read(store.retracted.get(one.key, one.default)) for one in usual})
    if ui.interactive:
        answers = store.journal.answers
        ui.take_usual([f"{one.key} = {typed(answers[one.key])}" for one in usual])


def change(state: SessionState, ui: Ui, key: str, value: str) -> bool:
    """Change an earlier answer; False if there is no such question."""
    store, question = state.store, BY_KEY.get(key)
    if found := re.fullmatch(r"(plane|noload|loads)_(\d+)", key):
        return _retype(state, ui, found[1], int(found[2]), value)
    if question is None:
        return False
    began = key == "plane_way" and store.journal.of("plane").taken
    if key in ("board", "paper") or began:
        ui.say(f"{key} is changed by redo: what rests on it starts again")
        return True
    try:
        answer = question.read(value)
        answer = absolute(Path(), answer) if key == "source" else answer
        check_together({**store.journal.answers, key: answer})
        store.answer({key: answer}, corrected=True)
        state.write_files()
    except InputError as error:
        ui.say(f"not changed: {error}")
        return True
    ui.say(f"{key} is {typed(answer)} {question.unit}".rstrip())
    if key == "material" and answer == "other":
        ui.say("type its youngs_modulus_GPa = … and density_kg_m3 = …, too")
    for doubt in _typed_doubts(state, key):
        ui.wrong(str(doubt))
    if key in _JIG:
        show_axes(state, ui)
    return True


def _retype(state: SessionState, ui: Ui, step: str, number: int, line: str) -> bool:
    """Replace the readings of a step's picture (number from 1) by a typed line, as for a new picture."""
    taken, folder = state.taken(step), state.store.folder(step)
    questions = asked(folder, [one.readings for one in taken[: number - 1]], state.session.columns)
    if not questions or not 0 < number <= len(taken):
        return False
    numbers = Question("readings", "", "", kind="numbers")
    try:
        readings = state.readings(step, split_line(questions, numbers.read(line)), f"{step}_{number}")
        state.store.correct(step, number - 1, readings)
        state.write_files()
    except InputError as error:
        ui.say(f"not changed: {error}")
        return True
    ui.say(f"{taken[number - 1].file}: {line}")
    return True


def _make_board(store: Store, answers: Mapping[str, Any]) -> dict[str, Any]:
    """Write board.yaml into the session, and a sheet to print if the board is new; returns the rulers' lengths, mm."""
    if answers["board"] != "new":
        spec = load_board(Path(str(answers["board"])))
        store.write(BOARD, spec_document(spec, f"from {answers['board']}").encode())
        return {f"measure_{axis}_mm": 1e3 * length_m for axis, length_m in zip("xy", spec.size_m, strict=True)}
    paper = paper_named(str(answers["paper"]))
    spec = fill_in(paper=paper)
    layout = lay_out(spec, paper)
    store.write(_SHEET, as_pdf(spec, layout))
    store.write(BOARD, spec_document(spec, f"as the wizard drew it in {_SHEET}").encode())
    return {"measure_x_mm": layout.ruler_x, "measure_y_mm": layout.ruler_y}


def absolute(folder: Path, text: str) -> str:
    """The absolute path of a file in `folder`; any other text as it is."""
    path = os.path.abspath(folder / text)
    if text == "new" or "://" in text or text.startswith("camera:") or not os.path.exists(path):
        return text
    return path


def _forget_if_inconsistent(store: Store, ui: Ui) -> None:
    """Drop contradictory answers so that they are asked again. Raises InputError in a run without a user."""
    try:
        check_together(store.journal.answers)
    except InputError as error:
        store.forget_answers({key.strip() for key in str(error.where).split(",")})
        if not ui.interactive:
            raise
        ui.wrong(f"{error.what}; {error.remedy}")


def check_together(answers: Mapping[str, Any]) -> None:
    """Raises InputError for answers that contradict each other, with their keys in `where`."""
    if answers.get("board") not in (None, "new") and "measure_x_mm" not in answers:
        try:
            load_board(Path(str(answers["board"])))
        except InputError as error:
            raise InputError(f"{error.where}: {error.what}", where="board", remedy=error.remedy) from None
    scale_of(answers)
    lone = [one.key for one in OF_LENS_FILE if one.key in answers]
    if lone and "camera" not in answers:
        remedy = "give camera, too"
        raise InputError("is about a lens file, of which there is none", where=", ".join(lone), remedy=remedy)
    ignored = [key for key in answers if key in _JIG and keeps_jig(answers)]
    if ignored:
        remedy = "give jig_translation_mm and the other answers about the jig too, or correct jig: in session.yaml"
        raise InputError("the jig is the one that session.yaml describes", where=ignored[0], remedy=remedy)
    x, y = answers.get("jig_board_x", ""), answers.get("jig_board_y", "")
    if x and x.lstrip("-") == y.lstrip("-"):
        what = f"the board's x runs along {x} and its y along {y}"
        raise InputError(what, where="jig_board_x, jig_board_y", remedy="the two are at right angles: answer anew")


def adopt(store: Store, ui: Ui) -> None:
    """Start from a session made without the wizard: its settings are answers, its pictures are accepted."""
    path = store.root / "session.yaml"
    if not store.is_new or not path.exists():
        return
    session, answers = load_session(store.root), SessionState.answers_of(path)
    inputs = store.root / ARCHIVE / "given"
    inputs.mkdir(parents=True, exist_ok=True)
    for file in (path, *(store.root / folder / f"{folder}.csv" for folder in READINGS)):
        if file.is_file():
            write_text(inputs / file.name, read_text(file))
    journal = store.journal.with_answers({**_make_board(store, answers), **answers})
    readers: Mapping[str, Callable[[Session], Sequence[Any]]] = {
        "noload": read_noload,
        "loads": read_loads,
        "sweep": read_sweep,
    }
    for step, words in PICTURES.items():
        folder = store.root / (FOLDERS.get(step) or WAYS.get(str(answers.get("plane_way")), "plane"))
        if not folder.is_dir():
            continue
        if folder.name in readers:
            rows = ((row.image, row) for row in readers[folder.name](session))
        else:
            rows = ((image, None) for image in list_images(folder))
        taken = tuple(_accepted(folder, image, row) for image, row in rows)
        if taken:
            journal = journal.with_step(step, taken=taken)
            ui.say(f"{len(taken)} pictures {words} are there already")
    # at once: a stop in between must not leave half of it unlisted
    store.save(journal)


def _accepted(folder: Path, image: Path, row: Any) -> AcceptedPicture:
    """An existing picture as an accepted one, with the readings in its table's `row`, if it has a table."""
    read_picture(image)
    if image.parent.resolve() != folder.resolve():
        raise InputError(
            f"lies outside {folder}", where=image, remedy="move it there, and correct its row in the table"
        )
    file = f"{folder.name}/{image.name}"
    read = {
        name: getattr(row, name, None)
        for name in ("pan_rad", "tilt_rad", *SILENT, "distance_m", "force_y_N", "force_z_N", "time_s")
    }
    readings = {name: value for name, value in read.items() if value is not None and not math.isnan(value)}
    return AcceptedPicture(file=file, source=image.name, sha256=sha256(image), readings=readings)


def archive_unlisted(store: Store, ui: Ui) -> None:
    """Move pictures that wizard.json does not list into another folder: an interruption left them, or someone put
    them there."""
    unlisted = store.unlisted()
    if unlisted:
        names = [path.relative_to(store.root).as_posix() for path in unlisted]
        place = store.archive(unlisted, "found")
        live = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        ui.say(f"not taken by the wizard, and set aside in {place}: {live}")


def _open_questions(step: str, answers: Answers, *, usual: bool = False) -> list[Question]:
    """The questions that a step has to ask after the answers so far; usual : instead those that it answers by
    default."""
    mine = (one.as_known(answers) for one in QUESTIONS if one.step == step)
    return [one for one in mine if one.usual == usual and one.key not in answers and one.needed(answers)]


def _draw_axes(state: SessionState, image: np.ndarray, in_jig: bool) -> tuple[Path, np.ndarray]:
    """The last picture (H, W) of the board in colour, with the board's x and y axes drawn, and in the jig the
    antenna as the entries place it; and the file to keep it in. Raises SolveError or InputError as the board's pose
    does."""
    lens, spec, length_m = state.lens(), state.board, state.session.antenna.length_m
    view = state.views("plane" if in_jig else "lens")[-1]
    T_camera_board = solve_board_pose([view], lens.board_shape, lens.camera).T_camera_board
    canvas, size = Canvas.over(image), 0.6 * spec.size_m[1]
    frames = [(T_camera_board, "board", {"x": [size, 0, 0], "y": [0, size, 0]})]
    if in_jig and state.session.T_antenna_board is not None:
        axes = {"x: the antenna": [length_m, 0, 0], "y": [0, size, 0], "z": [0, 0, size]}
        frames.append((T_camera_board @ state.session.T_antenna_board.inverse(), "antenna", axes))
    for pose, what, ends in frames:
        for (name, end), colour in zip(ends.items(), ((90, 90, 255), (120, 230, 120), (255, 190, 90)), strict=False):
            points = pose @ np.linspace(np.zeros(3), end, 41)
            _draw_axis(canvas, lens.camera, points, f"{what} {name}", colour)
    path = state.store.root / "jig.jpg"
    with replacing(path) as temporary:
        temporary.write_bytes(cv2.imencode(".jpg", canvas.image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes())
    return path, canvas.image


def _draw_axis(canvas: Canvas, camera: Camera, points_m: np.ndarray, name: str, colour: tuple[int, int, int]) -> None:
    pixels, valid = camera.project(points_m)
    inside = pixels[valid & camera.in_picture(pixels)]
    if len(inside) > 1:
        canvas.line(inside, (0, 0, 0), 4.0)
        canvas.line(inside, colour, 2.0)
        canvas.arrow(inside[-2], inside[-1], colour)
        canvas.words(name, inside[-1], colour)
