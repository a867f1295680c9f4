"""What came of frames, counted: every frame once, whatever the parts that are joined."""

from __future__ import annotations

import numpy as np

from estimator.table.contacts import LOCATED, STATUSES
from estimator.table.overview import Overview, overview_in_words
from vbaa_calib.session import Frame

KINDS = {
    "no_antenna": ("nothing in the picture looks like the antenna ({} % of its length seen)", "only {} usable points"),
    "failed": ("the points are not on this antenna: many of them lie {} px off", "points lie {} std off; or {} more"),
    "low_signal": ("the contact distance is known only to {} mm",),
    "ok": ("rod: linear would be {} std off",),
    "no_contact": ("the antenna has its free shape within its uncertainty",),
}


def drawn(count: int, rng: np.random.Generator) -> list[tuple[Frame, str, str, str]]:
    """Frames with or without readings; status, reason with other numbers each time, and the kind of it."""
    found = []
    for number in range(count):
        status = str(rng.choice(list(KINDS)))
        kind = str(rng.choice(KINDS[status]))
        value = f"{rng.normal(0.0, 10.0 ** rng.uniform(-3, 4)):.3g}"
        moment, joints = float(rng.choice([np.nan, 1e-3])), (bool(rng.integers(2)), True)
        frame = Frame(None, 0.0, 0.1, moment, frame=number, time_s=float(number), joints_read=joints)
        found.append((frame, status, kind.format(value, value), kind))
    return found


def counted(several: list[tuple[Frame, str, str, str]]) -> Overview:
    overview = Overview()
    for frame, status, reason, _ in several:
        overview.add_readings(frame)
        overview.add_result(frame.frame, status, reason)
    return overview


def test_every_frame_is_counted_once_and_parts_join_to_the_whole() -> None:
    for seed in range(8):
        several = drawn(200, np.random.default_rng(seed))
        whole, joined = counted(several).numbers(), Overview()
        for begin in range(0, 200, 64):
            joined.join(counted(several[begin : begin + 64]).numbers())
        assert joined.numbers() == whole
        lost = [each for each in several if each[1] not in (*LOCATED, "no_contact")]
        assert sum(whole["status"].values()) == whole["readings"]["frames"] == 200
        assert sum(one["frames"] for one in whole["reasons"]) == len(lost)
        assert len(whole["reasons"]) == len({(status, kind) for _, status, _, kind in lost})
        counts = [one["frames"] for one in whole["reasons"]]
        assert counts == sorted(counts, reverse=True)
        for one in whole["reasons"]:
            frame, status, reason, _ = several[one["frame"]]
            assert (frame.frame, status, reason) == (one["frame"], one["status"], one["reason"])
        read = [frame for frame, *_ in several]
        assert whole["readings"]["moment_Nm"] == sum(np.isfinite(frame.moment_Nm) for frame in read)
        assert whole["readings"]["pan_rad"] == sum(frame.joints_read[0] for frame in read)
        assert whole["readings"]["assumed_rad"] == {"pan_rad": 0.0}
        # the three commonest, and how many more
        printed = [int(line.split()[0]) for line in overview_in_words(whole) if line.startswith("  ")]
        assert printed == [*counts[:3], sum(counts[3:])]
        assert set(whole["status"]) <= set(STATUSES)
