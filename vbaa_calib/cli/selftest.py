"""`vbaa selftest --board board.yaml`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError

_PICTURES = 5
_MOST_PICTURES = 1000


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--board", type=Path, required=True, help="board.yaml, or a session.yaml")
    parser.add_argument(
        "--repeats",
        type=int,
        default=_PICTURES,
        metavar="N",
        help=f"poses for each of 9 sizes and blurs (default: {_PICTURES})",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the poses and the noise (default: 0)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw the board with known corners, detect it, report the errors. Returns the numbers."""
    import cv2
    import numpy as np

    from vbaa_calib.detect.board.board_file import load_board
    from vbaa_calib.doctor.detector_test import OPENCV, OURS, as_text, is_sound, mean_bias_px, try_detectors, verdict

    if not 1 <= args.repeats <= _MOST_PICTURES:
        raise InputError(f"--repeats is {args.repeats}", remedy=f"give a number from 1 to {_MOST_PICTURES}")
    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}", remedy="give a whole number from 0 on")
    spec = load_board(args.board)
    rows = try_detectors(spec, args.repeats, args.seed)
    sentences = verdict(rows)
    say(as_text(rows))
    for sentence in sentences:
        say(sentence)
    biases = {name: mean_bias_px(rows, name) for name in (OPENCV, OURS)}
    return {
        "opencv": cv2.__version__,
        "board": spec.to_dict(),
        "pictures": args.repeats,
        "seed": args.seed,
        "sound": is_sound(rows),
        "bias_px": {name: bias.tolist() if np.isfinite(bias).all() else None for name, bias in biases.items()},
        "verdict": sentences,
        "rows": [row.to_dict() for row in rows],
    }
