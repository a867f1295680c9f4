"""board.yaml: what the printed board is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from targets.board import BoardSpec
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.models import checked


def load_board(path: Path) -> BoardSpec:
    """The board of a file: its keys at the top level or under `board:`, so that a session.yaml serves too.

    Raises InputError naming the file, the key and the remedy.
    """
    data = read_yaml(path)
    nested = isinstance(data.get("board"), Mapping)
    board, key = (data["board"], "board") if nested else (data, "")
    return checked(BoardSpec, board, path, "mend that key (docs/formats.md)", key)
