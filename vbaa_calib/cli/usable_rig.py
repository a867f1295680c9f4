"""The rig that a verb uses: one with a wrong calibration only if the user accepts it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError

if TYPE_CHECKING:
    from vbaa_calib.rig import Rig


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the option that accepts a wrong rig."""
    parser.add_argument(
        "--accept-rig", action="store_true", help="use the rig although the verdict on its calibration is wrong"
    )


def usable_rig(path: Path, accept_wrong: bool = True) -> Rig:
    """The rig in a rig.json. A wrong calibration is reported if it is accepted; otherwise raises InputError."""
    from vbaa_calib.rig import Rig

    rig = Rig.load(path)
    if rig.verdict.severity != "wrong":
        return rig
    worst = rig.verdict.findings[0] if rig.verdict.findings else None
    words = f"the verdict on its calibration is wrong{f': {worst.words}' if worst else ''}"
    if not accept_wrong:
        remedy = worst.remedy if worst else "calibrate again"
        raise InputError(words, where=path, remedy=f"{remedy}; or use it as it is with --accept-rig")
    say(f"warning, {path}: {words}; it is used all the same")
    return rig
