"""A picture of another size than those before it."""

from __future__ import annotations

from ...diagnosis import Diagnosis

_SAME_SHAPE = 0.01


def resolution_changed(size: tuple[int, int], first: tuple[int, int]) -> Diagnosis | None:
    """What to make of a picture of `size` (width, height) px when the first one had another; None where it had not."""
    if tuple(size) == tuple(first):
        return None
    seen = f"the picture is {size[0]}x{size[1]} px, the first one {first[0]}x{first[1]} px"
    name, cause, remedy = _cause(size, first)
    return Diagnosis(name, f"{seen}: {cause}", remedy, grave=True)


def _cause(size: tuple[int, int], first: tuple[int, int]) -> tuple[str, str, str]:
    if (size[1], size[0]) == tuple(first):
        return (
            "picture_turned",
            "width and height are exchanged",
            "hold the camera as before, and switch off that pictures are turned upright",
        )
    wide, high = size[0] / first[0], size[1] / first[1]
    if abs(wide - high) < _SAME_SHAPE * high:
        return (
            "picture_scaled",
            f"it is scaled by {wide:.3g}",
            "set the camera to the resolution of the first picture, and copy originals, no previews",
        )
    if wide <= 1.0 and high <= 1.0:
        cause = "it is cropped, or the camera is in another mode"
    else:
        cause = "the camera is in another mode, which may cut off a border or use other pixels"
    return (
        "picture_cropped",
        cause,
        "set the camera to the mode of the first picture, or begin anew in this one: the lens is another for it",
    )
