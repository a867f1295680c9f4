"""The wizard's questions, each of which is a prompt, a flag and a key of the answers file; and the readings of
pictures."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from vbaa_calib.antenna.materials import MATERIALS
from vbaa_calib.core.csv_rows import read_csv
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.session import SILENT

if TYPE_CHECKING:
    import numpy as np

Answers = Mapping[str, Any]
_NUMBER = re.compile(r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s\d.,;+-]*)\s*")


@dataclass(frozen=True)
class Question:
    """One question. Its key `antenna_length_mm` is the flag `--antenna-length-mm` and `antenna_length_mm:` in a file.

    kind : number, numbers, choice, yesno, sides or text. default : None if there is none. usual : whether the default
        is taken without asking.
    low, high : of numbers. length : how many numbers, 0 for any. needed : whether it is asked, by the answers so far.
    """

    key: str
    step: str
    words: str
    why: str = ""
    kind: str = "number"
    unit: str = ""
    default: Any = None
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    length: int = 0
    usual: bool = False
    needed: Callable[[Answers], bool] = lambda answers: True

    @property
    def flag(self) -> str:
        """The question's flag on the command line."""
        return "--" + self.key.replace("_", "-")

    def as_known(self, answers: Answers) -> Question:
        """The question with the chosen material's numbers as defaults; for another material it is asked."""
        if self.key not in OF_MATERIAL or (material := answers.get("material")) is None:
            return self
        if (known := MATERIALS.get(material)) is None:
            return replace(self, usual=False, default=None)
        typical = {"youngs_modulus_GPa": 1e-9 * known.youngs_modulus_Pa, "density_kg_m3": known.density_kg_m3}
        return replace(self, default=typical[self.key])

    def read(self, entered: object, where: object = None) -> Any:
        """The answer, converted and checked. Raises InputError with what is expected."""
        readers = {"number": self._number, "numbers": self._numbers, "choice": self._choice}
        try:
            return (readers | {"yesno": _yesno, "sides": _sides}).get(self.kind, _text)(entered)
        except (TypeError, ValueError, OverflowError) as error:
            unit = f" in {self.unit}" if self.unit else ""
            if math.isfinite(self.low) and math.isfinite(self.high):
                unit += f" from {self.low:g} to {self.high:g}"
            expected = {
                "number": f"a number{unit}",
                "numbers": f"{self.length or 'some'} numbers{unit}, commas between them",
                "choice": f"one of {', '.join(self.choices)}",
                "yesno": "yes or no",
                "sides": "a whole number, or two such as 2x1",
                "text": f"a text: {self.words}",
            }[self.kind]
            what = f"{self.key} is {'empty' if entered is None else quoted(entered)}: {error}"
            raise InputError(what, where=where, remedy=f"give {expected}") from None

    def _number(self, entered: object) -> float:
        value = _as_number(entered, self.unit)
        if not self.low <= value <= self.high:
            raise ValueError(f"{value:g}{' ' + self.unit if self.unit else ''} cannot be")
        return value

    def _numbers(self, entered: object) -> list[float]:
        parts = entered
        if isinstance(entered, str):
            parts = [part.strip() for part in entered.replace(";", ",").split(",") if part.strip()]
            if len(parts) == 1 and not _NUMBER.sub("", entered):
                parts = [found[0] for found in _NUMBER.finditer(entered)]
            # a unit behind the last number is that of all
            units = [(found := _NUMBER.fullmatch(part)) and found[2] for part in parts]
            if units and units[-1] and not any(units[:-1]):
                parts = [f"{part} {units[-1]}" for part in parts[:-1]] + parts[-1:]
        elif isinstance(entered, int | float) and not isinstance(entered, bool):
            parts = [entered]
        if not isinstance(parts, list | tuple):
            raise ValueError("those are not numbers")
        if not parts or (self.length and len(parts) != self.length):
            raise ValueError(f"those are {len(parts)} numbers")
        return [self._number(part) for part in parts]

    def _choice(self, entered: object) -> str:
        text = str(entered).strip().lower() if isinstance(entered, str | int | float) else ""
        fitting = [choice for choice in self.choices if choice.lower() == text]
        fitting = fitting or [choice for choice in self.choices if text and choice.lower().startswith(text)]
        if len(fitting) != 1:
            raise ValueError("that is none of them" if not fitting else f"that may be {' or '.join(fitting)}")
        return fitting[0]


def typed(value: Any) -> str:
    """An answer as a person would type it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(typed, value))
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def _as_number(entered: object, unit: str) -> float:
    """A number in the question's unit, which may be typed with another unit of the same kind.

    Raises ValueError, also for 1_0, true and a decimal comma.
    """
    if isinstance(entered, bool) or not isinstance(entered, int | float | str):
        raise ValueError("that is not a number")
    factor = 1.0
    if isinstance(entered, str):
        if entered.count(",") == 1 and "." not in entered:
            raise ValueError("the decimal sign is a point")
        if not entered.replace("°", "").replace("·", "").isascii() or not (found := _NUMBER.fullmatch(entered.strip())):
            raise ValueError("that is not a number")
        entered, other = found.groups()
        if other and other != unit:
            # Units that may be typed behind a number, each with its size in SI, by what they measure.
            kinds = (
                {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "inch": 0.0254, "inches": 0.0254},
                {"g": 1e-3, "kg": 1.0, "oz": 0.028349523, "lb": 0.45359237},
                {"degrees": math.pi / 180, "deg": math.pi / 180, "°": math.pi / 180, "rad": 1.0},
                {"GPa": 1e9, "MPa": 1e6, "Pa": 1.0},
                {"mN·m": 1e-3, "mNm": 1e-3, "N·m": 1.0, "Nm": 1.0},
            )
            sizes = next((kind for kind in kinds if unit in kind and other in kind), None)
            if sizes is None:
                raise ValueError(f"{other!r} is no unit of it")
            factor = sizes[other] / sizes[unit]
    if not math.isfinite(value := factor * float(entered)):
        raise ValueError("that is not a finite number")
    return value


def _yesno(entered: object) -> bool:
    text = str(entered).strip().lower()
    meaning = dict.fromkeys(("y", "yes", "true"), True) | dict.fromkeys(("n", "no", "false"), False)
    if text not in meaning:
        raise ValueError("that is neither")
    return meaning[text]


def _sides(entered: object) -> str:
    if type(entered) not in (int, str) or not re.fullmatch(r"\d{1,6}([xX,]\d{1,6})?", str(entered).strip(), re.ASCII):
        raise ValueError("that is neither one nor two")
    return str(entered).strip()


def _text(entered: object) -> str:
    if not isinstance(entered, str) or not entered.strip():
        raise ValueError("that is no text")
    if "\0" in entered or len(entered) > 4096:
        raise ValueError("that cannot be")
    return entered.strip()


STEPS = ("board", "lens", "plane", "noload", "loads", "sensor", "verdict")
PICTURES = {"lens": "for the lens", "plane": "for plane C", "noload": "of the free antenna", "loads": "of loads"}
"""Steps that take pictures, and of what those are."""
READINGS: Mapping[str, tuple[str, ...]] = {
    "sweep": ("pan_rad", "tilt_rad"),
    "noload": ("pan_rad", "tilt_rad", *SILENT),
    "loads": ("pan_rad", "tilt_rad", *SILENT, "distance_m", "force_y_N", "force_z_N"),
}
"""Folder → what is read with each of its pictures."""


def keeps_jig(answers: Answers) -> bool:
    """Whether an adopted session's own jig is kept because no other is described."""
    return bool(answers.get("jig_given")) and "jig_translation_mm" not in answers


def _needed(key: str, only_if: Mapping[str, Any], unless: str, answers: Answers) -> bool:
    known = keeps_jig(answers) if unless == "jig_kept" else key not in answers and answers.get(unless)
    return not known and all(answers.get(other) == value for other, value in only_if.items())


def _question(step: str, key: str, entry: dict[str, Any]) -> Question:
    low, high = map(float, entry.pop("range", ("-inf", "inf")))
    choices = entry.get("choices", ())
    entry["choices"] = (*MATERIALS, "other") if choices == "materials" else tuple(choices)
    kind = entry.pop("kind", "choice" if entry["choices"] else "number")
    needed = partial(_needed, key, entry.pop("if", {}), entry.pop("unless", ""))
    return Question(key, step, kind=kind, low=low, high=high, needed=needed, **entry)


_FILE = yaml.safe_load(Path(__file__).with_name("questions.yaml").read_text(encoding="utf-8"))
QUESTIONS = tuple(_question(step, key, entry) for step, entries in _FILE.items() for key, entry in entries.items())
BY_KEY: Mapping[str, Question] = {question.key: question for question in QUESTIONS}
DIRECTIONS = {"x": (1, 0, 0), "-x": (-1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "-z": (0, 0, -1)}
OF_MATERIAL = ("youngs_modulus_GPa", "density_kg_m3")
"""What another material makes void."""
OF_LENS_FILE = (
    Question("camera_name", "lens", "Which camera of that file, if it holds several?", kind="text"),
    Question("size", "lens", "How large are its pictures, WxH in pixels, if it does not state that?", kind="sides"),
    Question("binning", "lens", "How many pixels of its pictures are one of yours, N or NxM?", kind="sides"),
    Question("roi", "lens", "Which part of its pictures: left, top, width, height?", kind="numbers", length=4),
    Question("rectified", "lens", "Were your pictures rectified with its projection matrix?", kind="yesno"),
    Question("fisheye", "lens", "Are its four coefficients a fisheye's k1 to k4?", kind="yesno"),
)
"""What `vbaa_calib.cli.options` has flags for."""
SOURCES = (
    *(Question(f"{step}_source", step, "Where are its pictures, if not in source?", kind="text") for step in PICTURES),
    Question(
        "camera",
        "lens",
        "Which file holds the lens, if it is known? camera.json, or one of ROS, OpenCV, Kalibr, mrcal or COLMAP",
        kind="text",
    ),
    *OF_LENS_FILE,
)
"""Never asked; flags and answers only."""
TABLES = tuple(
    Question(f"{step}_readings", step, f"CSV with what was read with each picture of the step {step}", kind="text")
    for step in ("plane", "noload", "loads")
)
"""Never asked as a whole; a picture's readings are asked one by one."""
BOARD_ANSWERS = (*_FILE["board"], "measure_x_mm", "measure_y_mm", "board_given")
"""What is known of the board; another board makes all of it void."""


_DEGREES = math.pi / 180.0
UNITS: Mapping[str, Mapping[str, float]] = {
    "pan": {"pan_rad": 1.0, "pan_deg": _DEGREES},
    "tilt": {"tilt_rad": 1.0, "tilt_deg": _DEGREES},
    "moment": {"moment_Nm": 1.0, "moment_mNm": 1e-3},
    **{f"moment_{axis}": {f"moment_{axis}_Nm": 1.0, f"moment_{axis}_mNm": 1e-3} for axis in "xz"},
    **{f"sensor_{axis}": {f"sensor_force_{axis}_N": 1.0, f"sensor_force_{axis}_mN": 1e-3} for axis in "xyz"},
    "time": {"time_s": 1.0},
    "distance": {"distance_m": 1.0, "distance_mm": 1e-3},
    "mass": {"mass_kg": 1.0, "mass_g": 1e-3},
    "force_y": {"force_y_N": 1.0, "force_y_mN": 1e-3},
    "force_z": {"force_z_N": 1.0, "force_z_mN": 1e-3},
}
"""Quantity → names under which it may be given, and their size in SI. The first one is what is kept."""
COLUMNS = tuple(name for names in UNITS.values() for name in names)

_JOINTS = (
    Question("pan_deg", "", "Pan angle", unit="degrees", default=0.0, low=-360.0, high=360.0),
    Question("tilt_deg", "", "Tilt angle", unit="degrees", default=0.0, low=-360.0, high=360.0),
)
_FREE_POSES_DEG = ((0.0, 0.0), (0.0, 20.0), (0.0, -20.0), (20.0, 0.0), (-20.0, 0.0))
_ASKED = {
    "sweep": _JOINTS,
    "noload": _JOINTS,
    "loads": (
        Question("mass_g", "", "Mass on the antenna", unit="g", low=1e-6, high=1e6),
        Question(
            "distance_mm", "", "Where it hangs, from the clamp along the antenna", unit="mm", low=0.01, high=10_000.0
        ),
        *_JOINTS,
    ),
}


def _sensed(column: str) -> Question:
    """The question for one column of the sensor's readings."""
    if column == "moment_Nm":
        return Question("moment_mNm", "", "Moment sensor's reading", unit="mN·m", low=-1e5, high=1e5)
    quantity, axis, _ = column.rsplit("_", 2)
    if quantity == "moment":
        return Question(f"moment_{axis}_mNm", "", f"Moment about the sensor's {axis}", unit="mN·m", low=-1e5, high=1e5)
    return Question(f"sensor_force_{axis}_mN", "", f"Force along the sensor's {axis}", unit="mN", low=-1e6, high=1e6)


def free_pose_deg(taken: int) -> tuple[float, float]:
    """Pan and tilt, degrees, for the next picture of the free antenna after `taken` of them."""
    return _FREE_POSES_DEG[min(taken, len(_FREE_POSES_DEG) - 1)]


def asked(
    folder: str, taken: Sequence[Mapping[str, float]] = (), columns: Sequence[str] = ("moment_Nm",)
) -> list[Question]:
    """The readings to ask for with each picture of a folder. taken : those of the pictures before. columns : of the
    sensor.

    Angles that are not typed are those that the step asks for, where it asks for some; else those of the last picture.
    """
    questions = list(_ASKED.get(folder, ()))
    if folder in ("noload", "loads"):
        questions += map(_sensed, columns)
    angles = {}
    if folder == "noload":
        angles = dict(zip(("pan_deg", "tilt_deg"), free_pose_deg(len(taken)), strict=True))
    elif taken and questions:
        angles = {f"{name}_deg": round(taken[-1][f"{name}_rad"] / _DEGREES, 9) for name in ("pan", "tilt")}
    return [replace(one, default=angles.get(one.key, one.default)) for one in questions]


def split_line(questions: Sequence[Question], numbers: Sequence[float]) -> dict[str, Any]:
    """The readings typed in one line; joint angles may be missing. Raises InputError."""
    needed = [question for question in questions if question.default is None]
    read_in = questions if len(numbers) == len(questions) else needed
    if len(numbers) != len(read_in):
        remedy = f"give {', '.join(question.key for question in questions)}"
        raise InputError(f"those are {len(numbers)} numbers, {len(questions)} are read", remedy=remedy)
    read = {one.key: one.read(number) for one, number in zip(read_in, numbers, strict=True)}
    return {question.key: read.get(question.key, question.default) for question in questions}


@dataclass(frozen=True)
class ReadingsTable:
    """Readings from a file: rows by picture name, and rows without a name in the order of taking."""

    by_image: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    in_order: Sequence[Mapping[str, Any]] = ()
    where: object = None

    @staticmethod
    def read(path: Path) -> ReadingsTable:
        """A CSV with a column `image` and any of `COLUMNS`. Raises InputError."""
        rows = read_csv(path, ("image",), COLUMNS)
        filled = ({key: cell for key, cell in row.items() if cell or key == "image"} for row in rows)
        return ReadingsTable._of_rows(((f"{path} line {row.pop('line')}", row) for row in filled), path)

    @staticmethod
    def written(rows: Sequence[Any], where: object) -> ReadingsTable:
        """Rows of an answers file: mappings of `COLUMNS`, with or without `image`. Raises InputError."""
        for number, row in enumerate(rows, 1):
            place = f"{where} row {number}"
            if not isinstance(row, Mapping):
                raise InputError("is not a mapping", where=place, remedy="give pan_rad: ..., moment_Nm: ... and so on")
            if unknown := [key for key in row if key not in ("image", *COLUMNS)]:
                remedy = f"the keys are image, {', '.join(COLUMNS)}"
                raise InputError(f"unknown key {unknown[0]!r}", where=place, remedy=remedy)
        return ReadingsTable._of_rows(((f"{where} row {number}", row) for number, row in enumerate(rows, 1)), where)

    @staticmethod
    def _of_rows(rows: Iterable[tuple[str, Mapping[str, Any]]], where: object) -> ReadingsTable:
        by_image, in_order = dict[str, Mapping[str, Any]](), list[Mapping[str, Any]]()
        for place, row in rows:
            cells = {key: value for key, value in row.items() if key != "image"}
            in_si(cells, place)
            if "image" not in row:
                in_order.append(cells)
                continue
            name = Path(row["image"]).name if isinstance(row["image"], str) else ""
            if not name:
                raise InputError("image is no name of a picture", where=place, remedy="name the picture")
            if name in by_image:
                raise InputError(f"{name} stands twice", where=place, remedy="a row per picture")
            by_image[name] = cells
        return ReadingsTable(by_image, in_order, where)

    def of(self, name: str, taken: int) -> Mapping[str, Any] | None:
        """The row of the `taken`-th accepted picture, counted from 0; None if there is none."""
        if name in self.by_image:
            return self.by_image[name]
        return self.in_order[taken] if taken < len(self.in_order) else None


def in_si(typed: Mapping[str, Any], where: object) -> dict[str, float]:
    """Readings in SI units under their main names. Raises InputError for what is not a number or is there twice."""
    found: dict[str, float] = {}
    for names in UNITS.values():
        entered = [name for name in names if name in typed]
        if len(entered) > 1:
            raise InputError(f"gives {entered[0]} and {entered[1]}", where=where, remedy="give one of them")
        for name in entered:
            found[next(iter(names))] = Question(name, "", name).read(typed[name], where) * names[name]
    for name in ("distance_m", "mass_kg"):
        if not found.get(name, 1.0) > 0:
            raise InputError(f"{name} is {found[name]:g}", where=where, remedy="it is more than zero: measure it again")
    return found


def complete(
    folder: str,
    typed: Mapping[str, Any],
    gravity_antenna_m_s2: np.ndarray,
    length_m: float,
    where: object,
    columns: Sequence[str] = ("moment_Nm",),
) -> dict[str, float]:
    """Readings of a picture in the form of the session's tables. Raises InputError naming what is missing or wrong.

    gravity_antenna_m_s2 : (3,) at these joint angles. length_m : of the antenna. columns : of the sensor.
    """
    readings = in_si(typed, where)
    for name in set(SILENT) - {*columns}:
        readings.pop(name, None)
    for question in asked(folder, columns=columns):
        names = next(tuple(each) for each in UNITS.values() if question.key in each)
        if names[0] not in readings and names[0] != "mass_kg":
            raise InputError(f"{names[0]} is missing", where=where, remedy=f"give {' or '.join(names)}")
    for name in ("pan_rad", "tilt_rad"):
        if abs(readings.get(name, 0.0)) > 2 * math.pi:
            what = f"{name} is {readings[name]:g}, more than a turn"
            raise InputError(what, where=where, remedy="are these degrees?")
    if folder != "loads":
        return readings
    if readings["distance_m"] > length_m:
        what = f"distance_m is {readings['distance_m']:g}, the antenna {length_m:g} m long"
        raise InputError(what, where=where, remedy="measure from the clamp along the antenna; is the unit right?")
    entered = [readings.get(name) for name in ("force_y_N", "force_z_N")]
    by_force = entered != [None, None]
    if by_force == ("mass_kg" in readings):
        what = "gives both mass and force" if by_force else "gives neither a mass nor a force"
        raise InputError(what, where=where, remedy="give mass_g, or force_y_N and force_z_N")
    pull = gravity_antenna_m_s2.tolist()
    if not by_force and not any(pull):
        raise InputError("a mass pulls nowhere without gravity", where=where, remedy="give force_y_N and force_z_N")
    along = 0.0 if by_force else abs(pull[0]) / math.hypot(*pull)
    # part of a weight's pull: a load of a session has no component along the antenna
    if along > 0.02:
        what = f"at these joint angles {100 * along:.0f} % of the weight pull along the antenna"
        raise InputError(what, where=where, remedy="hang weights on a level antenna; or give force_y_N, force_z_N")
    force = [part or 0.0 for part in entered] if by_force else [readings["mass_kg"] * part for part in pull[1:]]
    if not any(force):
        raise InputError("the force is zero", where=where, remedy="free frames belong to the step before")
    return readings | dict(zip(("force_y_N", "force_z_N"), force, strict=True))
