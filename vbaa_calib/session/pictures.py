"""Pictures that a session names, looked at before the long work."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..errors import InputError


def check_pictures(pictures: Iterable[Path], image_size: tuple[int, int], whose: str) -> None:
    """Raises InputError for the first picture that cannot be read or has another size than (width, height) px.

    Decoding is quick: better all of it before the long work than an error in the middle of it.
    """
    from ..images import read_gray

    for path in pictures:
        height, width = read_gray(path).shape
        if (width, height) != tuple(image_size):
            what = f"is {width}x{height} px, {whose} {image_size[0]}x{image_size[1]} px"
            raise InputError(what, where=path, remedy="use one camera at one resolution throughout")
