"""The wizard's page in the browser: the same content as in the terminal, and the live picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import cv2
import numpy as np

from .questions import STEPS, typed
from .server import PageServer
from .session_state import SessionState
from .steps import STEP_BY_NAME, PictureCheck
from .ui import LivePicture, Ui, WizardView


class Page(WizardView):
    """The wizard's view in a browser."""

    def __init__(self, state: SessionState, port: int = 0) -> None:
        self._state, self._server = state, PageServer(port)
        self._live: dict[str, Any] | None = None
        self._jpeg: bytes | None = None
        # numbers of states: the latest; the first that commands may refer to; the first with the current question
        self._number = self._commands_from = self._answers_from = 0

    @property
    def url(self) -> str:
        """The address to open in a browser on this machine."""
        return self._server.url

    def close(self) -> None:
        self._server.close()

    def events(self, ui: Ui) -> Iterator[tuple[str, Any]]:
        """Commands and answers since the last call, without those that refer to an earlier state of the page."""
        for command in self._server.take_commands():
            seen = self._number if command.seen is None else command.seen
            late = seen < self._commands_from and command.kind not in ("take", "quit")
            value = None
            if command.kind == "answer":
                if "change" in (command.value or {}) and command.value:
                    yield "answer", command.value["change"]
                    continue
                key = ui.question.key if ui.question else ""
                fits = key in (command.value or {}) and seen >= self._answers_from
                value = command.value[key] if fits and command.value else None
            else:
                fits = command.kind in self._possible(ui) and not late
            if fits:
                # a second click came before the page showed what the first one did
                self._commands_from = self._number + 1
                yield command.kind, value

    def update(self, ui: Ui, change: str) -> None:
        match change:
            case "step":
                self._live, self._jpeg, self._commands_from = None, None, self._number + 1
            case "question" | "problem":
                self._answers_from = self._number + 1
                # the live picture stands still until the answer
                moving: dict[str, Any] = {
                    "hold": 0.0,
                    "suggested_px": None,
                    "suggestion": "",
                    "closeness": None,
                    "hints": [],
                }
                self._live = self._live and self._live | moving
            case "live" | "progress" if ui.picture is not None:
                self._look(ui, ui.picture)
            case "progress" if ui.progress.target is not None:
                # no picture yet: the wanted pose in an empty frame
                width, height = self._state.image_size or self._state.live_size or (1280, 720)
                blank = LivePicture(
                    np.zeros((height, width), np.uint8), PictureCheck(), 0.0, "no picture yet", live=False
                )
                self._look(ui, blank)
            case "verdict":
                self._live = self._jpeg = None
        step, progress = ui.step, ui.progress
        texts = {name: getattr(step, name, "") for name in ("name", "title", "what", "why")}
        verdict = None
        if ui.document:
            found = [f"{one['question']} {one['words']} → {one['remedy']}" for one in ui.to_be_done]
            verdict = {"level": ui.document["verdict"], "words": ui.document["headline"], "found": found}
        lines = []
        for name, one in STEP_BY_NAME.items():
            record = self._state.store.journal.of(name)
            now = step is not None and name == step.name and not ui.document
            status = "now" if now else "done" if record.closed or ui.document else "todo"
            note = f"{len(record.taken)} picture{'s' * (len(record.taken) > 1)}" if record.taken else ""
            lines.append({"name": name, "title": one.title, "status": status, "note": note})
        state = {
            "session": str(self._state.store.root),
            "steps": lines,
            "step": texts
            | {
                "seen": progress.seen,
                "missing": [*progress.missing, *map(str, progress.diagnoses)],
                "next": f"working: {ui.doing} …" if ui.doing else progress.next,
                "enough": progress.enough and not ui.doing,
                "numbers": [asdict(number) for number in progress.numbers],
            },
            "question": _asked(ui),
            "live": self._live,
            "usual": list(ui.usual),
            "log": ui.lines,
            "verdict": verdict,
            "report": ui.report or None,
            "finished": bool(ui.document),
            "can": self._possible(ui),
        }
        self._number = self._server.show(state, self._jpeg)

    def _possible(self, ui: Ui) -> list[str]:
        if ui.document:
            return ["quit"]
        name = ui.step.name if ui.step else STEPS[0]
        leave = ["quit"] if name == STEPS[0] else ["back", "quit"]
        if ui.step is None or ui.step.check is None:
            return ["redo", *leave] if name == STEPS[0] else leave
        taken = ["enough", "drop"] if self._state.taken(name) else []
        watching = ui.picture is not None and ui.picture.live and ui.question is None
        return [*(["take"] if watching else []), "redo", *taken, *leave]

    def _look(self, ui: Ui, view: LivePicture) -> None:
        height, width = view.image.shape
        check, target = view.check, ui.progress.target
        is_lens = ui.step is not None and ui.step.name == "lens"
        u, v = np.concatenate([np.zeros((0, 2)), *(seen.corners_px for seen in self._state.views("lens"))]).T
        rows, columns = 8, 12
        counts, *_ = np.histogram2d(v, u, bins=(rows, columns), range=((0, height), (0, width)))
        self._live = {
            "image_size": [width, height],
            "corners_px": check.corners_px.tolist(),
            "coverage": {"columns": columns, "rows": rows, "counts": counts.astype(int).tolist()} if is_lens else None,
            "found": (check.words or check.refusal or view.words) if view.live else view.words,
            "suggested_px": None if target is None else target.outline_px.tolist(),
            "suggestion": (target.words if target else "") + (f" · {check.closer}" if check.closer else ""),
            "closeness": check.closeness,
            "hold": view.rested,
            "hints": [hint.to_dict() for hint in check.hints],
        }
        picture = view.image if view.drawn is None else view.drawn
        # px: width of the page's picture
        shrunk = min(1.0, 1280 / picture.shape[1])
        small = cv2.resize(picture, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA)
        self._jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()


def _asked(ui: Ui) -> dict[str, Any] | None:
    question = ui.question
    if question is None:
        return None
    default = question.default
    if default is not None:
        default = typed(default) if question.kind == "numbers" else question.read(default)
    return {
        "key": question.key,
        "words": ui.words,
        "why": question.why,
        "kind": "text" if question.kind == "numbers" else question.kind,
        "unit": question.unit,
        "default": default,
        "choices": list(question.choices),
        "problem": ui.problem or None,
    }
