"""Other calibrators on the same corners, each in the interpreter that has it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from targets.board import corner_points

from .rigs import BOARD, Draw

PEERS = {"lensboy": "pip install lensboy", "mrcal": "apt install mrcal python3-mrcal"}
"""Importable name → where to get it."""

INTERPRETERS = "VBAA_PEER_PYTHON"
"""Environment variable: more interpreters to look for peers in, separated as PATH is."""

_SYSTEM_PYTHON = "/usr/bin/python3"
_SCRIPT = Path(__file__).with_name("peer_script.py")
_LOOK_S, _SOLVE_S = 60.0, 1800.0


@dataclass(frozen=True, eq=False)
class _PeerAnswer:
    """What a peer makes of one draw.

    Attributes
    ----------
    intrinsics : (4 + k,) in OpenCV's order, or None where it failed. failure : why.
    seconds : of the solve alone, imports and files left out.
    kept : per view (N,), which corners it used.
    """

    intrinsics: np.ndarray | None
    seconds: float
    kept: list[np.ndarray]
    failure: str = ""


def _interpreters() -> list[str]:
    """Where peers are looked for: this interpreter, the system's, and those in `VBAA_PEER_PYTHON`."""
    named = [path for path in os.environ.get(INTERPRETERS, "").split(os.pathsep) if path]
    return list(dict.fromkeys([*named, sys.executable, _SYSTEM_PYTHON]))


_ASK = """
import importlib.metadata, numpy, {peer}
try:
    print(importlib.metadata.version("{peer}"))
except importlib.metadata.PackageNotFoundError:
    print(getattr({peer}, "__version__", "without a version"))
"""


@cache
def _version(interpreter: str, peer: str) -> str | None:
    """What an interpreter that imports the peer says of it; None of one that does not."""
    try:
        asked = subprocess.run(
            [interpreter, "-c", _ASK.format(peer=peer)], capture_output=True, text=True, timeout=_LOOK_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return None if asked.returncode else asked.stdout.strip()


def interpreter_of(peer: str) -> str | None:
    """The first interpreter that imports the peer, or None."""
    return next((path for path in _interpreters() if _version(path, peer) is not None), None)


def versions() -> dict[str, str]:
    """Peer → its version and interpreter, or "absent"."""
    found = {peer: interpreter_of(peer) for peer in PEERS}
    return {peer: f"{_version(path, peer)} ({path})" if path else "absent" for peer, path in found.items()}


def absence(peer: str) -> str:
    """Why there are no numbers of a peer that is not found."""
    return f"absent ({PEERS[peer]}; {INTERPRETERS} names the interpreter that has it)"


def solve_with(peer: str, interpreter: str, draws: Sequence[Draw]) -> list[_PeerAnswer]:
    """The peer's answers to draws of one rig, with the true lens model and its own defaults for the rest."""
    lengths = [[len(view.ids) for view in given.views] for given in draws]
    with tempfile.TemporaryDirectory() as folder:
        problems, answers = Path(folder) / "problems.npz", Path(folder) / "answers.npz"
        np.savez(
            problems,
            points_m=corner_points(BOARD),
            columns=BOARD.squares_x - 1,
            spacing_m=BOARD.square_m,
            image_size=draws[0].rig.image_size,
            lens=draws[0].rig.lens,
            focal_px=draws[0].rig.intrinsics[0],
            draw=np.repeat(np.arange(len(draws)), [sum(counts) for counts in lengths]),
            view=np.concatenate([np.repeat(np.arange(len(counts)), counts) for counts in lengths]),
            ids=np.concatenate([view.ids for given in draws for view in given.views]),
            corners_px=np.concatenate([view.corners_px for given in draws for view in given.views]),
        )
        failure = _run([interpreter, str(_SCRIPT), peer, str(problems), str(answers)])
        if failure:
            return [_PeerAnswer(None, np.nan, [], failure) for _ in draws]
        found = dict(np.load(answers))
    kept = np.split(found["kept"], np.cumsum([count for counts in lengths for count in counts])[:-1])
    answered, first = [], 0
    for number, counts in enumerate(lengths):
        intrinsics, failed = found["intrinsics"][number], str(found["failures"][number])
        own = kept[first : first + len(counts)]
        first += len(counts)
        usable = intrinsics if np.all(np.isfinite(intrinsics)) else None
        answered.append(_PeerAnswer(usable, float(found["seconds"][number]), own, failed))
    return answered


def _run(command: Sequence[str]) -> str:
    """What went wrong, in words; empty if nothing did."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_SOLVE_S, check=False)
    except subprocess.TimeoutExpired:
        return f"no answer within {_SOLVE_S:.0f} s"
    if done.returncode:
        return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    return ""
