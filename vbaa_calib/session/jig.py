"""Possible mistakes in the jig's entries: signs, exchanged axes, turned boards, other units."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.geometry import Pose


def jig_alternatives(
    jig: Pose, opposite_m: np.ndarray | None = None, thickness_m: float = 0.0
) -> list[tuple[str, Pose]]:
    """Alternatives for a T_antenna_board that was entered as `jig`: (the entry that would be wrong, in words; pose).

    One mistake at a time, the commonest first, and no pose twice: of two that lead to the same pose the commoner
    remains. Pure geometry, which decides nothing: an alternative is likely if it puts the free antenna where it is
    seen.

    jig : of the printed face, as `Session` has it. opposite_m : (2,) x and y of the corner that becomes the board's
        origin when the board is turned round; with it, a board that was measured to that corner is among the
    alternatives. thickness_m : between the jig's back and the printed face.
    """
    behind = Pose(np.eye(3), np.array([0.0, 0.0, thickness_m]))
    back, face = jig @ behind, behind.inverse()
    t, rotation = back.translation_m, back.rotation
    found, matrices = list[tuple[str, Pose]](), [jig.matrix]

    def add(words: str, back: Pose, face: Pose = face) -> None:
        pose = back @ face
        apart = np.abs(np.array(matrices) - pose.matrix).max(axis=(1, 2))
        # nearer, the corner is in the antenna; farther away, no camera sees both
        if apart.min() > 1e-6 and 1e-3 <= np.linalg.norm(pose.translation_m) <= 3.0:
            found.append((words, pose))
            matrices.append(pose.matrix)

    def turned(words: str, turn: np.ndarray) -> None:
        add(words, Pose(rotation @ turn, t))

    for axis, name in enumerate("xyz"):
        add(f"the sign of {name}", Pose(rotation, t * np.where(np.arange(3) == axis, -1.0, 1.0)))
    add("the signs of x, y and z: measured from the board to the clamp", Pose(rotation, -t))
    for unit, factor in (("m", 1e3), ("cm", 10.0), ("inches", 25.4)):
        add(f"the unit: {unit} taken for mm", Pose(rotation, factor * t))
    for unit, factor in (("mm", 1e-3), ("cm", 1e-2), ("inches", 0.0254)):
        add(f"the unit: {unit} taken for m", Pose(rotation, factor * t))
    add("the decimal point: a place too far to the right", Pose(rotation, 0.1 * t))
    for a, b in ((0, 1), (1, 2), (0, 2)):
        order = [b if axis == a else a if axis == b else axis for axis in range(3)]
        add(f"{'xyz'[a]} and {'xyz'[b]} exchanged", Pose(rotation, t[order]))
    half_turn = np.diag([-1.0, -1.0, 1.0])
    if opposite_m is not None:
        opposite = Pose(half_turn, np.array([*opposite_m, 0.0]))
        add("the corner: the board turned by 180°, measured to its other corner", back @ opposite)
    turned("the board's axes: both turned round, by 180°", half_turn)
    turned("the board's axes: its y turned round", np.diag([1.0, -1.0, -1.0]))
    turned("the board's axes: its x turned round", np.diag([-1.0, 1.0, -1.0]))
    turned("the board's axes: x and y exchanged", np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))
    for degrees in (90, -90):
        turn = Pose.from_rotvec(np.radians([0.0, 0.0, degrees]), np.zeros(3)).rotation
        turned(f"the board's axes: turned by {degrees}°", turn)
    add("the direction: the antenna's pose in the board's frame", back.inverse())
    turned("the direction of the turn", rotation.T @ rotation.T)
    x, y, z, w = back.to_dict()["rotation_xyzw"]
    add("the quaternion: w, x, y, z taken for x, y, z, w", Pose.from_quaternion(np.array([y, z, w, x]), t))
    for words, other_m in (
        ("left out: the jig was measured to the printed face", 0.0),
        ("to the other side", -thickness_m),
        ("in cm, taken for mm", 10.0 * thickness_m),
        ("a decimal place too large", 0.1 * thickness_m),
    ):
        add(f"the board's thickness {words}", back, Pose(np.eye(3), np.array([0.0, 0.0, -other_m])))
    return found


def jig_doubts(jig: Pose, length_m: float) -> list[Diagnosis]:
    """Implausible parts of a jig's offset (T_antenna_board), which need no picture. length_m : of the antenna."""
    size_m = float(np.linalg.norm(jig.translation_m))
    small, most_m = 0.0 < size_m < 1e-3, max(5.0 * length_m, 1.0)
    if not small and size_m <= most_m:
        return []
    units = {1e3: "m", 10.0: "cm", 25.4: "inches"} if small else {1e-3: "mm", 1e-2: "cm", 0.0254: "inches"}
    likely = [
        f"in {name} (then it is {1e3 * factor * size_m:.3g} mm)"
        for factor, name in units.items()
        if 0.05 * length_m < factor * size_m <= most_m
    ]
    words = f"the jig would hold the board's corner {_length(size_m)} from the clamp of a {_length(length_m)} antenna"
    remedy = f"was it typed {' or '.join(likely)}?" if likely else "is the unit right?"
    return [Diagnosis("jig_offset_unit", words, remedy, "wrong")]


def _length(size_m: float) -> str:
    return f"{1e3 * size_m:.3g} mm" if size_m < 1.0 else f"{size_m:.4g} m"
