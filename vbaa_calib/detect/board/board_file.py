"""board.yaml: what the printed board is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from targets.board import BoardSpec
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml


def load_board(path: Path) -> BoardSpec:
    """The board of a file: its keys at the top level or under `board:`, so that a session.yaml serves too.

    Raises InputError naming the file, the key and the remedy.
    """
    data = read_yaml(path)
    nested = isinstance(data.get("board"), Mapping)
    try:
        return BoardSpec.from_dict(data["board"] if nested else data)
    except ValueError as error:
        where = f"{path} board" if nested else path
        raise InputError(str(error), where=where, remedy="mend that key (docs/formats.md)") from None
