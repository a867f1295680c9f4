"""The board: printed or brought along, and what its print really measures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from targets.paper import paper_named
from targets.sheet import board_id, fill_in, lay_out, size_words, spec_document
from targets.write_sheet import as_pdf, draw
from vbaa_calib.detect.board.board_file import load_board
from vbaa_calib.wizard.state.session_state import BOARD, SessionState
from vbaa_calib.wizard.state.store import Store

from .step import Number, Progress, Step

_SHEET = "board.pdf"


def make_board(store: Store, answers: Mapping[str, Any]) -> dict[str, Any]:
    """Put board.yaml into the session, and a sheet to print where the board is new.

    Returns what is measured on the print, mm, for the journal. Raises InputError for a board.yaml that is none.
    """
    if answers["board"] != "new":
        spec = load_board(Path(str(answers["board"])))
        store.write(BOARD, spec_document(spec, f"from {answers['board']}").encode())
        return {
            "measure_x_mm": 1e3 * spec.square_m * spec.squares_x,
            "measure_y_mm": 1e3 * spec.square_m * spec.squares_y,
        }
    paper = paper_named(str(answers["paper"]))
    spec = fill_in(paper=paper)
    layout = lay_out(spec, paper)
    store.write(_SHEET, as_pdf(draw(spec, layout)))
    store.write(BOARD, spec_document(spec, f"as the wizard drew it in {_SHEET}").encode())
    return {"measure_x_mm": layout.ruler_x, "measure_y_mm": layout.ruler_y}


def print_instructions(store: Store, answers: Mapping[str, Any]) -> str:
    """What to do with the sheet."""
    if answers["board"] != "new":
        return "measure the print of your board"
    return (
        f"print {store.root / _SHEET} at 100 % (not fitted to the page), glue it on something flat and stiff, and "
        "measure its two rulers from end line to end line"
    )


def _progress(state: SessionState) -> Progress:
    spec, scale = state.board, state.scale
    seen = [f"board {board_id(state.nominal_board)}: {size_words(spec)}"]
    if scale is None:
        return Progress(tuple(seen), ("two readings of the print",))
    return Progress(
        seen=(*seen, scale.words),
        next=scale.remedy,
        enough=True,
        usable=True,
        numbers=(Number("scale of the print", f"{100 * scale.scale:.2f} ± {100 * scale.std:.2f} %"),),
    )


STEP = Step(
    "board",
    "Board",
    "Print the board at 100 %, glue it flat, and measure the print in both directions.",
    "The board is the ruler of everything: a print 1 % too small makes every distance 1 % wrong, and EI with it.",
    _progress,
)
