"""What pictures of the antenna have in common, free or loaded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...calibrate.diagnose_views import resolution_changed
from ...errors import InputError
from ...images import picture_from_bytes
from ..known import Known, still_of
from ..progress import Judged
from ..sources.offered import Offered


def found_antenna(known: Known, step: str, offered: Offered, readings: Mapping[str, float] | None) -> Judged:
    """A picture of the antenna, and whether the antenna is found in it.

    readings : SI, those of the session's table; None for a live preview, which is not searched.
    """
    size = offered.image.shape[1], offered.image.shape[0]
    first = known.image_size
    changed = None if first is None else resolution_changed(size, first)
    if changed is not None:
        return Judged(str(changed), hints=(changed,))
    if readings is None:
        return Judged()
    path = Path(offered.name)
    try:
        seen = known.observe(still_of(step, path, readings), step, picture_from_bytes(offered.data, path))
    except InputError as error:
        jig = "" if known.taken(step) else "; or what was said of the jig is wrong, so that it is looked for elsewhere"
        return Judged(f"{error.what}; shoot it again with the antenna lit and wholly in view{jig}")
    return Judged(words=f"antenna seen at {len(seen.points_px)} points")
