"""Between the wizard's answers and session.yaml, both ways, and the tables."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec
from targets.print_scale import READING_STD_MM, PrintScale, print_scale
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml, write_text
from vbaa_calib.core.yaml_text import UniqueKeyDumper
from vbaa_calib.session import SCHEMA, Session, has_sweep, load_session, session_from

from .journal import AcceptedPicture
from .questions import BY_KEY, READINGS
from .store import Store

_MEASURED = ("measure_x_mm", "board_along_x_mm", "measure_y_mm", "board_along_y_mm")
"""What the rulers of the sheet say, and what was read on them."""
_WHERE = "board_along_x_mm, board_along_y_mm"


def scale_of(answers: Mapping[str, Any], require_square: bool = False) -> PrintScale | None:
    """The print's scale; None before both readings were given.

    Raises InputError for readings that cannot be; if required, for a print whose squares are not square, too.
    """
    if any(name not in answers for name in _MEASURED):
        return None
    x, along_x, y, along_y = (float(answers[name]) for name in _MEASURED)
    try:
        scale = print_scale(x, along_x, y, along_y, float(answers.get("board_reading_std_mm", READING_STD_MM)))
    except ValueError as error:
        # targets.print_scale knows its own parameters, not what they are called here
        what = str(error).replace("reading_std", "board_reading_std")
        what = what.replace("reading_x", "board_along_x").replace("reading_y", "board_along_y")
        raise InputError(what, where=_WHERE, remedy="measure it again") from None
    if require_square and scale.differs:
        raise InputError(scale.words, where=_WHERE, remedy=scale.remedy)
    return scale


_GRAVITY_M_S2 = 9.80665
_DIRECTIONS = {"x": (1, 0, 0), "-x": (-1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "-z": (0, 0, -1)}
_UNITS = {
    "antenna": {
        "length_m": ("antenna_length_mm", 1e-3, 1e3),
        "diameter_m": ("antenna_diameter_mm", 1e-3, 1e3),
        "youngs_modulus_Pa": ("youngs_modulus_GPa", 1e9, 1e-9),
        "density_kg_m3": ("density_kg_m3", 1.0, 1.0),
    },
    "moment_sensor": {"std_Nm": ("moment_std_mNm", 1e-3, 1e3)},
    "load_readings": {
        "distance_std_m": ("distance_std_mm", 1e-3, 1e3),
        "force_std_relative": ("mass_std_percent", 1e-2, 1e2),
    },
}
"""Section and key of session.yaml → the answer, its size in SI, and SI's size in its unit."""
_PASSING = {"antenna_length_mm": 100.0, "antenna_diameter_mm": 1.0}
"""Taken until they are answered, since they have no default."""


def _session_data(
    answers: Mapping[str, Any], board: BoardSpec, before: Mapping[str, Any], print_scale_std: float = 0.0
) -> dict[str, Any]:
    """session.yaml out of the answers; what is not answered yet has its default. Keys that nobody asks for stay.

    board : as it was printed. before : what session.yaml holds. print_scale_std : of the print's scale, relative.
    """
    value = {key: answers.get(key, question.default) for key, question in BY_KEY.items()}
    read = {
        section: {key: size * (value[name] or _PASSING.get(name, 0.0)) for key, (name, size, _) in keys.items()}
        for section, keys in _UNITS.items()
    }
    data = dict(before) | {"schema": SCHEMA, "board": board.to_dict(), "antenna": read["antenna"]}
    data["moment_sensor"] = dict(before.get("moment_sensor") or {}) | read["moment_sensor"]
    if {"distance_std_mm", "mass_std_percent"} & set(answers) or "load_readings" not in before:
        data["load_readings"] = read["load_readings"]
    if print_scale_std:
        data["print_scale_std"] = round(print_scale_std, 9)
    elif "board_given" not in answers:
        data.pop("print_scale_std", None)
    if "gravity" in answers or "gravity_world" not in before:
        down = _DIRECTIONS.get(value["gravity"])
        data["gravity_world"] = None if down is None else [_GRAVITY_M_S2 * float(part) for part in down]
    way = value["plane_way"]
    # the calibration takes every way that session.yaml names: one that was chosen before must not stay
    for other in {"jig", "over"} - {way}:
        if not answers.get(f"{other}_given"):
            data.pop(other, None)
    if way == "jig" and value["jig_translation_mm"] is not None:
        data["jig"] = _jig(value)
        data["board"]["thickness_m"] = 1e-3 * value["board_thickness_mm"]
    if way == "over" and value["over_height_mm"] is not None:
        data["over"] = dict(before.get("over") or {}) | {"height_m": 1e-3 * value["over_height_mm"]}
    return data


def check_jig_axes(x: str, y: str) -> None:
    """Raises InputError for axes of the board that run along the same line."""
    if x.lstrip("-") == y.lstrip("-"):
        what = f"the board's x runs along {x} and its y along {y}"
        raise InputError(what, where="jig_board_x, jig_board_y", remedy="the two are at right angles: answer anew")


def _jig(value: Mapping[str, Any]) -> dict[str, Any]:
    check_jig_axes(value["jig_board_x"], value["jig_board_y"])
    x, y = (np.array(_DIRECTIONS[value[key]], float) for key in ("jig_board_x", "jig_board_y"))
    turn = Rotation.from_rotvec(value["jig_turn_deg"], degrees=True)
    rotation = turn * Rotation.from_matrix(np.column_stack([x, y, np.cross(x, y)]))
    return {
        "T_antenna_board": {
            "translation_m": [1e-3 * part for part in value["jig_translation_mm"]],
            "rotation_xyzw": [float(part) for part in rotation.as_quat()],
        },
        "translation_std_m": 1e-3 * value["jig_std_mm"],
        "rotation_std_rad": float(np.radians(value["jig_std_deg"])),
    }


def session_of(store: Store, board: BoardSpec, print_scale_std: float = 0.0) -> Session:
    """The session as the answers have it so far. Raises InputError for answers that do not go together."""
    path = store.root / "session.yaml"
    data = _session_data(store.journal.answers, board, _read(path), print_scale_std)
    return session_from(data, store.root, path)


def _read(path: Path) -> dict[str, Any]:
    return read_yaml(path) if path.exists() else {}


def write_session(store: Store, board: BoardSpec, print_scale_std: float = 0.0) -> None:
    """Write session.yaml and the tables as the journal has them, where they are not so already."""
    path, answers = store.root / "session.yaml", store.journal.answers
    before = _read(path)
    data = _session_data(answers, board, before, print_scale_std)
    without_default = ("board", "antenna_length_mm", "antenna_diameter_mm", "plane_way")
    if data != before and all(key in answers for key in without_default):
        text = yaml.dump(
            data, Dumper=UniqueKeyDumper, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
        )
        write_text(path, text)
    for step in ("plane", "noload", "loads"):
        folder = store.folder(step)
        if folder in READINGS and store.journal.of(step).taken:
            write_table(store.root / folder / f"{folder}.csv", folder, store.journal.of(step).taken)


def write_table(path: Path, folder: str, taken: Sequence[AcceptedPicture]) -> None:
    """The table of a folder of pictures; numbers to the last bit. Untouched where it says the same already."""
    columns = ["image", *READINGS[folder], *(["time_s"] if all("time_s" in one.readings for one in taken) else [])]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for one in taken:
        writer.writerow([Path(one.file).name, *(repr(float(one.readings[name])) for name in columns[1:])])
    if not path.exists() or path.read_text(encoding="utf-8", errors="replace") != text.getvalue():
        write_text(path, text.getvalue())


def answers_of(session_yaml: Path) -> dict[str, Any]:
    """What a session.yaml that was written by hand answers already. Raises InputError where it is wrong."""
    session, data = load_session(session_yaml.parent), read_yaml(session_yaml)
    sections = {
        "antenna": session.antenna,
        "moment_sensor": SimpleNamespace(std_Nm=session.moment_std_Nm),
        "load_readings": session.load_readings,
    }
    found: dict[str, Any] = {
        name: per_si * getattr(sections[section], key)
        for section, keys in _UNITS.items()
        for key, (name, _, per_si) in keys.items()
    }
    for axis, squares in (("x", session.board.squares_x), ("y", session.board.squares_y)):
        length_mm = 1e3 * session.board.square_m * squares
        found |= {f"measure_{axis}_mm": length_mm, f"board_along_{axis}_mm": length_mm}
    ways = {"jig": bool(data.get("jig")), "sweep": has_sweep(session), "over": bool(data.get("over"))}
    found |= {"board": str(session_yaml), "board_reading_std_mm": READING_STD_MM}
    found |= {"board_given": True, "gravity_given": True, "jig_given": ways["jig"], "over_given": ways["over"]}
    way = next((way for way, there in ways.items() if there), None)
    return found if way is None else found | {"plane_way": way}
