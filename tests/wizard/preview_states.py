"""States of the wizard for the page's tests."""

from __future__ import annotations

import copy
from typing import Any

import cv2
import numpy as np

QUESTION: dict[str, Any] = {
    "key": "loads.1.mass",
    "words": "What does the weight weigh?",
    "why": "With its hook.",
    "kind": "number",
    "unit": "kg",
    "default": None,
    "choices": [],
}

LIVE: dict[str, Any] = {
    "image_size": [320, 240],
    "corners_px": [[40.0, 50.0], [80.5, 52.25], [120.0, 54.0]],
    "coverage": {"columns": 4, "rows": 3, "counts": [[0, 1, 2, 0], [0, 3, 1, 0], [0, 0, 0, 0]]},
    "suggested_px": [[100.0, 60.0], [260.0, 70.0], [250.0, 180.0], [110.0, 170.0]],
    "suggestion": "further right, nearer",
    "closeness": 0.5,
    "hold": 0.25,
    "hints": [{"name": "blur", "words": "the picture is blurred", "remedy": "hold still", "grave": False}],
}

STATE: dict[str, Any] = {
    "session": "rig <b>",
    "steps": [
        {"name": "board", "title": "Print the board", "status": "done", "note": "29.96 mm"},
        {"name": "lens", "title": "Lens", "status": "now", "note": ""},
        {"name": "loads", "title": "Loads", "status": "todo", "note": ""},
    ],
    "step": {
        "name": "lens",
        "title": "Photograph the board",
        "what": "Hold the board at the outline.",
        "why": "Each pose teaches the lens.",
        "seen": ["11 pictures"],
        "missing": ["the lower right"],
        "next": "the board in the lower right",
        "enough": False,
        "numbers": [{"label": "position on plane C", "value": "0.14 mm", "goal": "0.10 mm", "met": False}],
    },
    "question": None,
    "live": None,
    "log": ["first", "second"],
    "finished": False,
    "report": None,
}


def state(**changed: Any) -> dict[str, Any]:
    """A state of its own, with some entries changed."""
    return {**copy.deepcopy(STATE), **changed}


def jpeg(level: int = 128) -> bytes:
    """A small grey picture."""
    return cv2.imencode(".jpg", np.full((240, 320), level, np.uint8))[1].tobytes()
