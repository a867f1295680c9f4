"""board.yaml, or the flags that stand for it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from targets.board import PLAIN_BOARDS, Board, BoardSpec
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.models import checked

_REMEDY = "mend that key (docs/formats.md)"


def load_board(path: Path) -> BoardSpec:
    """The ChArUco board of a file, at the top level or, as in session.yaml, under `board:`.

    Raises InputError naming the file, the key and the remedy; also for a board without ids.
    """
    board, key = _keys(path)
    return checked(BoardSpec, board, path, _REMEDY, key)


def load_lens_board(path: Path) -> Board:
    """As `load_board`, also a board without ids, for the lens."""
    board, key = _keys(path)
    return board_from(board, path, key)


def _keys(path: Path) -> tuple[Mapping[str, Any], str]:
    data = read_yaml(path)
    nested = isinstance(data.get("board"), Mapping)
    return (data["board"], "board") if nested else (data, "")


def board_from(board: Mapping[str, Any], where: object, key: str = "") -> Board:
    """The board that a mapping describes. Raises InputError naming `where` and the key."""
    kind = board.get("type", "charuco")
    if kind == "charuco":
        return checked(BoardSpec, board, where, _REMEDY, key)
    if not isinstance(kind, str) or kind not in PLAIN_BOARDS:
        name = f"{key}.type" if key else "type"
        raise InputError(
            f"{name} is {kind!r}", where=where, remedy=f"one of charuco, {', '.join(PLAIN_BOARDS)} is needed"
        )
    return checked(PLAIN_BOARDS[kind], board, where, _REMEDY, key)


def counts(text: str, flag: str, where: str) -> tuple[int, int]:
    """Columns and rows from a text such as 11x7. Raises InputError."""
    found = re.fullmatch(r"\s*([0-9]{1,6})\s*[xX×]\s*([0-9]{1,6})\s*", text)
    if not found:
        raise InputError(f"{flag} is {text!r}", where=where, remedy="give columns x rows, such as 11x7")
    return int(found[1]), int(found[2])
