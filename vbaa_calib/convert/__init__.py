"""Other programs' camera files: all formats, and which one a file is."""

from __future__ import annotations

from pathlib import Path

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_text

from . import colmap, kalibr, mrcal, opencv, ours, ros
from .values import Format

FORMATS: dict[str, Format] = {
    module.FORMAT.name: module.FORMAT for module in (ours, ros, opencv, kalibr, mrcal, colmap)
}
"""Name on the command line → format."""


def guessed(path: Path) -> Format:
    """The one format that a file looks like. Raises InputError where none or several do."""
    text = read_text(path)
    found = [each for each in FORMATS.values() if each.fits(text)]
    if len(found) == 1:
        return found[0]
    looks = " or ".join(each.what for each in found) or "none of the files that are known here"
    raise InputError(f"looks like {looks}", where=path, remedy=f"say which with --from: {', '.join(FORMATS)}")
