"""The wizard's page, kept up to date: what the terminal says in words, with the live picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np

from vbaa_calib.wizard.preview import Preview, Snapshot
from vbaa_calib.wizard.state.journal import STEPS
from vbaa_calib.wizard.state.progress import Progress
from vbaa_calib.wizard.state.questions import Question
from vbaa_calib.wizard.state.questions import shown as typed
from vbaa_calib.wizard.state.store import Store
from vbaa_calib.wizard.steps.step import Step

_COLUMNS, _ROWS = 12, 8
_LOG_LINES = 60
_WIDEST_PX = 1280


class Page:
    """What is on the page now.

    corners : the (N, 2) corners of all pictures taken for the lens, for the coverage. titles : of the steps by name.
    """

    def __init__(self, store: Store, titles: dict[str, str], corners: Callable[[], np.ndarray], port: int = 0) -> None:
        self._store, self._titles, self._corners = store, titles, corners
        self._preview = Preview(port)
        self._preview.start()
        self._step: Step | None = None
        self._progress = Progress()
        self._question: dict[str, Any] | None = None
        self._live: dict[str, Any] | None = None
        self._jpeg: bytes | None = None
        self._log: list[str] = []
        self._verdict: dict[str, Any] | None = None
        self._report: str | None = None
        self._doing = ""
        self._number = self._since = self._asked = 0

    @property
    def url(self) -> str:
        """To open in a browser on this machine."""
        return self._preview.url

    def take(self) -> list[tuple[str, Any]]:
        """Commands given on the page since the last call, but for those that were meant for what was there before."""
        taken: list[tuple[str, Any]] = []
        for command in self._preview.take_commands():
            seen = self._number if command.seen is None else command.seen
            if command.kind == "answer":
                fits = self._question is not None and seen >= self._asked
            else:
                fits = command.kind in self._can() and (command.kind in ("take", "quit") or seen >= self._since)
            if fits:
                taken.append((command.kind, command.value))
                # a second click came before the page showed what the first one did
                self._since = self._number + 1
        return taken

    def _can(self) -> list[str]:
        """What may be done now."""
        if self._verdict is not None:
            return ["quit"]
        name = self._step.name if self._step else STEPS[0]
        can = ["quit"] if name == STEPS[0] else ["back", "quit"]
        if self._step is None or self._step.judge is None:
            return ["redo", *can] if name == STEPS[0] else can
        if self._store.journal.of(name).taken:
            can = ["enough", "drop", *can]
        watching = self._live is not None and self._question is None
        return (["take"] if watching else []) + ["redo", *can]

    def begin(self, step: Step) -> None:
        """A step begins."""
        self._step, self._progress, self._doing = step, Progress(), ""
        self._live, self._jpeg, self._question = None, None, None
        self._since = self._number + 1
        self._publish()

    def ask(self, question: Question, words: str, problem: str) -> None:
        """A question is open."""
        self._question = question.to_dict() | {"words": words, "problem": problem or None}
        if question.kind == "numbers":
            self._question["kind"] = "text"
            if question.default is not None:
                self._question["default"] = typed(question.default)
        if question.kind == "yesno" and question.default is not None:
            self._question["default"] = question.read(question.default)
        self._doing, self._asked = "", self._number + 1
        if self._live is not None:
            # it stands still until the answer
            still: dict[str, Any] = {
                "hold": 0.0,
                "suggested_px": None,
                "suggestion": "",
                "closeness": None,
                "hints": [],
            }
            self._live = self._live | still
        self._publish()

    def answered(self) -> None:
        """No question is open."""
        self._question = None
        self._publish()

    def working(self, words: str) -> None:
        """Something takes a while."""
        self._doing = words
        self._publish()

    def show(self, step: Step, progress: Progress) -> None:
        """How far the step is."""
        self._step, self._progress, self._doing = step, progress, ""
        self._publish()

    def live(self, live: Any) -> None:
        """A live picture with what was found in it."""
        height, width = live.image.shape
        target = self._progress.target
        self._live = {
            "image_size": [width, height],
            "corners_px": live.judged.corners_px.tolist(),
            "coverage": self._coverage(width, height),
            "suggested_px": None if target is None else target.outline_px.tolist(),
            "suggestion": (target.words if target else "") + (f" · {live.judged.closer}" if live.judged.closer else ""),
            "closeness": live.judged.closeness,
            "hold": live.held,
            "hints": [hint.to_dict() for hint in live.judged.hints],
        }
        shrunk = min(1.0, _WIDEST_PX / width)
        small = cv2.resize(live.image, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA)
        self._jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
        self._publish()

    def _coverage(self, width: int, height: int) -> dict[str, Any]:
        u, v = self._corners().T
        counts, *_ = np.histogram2d(v, u, bins=(_ROWS, _COLUMNS), range=((0, height), (0, width)))
        return {"columns": _COLUMNS, "rows": _ROWS, "counts": counts.astype(int).tolist()}

    def log(self, line: str) -> None:
        """A line for the log."""
        self._log = [*self._log, line][-_LOG_LINES:]
        self._publish()

    def done(self, document: Mapping[str, Any], report: str | None) -> None:
        """The end: check.json's content, and where its page is."""
        self._verdict = {"level": document["verdict"], "words": document["words"]}
        self._report, self._question, self._live, self._jpeg = report, None, None, None
        self._publish()

    def close(self) -> None:
        """Stop answering."""
        self._preview.close()

    def _publish(self) -> None:
        step, progress, finished = self._step, self._progress, self._verdict is not None
        state = {
            "session": str(self._store.root),
            "steps": self._steps(),
            "step": {
                "name": step.name if step else "",
                "title": step.title if step else "",
                "what": step.what if step else "",
                "why": step.why if step else "",
                "seen": list(progress.seen),
                "missing": [*progress.missing, *map(str, progress.diagnoses)],
                "next": f"working: {self._doing} …" if self._doing else progress.next,
                "enough": progress.enough and not self._doing,
                "numbers": [
                    {"label": one.label, "value": one.value, "goal": one.goal or None, "met": one.met}
                    for one in progress.numbers
                ],
            },
            "question": self._question,
            "live": self._live,
            "log": self._log,
            "finished": finished,
            "verdict": self._verdict,
            "report": self._report,
            "can": self._can(),
        }
        self._number = self._preview.show(Snapshot(state, self._jpeg))

    def _steps(self) -> list[dict[str, str]]:
        finished, journal = self._verdict is not None, self._store.journal
        steps = []
        for name in STEPS:
            record = journal.of(name)
            now = self._step is not None and name == self._step.name and not finished
            count = len(record.taken)
            steps.append(
                {
                    "name": name,
                    "title": self._titles[name],
                    "status": "now" if now else "done" if record.closed or finished else "todo",
                    "note": f"{count} picture{'' if count == 1 else 's'}" if count else "",
                }
            )
        return steps
