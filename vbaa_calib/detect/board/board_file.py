"""Reads a board from board.yaml, or from the equivalent flags."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from targets.board import BOARDS, Board, BoardWithIds, FileBoard
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.models import checked

_REMEDY = "mend that key (docs/formats.md)"  # of a key of a board's file


def load_board(path: Path) -> BoardWithIds:
    """The board with ids in a file, at the top level or, as in session.yaml, under `board:`; also in Kalibr's
    format.

    Raises InputError naming the file, the key and the remedy; also for a board without ids.
    """
    board, key, where = _keys(path)
    return with_ids(board, where, key)


def with_ids(board: object, where: object, key: str = "", remedy: str = _REMEDY) -> BoardWithIds:
    """The board with ids that a mapping describes, in our format or Kalibr's, or the one in the file that
    session.yaml at `where` names.

    Raises InputError naming `where` and the key.
    """
    if isinstance(board, str) and isinstance(where, Path):
        return load_board(_named(board, where))
    if isinstance(board, Mapping) and "target_type" in board:
        board = _of_kalibr(board, where, key).to_dict()
    kind: Any = FileBoard
    found: BoardWithIds = checked(kind, board, where, remedy, key)
    return found


def load_lens_board(path: Path) -> Board:
    """The board of any kind, with or without ids, in a file: all kinds can calibrate the lens.

    Raises InputError naming file and key.
    """
    board, key, where = _keys(path)
    return board_from(board, where, key)


def _keys(path: Path) -> tuple[Mapping[str, Any], str, Path]:
    """The mapping that describes a board, its key and its file, which session.yaml may name."""
    data = read_yaml(path)
    board = data.get("board")
    if isinstance(board, str):
        return _keys(_named(board, path))
    return (board, "board", path) if isinstance(board, Mapping) else (data, "", path)


def _named(name: str, path: Path) -> Path:
    """The file that `board:` of a session.yaml at `path` names. Raises InputError where there is none."""
    found = path.parent / name
    if not found.is_file() or found.resolve() == path.resolve():
        remedy = "describe the board there, or name a file beside session.yaml (board.yaml, Kalibr's target.yaml)"
        raise InputError(f"board is {name!r:.60}: no such file", where=path, remedy=remedy)
    return found


def board_from(board: Mapping[str, Any], where: object, key: str = "") -> Board:
    """The board that a mapping describes. Raises InputError naming `where` and the key."""
    if "target_type" in board:
        return _of_kalibr(board, where, key)
    kind = board.get("type", "charuco")
    if not isinstance(kind, str) or kind not in BOARDS:
        name = f"{key}.type" if key else "type"
        raise InputError(f"{name} is {kind!r}", where=where, remedy=f"one of {', '.join(BOARDS)} is needed")
    return checked(BOARDS[kind], board, where, _REMEDY, key)


_KALIBR: dict[str, tuple[str, dict[str, str]]] = {
    "aprilgrid": (
        "aprilgrid",
        {"tagCols": "columns", "tagRows": "rows", "tagSize": "tag_m", "tagSpacing": "spacing"},
    ),
    "checkerboard": (
        "chessboard",
        {"targetCols": "squares_x", "targetRows": "squares_y", "colSpacingMeters": "square_m", "rowSpacingMeters": ""},
    ),
    "circlegrid": ("circles", {"targetCols": "columns", "targetRows": "rows", "spacingMeters": "spacing_m"}),
}
"""Kalibr's kinds of targets: ours, and the key for each of theirs."""


def _of_kalibr(target: Mapping[str, Any], where: object, key: str) -> Board:
    """The board of Kalibr's target.yaml, which counts the inner corners of a checkerboard. Raises InputError."""
    named = target["target_type"]
    if named not in _KALIBR or target.get("asymmetricGrid"):
        what = f"target_type is {named!r}" if named not in _KALIBR else "asymmetricGrid is true"
        raise InputError(what, where=where, remedy=f"describe the board as one of {', '.join(BOARDS)} ({_REMEDY})")
    kind, keys = _KALIBR[named]
    if missing := [name for name in keys if name not in target]:
        raise InputError(f"{missing[0]} is missing", where=where, remedy=f"Kalibr's {named} has {', '.join(keys)}")
    if target.get("colSpacingMeters") != target.get("rowSpacingMeters"):
        remedy = "squares of two sides are not calibrated with: print it anew"
        raise InputError("colSpacingMeters and rowSpacingMeters differ", where=where, remedy=remedy)
    board = {own: target[name] for name, own in keys.items() if own}
    if kind == "chessboard":
        board |= {own: board[own] + 1 for own in ("squares_x", "squares_y") if isinstance(board[own], int)}
    return checked(BOARDS[kind], {"type": kind, **board}, where, _REMEDY, key)


def counts(text: str, flag: str, where: str) -> tuple[int, int]:
    """Columns and rows from text such as 11x7. Raises InputError."""
    found = re.fullmatch(r"\s*([0-9]{1,6})\s*[xX×]\s*([0-9]{1,6})\s*", text)
    if not found:
        raise InputError(f"{flag} is {text!r}", where=where, remedy="give columns x rows, such as 11x7")
    return int(found[1]), int(found[2])
