"""Many points at once, in pieces that stay in the processor's cache; the hard points come together at the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from ..arrays import Array

PIECE = 16384
"""Points in a piece. Smaller ones pay more for calls: with 4096, a fourth to a third more time."""

PieceWork = Callable[[Array, Array, bool], Sequence[Array]]
"""(x, y, whether to spare no effort) → the results of these points, and last which of them deserve more effort."""


def in_pieces(work: PieceWork, x: Array, y: Array, results: Sequence[Array]) -> None:
    """Work on points (n,) and write into results, each (n,), possibly strided.

    In pieces, points that need more effort are put off and worked on together: an effort takes some hundred array
    operations however few its points. Tensors, of which a device has room for all, are one piece.
    """
    if isinstance(x, torch.Tensor) or len(x) <= PIECE:
        _store(results, ..., work(x, y, True))
        return
    put_off = np.empty(len(x), bool)
    for start in range(0, len(x), PIECE):
        piece = slice(start, start + PIECE)
        _store((*results, put_off), piece, work(x[piece], y[piece], False))
    (rest,) = put_off.nonzero()
    if rest.size:
        _store(results, rest, work(x[rest], y[rest], True))


def _store(results: Sequence[Array], where: Any, values: Sequence[Array]) -> None:
    for result, value in zip(results, values, strict=False):
        result[where] = value
