"""The wizard's page: what the terminal says in words, with the live picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import cv2
import numpy as np

from vbaa_calib.wizard.state.catalogue import STEPS
from vbaa_calib.wizard.state.questions import Question, typed
from vbaa_calib.wizard.state.session_state import SessionState
from vbaa_calib.wizard.steps.step import Progress, Step, counted

from .base import LiveView
from .server import PageServer

_COLUMNS, _ROWS = 12, 8
_LOG_LINES = 60
_WIDEST_PX = 1280
_NOT_STILL: dict[str, Any] = {"hold": 0.0, "suggested_px": None, "suggestion": "", "closeness": None, "hints": []}


class Page:
    """What is on the page now. titles : of the steps by name."""

    def __init__(self, state: SessionState, titles: Mapping[str, str], port: int = 0) -> None:
        self._state, self._titles, self._server = state, titles, PageServer(port)
        self._step: Step | None = None
        self._progress = Progress()
        self._shown: dict[str, Any] = dict.fromkeys(("question", "live", "verdict", "report")) | {"log": []}
        self._jpeg: bytes | None = None
        self._doing = ""
        # numbers of states: the last one; the first that commands may be meant for; the first with the question
        self._number = self._commands_from = self._answers_from = 0

    @property
    def url(self) -> str:
        """To open in a browser on this machine."""
        return self._server.url

    def take_commands(self) -> list[tuple[str, Any]]:
        """Commands and answers since the last call, but for those that were meant for what was there before."""
        taken: list[tuple[str, Any]] = []
        for command in self._server.take_commands():
            seen = self._number if command.seen is None else command.seen
            if command.kind == "answer":
                fits = self._shown["question"] is not None and seen >= self._answers_from
            else:
                late = seen < self._commands_from and command.kind not in ("take", "quit")
                fits = command.kind in self._possible() and not late
            if fits:
                taken.append((command.kind, command.value))
                # a second click came before the page showed what the first one did
                self._commands_from = self._number + 1
        return taken

    def _possible(self) -> list[str]:
        """The commands that make sense now."""
        if self._shown["verdict"] is not None:
            return ["quit"]
        name = self._step.name if self._step else STEPS[0]
        leave = ["quit"] if name == STEPS[0] else ["back", "quit"]
        if self._step is None or self._step.check is None:
            return ["redo", *leave] if name == STEPS[0] else leave
        taken = ["enough", "drop"] if self._state.taken(name) else []
        watching = self._shown["live"] is not None and self._shown["question"] is None
        return [*(["take"] if watching else []), "redo", *taken, *leave]

    def begin(self, step: Step) -> None:
        """A step begins."""
        self._shown |= {"live": None, "question": None}
        self._jpeg, self._commands_from = None, self._number + 1
        self.show(step, Progress())

    def ask(self, question: Question, words: str, problem: str) -> None:
        """A question is open. problem : why the answer before was not accepted, or ""."""
        kind, default = question.kind, question.default
        if default is not None:
            default = typed(default) if kind == "numbers" else question.read(default)
        asked = {
            "key": question.key,
            "words": words,
            "why": question.why,
            "kind": "text" if kind == "numbers" else kind,
            "unit": question.unit,
            "default": default,
            "choices": list(question.choices),
            "problem": problem or None,
        }
        self._doing, self._answers_from = "", self._number + 1
        # the live picture stands still until the answer
        self._publish(question=asked, live=self._shown["live"] and self._shown["live"] | _NOT_STILL)

    def answered(self) -> None:
        """No question is open."""
        self._publish(question=None)

    def working(self, words: str) -> None:
        """Something takes a while."""
        self._doing = words
        self._publish()

    def show(self, step: Step, progress: Progress) -> None:
        """How far the step is."""
        self._step, self._progress, self._doing = step, progress, ""
        self._publish()

    def live(self, view: LiveView) -> None:
        """A live picture with what was found in it."""
        height, width = view.image.shape
        check, target = view.check, self._progress.target
        u, v = self._state.lens_corners().T
        counts, *_ = np.histogram2d(v, u, bins=(_ROWS, _COLUMNS), range=((0, height), (0, width)))
        seen = {
            "image_size": [width, height],
            "corners_px": check.corners_px.tolist(),
            "coverage": {"columns": _COLUMNS, "rows": _ROWS, "counts": counts.astype(int).tolist()},
            "suggested_px": None if target is None else target.outline_px.tolist(),
            "suggestion": (target.words if target else "") + (f" · {check.closer}" if check.closer else ""),
            "closeness": check.closeness,
            "hold": view.held,
            "hints": [hint.to_dict() for hint in check.hints],
        }
        shrunk = min(1.0, _WIDEST_PX / width)
        small = cv2.resize(view.image, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA)
        self._jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
        self._publish(live=seen)

    def log(self, line: str) -> None:
        """A line for the log."""
        self._publish(log=[*self._shown["log"], line][-_LOG_LINES:])

    def done(self, document: Mapping[str, Any], report: str) -> None:
        """The end: check.json's content, and where its page is."""
        self._jpeg, verdict = None, {"level": document["verdict"], "words": document["words"]}
        self._publish(verdict=verdict, report=report, question=None, live=None)

    def close(self) -> None:
        """Stop answering."""
        self._server.close()

    def _publish(self, **changes: Any) -> None:
        self._shown |= changes
        step, progress = self._step, self._progress
        texts = {name: getattr(step, name, "") for name in ("name", "title", "what", "why")}
        state = {
            "session": str(self._state.store.root),
            "steps": [self._step_line(name) for name in STEPS],
            "step": texts
            | {
                "seen": progress.seen,
                "missing": [*progress.missing, *map(str, progress.diagnoses)],
                "next": f"working: {self._doing} …" if self._doing else progress.next,
                "enough": progress.enough and not self._doing,
                "numbers": [asdict(number) for number in progress.numbers],
            },
            **self._shown,
            "finished": self._shown["verdict"] is not None,
            "can": self._possible(),
        }
        self._number = self._server.show(state, self._jpeg)

    def _step_line(self, name: str) -> dict[str, str]:
        finished, record = self._shown["verdict"] is not None, self._state.store.journal.of(name)
        now = self._step is not None and name == self._step.name and not finished
        status = "now" if now else "done" if record.closed or finished else "todo"
        note = counted(len(record.taken), "picture") if record.taken else ""
        return {"name": name, "title": self._titles[name], "status": status, "note": note}
