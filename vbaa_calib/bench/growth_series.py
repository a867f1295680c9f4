"""The work whose cost is followed as it grows: what a size is, and how fast the cost may grow with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .growth_work import (
    batch_of_points,
    felt_object,
    joint_solve,
    lens_solve,
    one_picture,
    recording_of_frames,
    surface_of_contacts,
)

Work = Callable[[], object]


@dataclass(frozen=True)
class Series:
    """One kind of work.

    Attributes
    ----------
    name, unit : what grows. sizes, quick : how far it is followed; none: not with --quick.
    prepare : size and seed → what is timed; what comes before is not.
    time_exponent, memory_exponent : the largest that is all right. why : why so.
    """

    name: str
    unit: str
    sizes: tuple[int, ...]
    quick: tuple[int, ...]
    prepare: Callable[[int, int], Work]
    time_exponent: float
    memory_exponent: float
    why: str


SERIES = (
    Series(
        "frames, streamed",
        "frames",
        (100, 300, 1_000, 3_000, 10_000, 100_000),
        (40, 80, 160, 320, 640),
        recording_of_frames,
        1.0,
        1.0,
        "files in, table out; kept are each frame's row of recording.csv and its place in centrelines.csv, 0.5 kB",
    ),
    Series(
        "points per frame",
        "points",
        (10, 30, 100, 300, 1_000, 3_000, 10_000),
        (10, 30, 100, 300, 1_000),
        batch_of_points,
        1.0,
        1.0,
        "64 frames in a batch; each point is a row of the fit, the unknowns stay as many",
    ),
    Series(
        "picture size",
        "kpx",
        (100, 300, 1_000, 3_000, 8_000, 20_000),
        (100, 200, 400, 800),
        one_picture,
        1.0,
        1.0,
        "one picture from the file to the contact; every pixel is decoded and the antenna grows with the picture",
    ),
    Series(
        "views, lens",
        "views",
        (5, 10, 20, 50, 100, 200),
        (5, 10, 20),
        lens_solve,
        1.0,
        1.0,
        "a view's pose meets the others' only through the lens, which has nine numbers",
    ),
    Series(
        "stills, joint solve",
        "stills",
        (15, 30, 60, 120),
        (8, 12, 18),
        joint_solve,
        1.0,
        1.0,
        "stills share some twenty unknowns",
    ),
    Series(
        "contacts, surface",
        "contacts",
        (60, 90, 130, 190, 270, 380, 500),
        (40, 60, 90, 130),
        surface_of_contacts,
        3.0,
        2.0,
        "one Gaussian process over all touches, factored whole; that is why more than 500 are thinned",
    ),
    Series(
        "contacts, everything felt",
        "contacts",
        (100, 300, 1_000, 3_000, 10_000, 30_000),
        (),
        felt_object,
        1.0,
        1.0,
        "each contact once: common errors, track, events; the surface takes 500 of them",
    ),
)
