"""A rolling shutter and a long exposure are named where the antenna's movement makes them matter, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.contact.recording import FrameContact
from estimator.contact.source import _marked_by_shutter as marked_by_shutter
from estimator.table.contacts import Measured
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.detect.whisker.profile import measure
from vbaa_calib.session import Frame, Shutter

from ..detect.drawn_lines import SIZE, aside, background, bent, exposed, tube
from .drawn_frames import contact_of, rig_of, shape

PERIOD_S = 1.0 / 30.0
CLAMP = (40.0, 180.0)


@pytest.fixture(scope="module")
def curves() -> Curves:
    return shape(rig_of((320, 240)))


def path(turn_deg: float) -> np.ndarray:
    """The antenna, which leaves its clamp steeply."""
    return bent(CLAMP, -25.0, turn_deg)


def frames(curves: Curves, turns_deg: list[float], sigma_px: float = 0.03) -> list[FrameContact]:
    """A recording's contacts, the antenna bent so in each."""
    several = []
    for k, turn in enumerate(turns_deg):
        points = path(turn)
        frame = Frame(image=None, pan_rad=0.0, tilt_rad=0.0, moment_Nm=0.0, frame=k, time_s=k * PERIOD_S)
        measured = Measured(points, np.full(len(points), sigma_px), 0.0, 0.0, 0.0)
        several.append(FrameContact(frame, contact_of("ok", curves), measured))
    return several


def statuses(items: list[FrameContact], shutter: Shutter) -> list[str]:
    return [item.contact.status for item in marked_by_shutter(items, shutter, SIZE[0])]


def test_named_where_points_are_off_by_more_than_their_deviations_carry(curves: Curves) -> None:
    moving, rolling = frames(curves, [0.0, 1.0, 2.0, 3.0]), Shutter(readout_s=0.02)
    assert statuses(moving, rolling) == ["not_quasistatic"] * 4
    assert statuses(frames(curves, [0.0, 1.0, 2.0], 1.0), rolling) == ["ok"] * 3, "carried by the deviations"
    assert statuses(frames(curves, [2.0] * 3), rolling) == ["ok"] * 3, "at rest"
    assert statuses(frames(curves, [0.0, 1.0, 1.0, 1.0]), rolling)[1:] == ["ok"] * 3, "came to rest"
    assert statuses(moving, Shutter()) == statuses(moving, Shutter(exposure_s=0.03)) == ["ok"] * 4
    words = next(marked_by_shutter(moving, rolling, SIZE[0])).contact.reason
    assert "while the sensor is read out" in words
    assert "global shutter" in words
    blurred = list(marked_by_shutter(frames(curves, [0.0, 3.0, 6.0]), Shutter(exposure_s=0.03), SIZE[0]))
    assert all("expose shorter" in item.contact.reason for item in blurred)


def test_a_drawn_rolling_shutter_puts_points_off_by_as_much_as_is_said() -> None:
    """Each row is drawn when it is read; the truth is where the antenna is when the clamp's row is read."""
    rng = np.random.default_rng(1)
    moved_deg, steps = 3.0, 16
    ground = background(rng, 1.0)
    times = (np.arange(steps) + 0.5) / steps - CLAMP[1] / SIZE[0]
    shots = np.stack([ground + tube(path(moved_deg * time), 4.0, 100.0) for time in times])
    place = np.clip(np.arange(SIZE[0]) * steps / SIZE[0] - 0.5, 0, steps - 1.001)
    first, part = place.astype(int), (place % 1.0)[:, None]
    rows = np.arange(SIZE[0])
    light = shots[first, rows] * (1.0 - part) + shots[first + 1, rows] * part
    line = measure(exposed(light, rng), path(0.0), 4.0)
    off = aside(path(0.0), line.points_px)
    moved = aside(path(0.0), path(moved_deg))
    along = np.interp(line.points_px[:, 0], path(0.0)[:, 0], moved)
    said = along * (line.points_px[:, 1] - CLAMP[1]) / SIZE[0]
    assert np.abs(said).max() > 5.0 * np.median(line.sigma_px)
    assert np.abs(off - said).max() < 0.35 * np.abs(said).max()
    assert np.corrcoef(off, said)[0, 1] > 0.95
