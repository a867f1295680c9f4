"""What the verbs that are killed read."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import yaml

from estimator.table.files import write_contacts
from tests.estimator.test_next_touch import given
from tests.small_scene import small_rig

VERBS: dict[str, Callable[[Path], tuple[str, list[str]]]] = {
    "board": lambda at: ("board.svg", ["board", "--spec", str(at / "board.yaml")]),
    "convert": lambda at: ("camera.yaml", ["convert", str(at / "rig.json"), "--to", "ros"]),
    "budget": lambda at: ("budget.json", ["budget", str(at / "rig.json")]),
    "track": lambda at: ("track.csv", ["track", str(at / "contacts.csv"), "--rig", str(at / "rig.json")]),
    "reconstruct": lambda at: ("object.ply", ["reconstruct", str(at / "contacts.csv"), "--rig", str(at / "rig.json")]),
    "simulate": lambda at: ("session", ["simulate", str(small_rig() / "scene.yaml")]),
}
"""Name → output and arguments, from the folder of `prepare`. The answers are the same in every run."""


def prepare(folder: Path) -> None:
    table, rig = given("sphere", float("inf"), 37)
    write_contacts(folder / "contacts.csv", table.rows())
    (folder / "rig.json").write_text(json.dumps(rig.to_dict()))
    board = {"type": "charuco", "squares_x": 5, "squares_y": 4, "square_m": 0.012, "marker_m": 0.009}
    board |= {"dictionary": "DICT_4X4_100", "legacy_pattern": False, "thickness_m": 0.0}
    (folder / "board.yaml").write_text(yaml.safe_dump(board))
