"""Standard deviations of a tracker's points: measured where they are absent, widened where they are far too small."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.interpolate import LSQUnivariateSpline

from benchmarks.mistakes.recordings import Recording, motion, recorded
from benchmarks.mistakes.rigs import KINDS, Kind, known_rig
from estimator import ContactEstimator
from estimator.contact.inputs import OutlierSettings, point_scatter
from estimator.contact.recording import measured_lines
from estimator.table.contacts import Measured
from vbaa_calib.native import core
from vbaa_calib.session import Frame


def recording(kind: Kind, seed: int, **changes: float) -> Recording:
    """A recording of a calibrated rig whose tracker has other errors than the calibration's pictures."""
    known, rng = known_rig(kind, 0), np.random.default_rng(seed)
    world = replace(known.world, kind=replace(kind, **changes))  # type: ignore[arg-type]
    return recorded(known.rig, [world] * 40, motion(kind, 40, rng), seed)


def scatter(several: list[Measured], stated: float = 1.0) -> float:
    return point_scatter([one.points_px for one in several], [stated * one.sigma_px for one in several])


@pytest.mark.parametrize("along", [0.0, 0.3, 0.6])
def test_the_scatter_is_what_the_points_really_have(along: float) -> None:
    """Whatever the rig, the bend, and how far neighbours share errors; in any unit and order."""
    for seed, kind in enumerate(KINDS):
        several = recording(kind, seed, along=along).frames
        factor = scatter(several)
        assert 0.8 < factor < 1.2
        assert scatter(several, 0.2) == pytest.approx(5.0 * factor)
        rng = np.random.default_rng(seed)
        mixed = [replace(one, points_px=rng.permutation(one.points_px)) for one in several]
        assert scatter(mixed) == pytest.approx(factor)


def test_points_lie_off_the_spline_of_least_squares() -> None:
    along, rng = np.sort(np.random.default_rng(0).uniform(-1.0, 1.0, 300)), np.random.default_rng(1)
    line = np.column_stack([100.0 * along, 8.0 * along**2 + rng.normal(size=300)])
    centred = line - line.mean(axis=0)
    (cos, sin) = np.linalg.svd(centred)[2][0] * np.sign(np.linalg.svd(centred)[2][0, 0])
    x, y = centred @ [cos, sin], centred @ [-sin, cos]
    knots = np.interp(np.linspace(0.0, 299.0, 9)[1:-1], np.arange(300), x)
    spline = LSQUnivariateSpline(x, y, knots)
    expected = (y - spline(x)) / np.hypot(1.0, spline.derivative()(x)) / 0.5
    found = core.search.off_smooth_curve(rng.permutation(line), np.full(300, 0.5), OutlierSettings())
    assert found == pytest.approx(expected, abs=1e-6)


def tabled(was: Recording, stated: float | None) -> tuple[list[Frame], Mapping[int, np.ndarray]]:
    """The same as a tracker's table, with so much of each standard deviation, or none."""
    frames, lines = [], {}
    for index, one in enumerate(was.frames):
        frames.append(Frame(None, one.pan_rad, one.tilt_rad, one.moment_Nm, index, time_s=one.time_s))
        sigma = np.full(len(one.points_px), np.nan) if stated is None else stated * one.sigma_px
        lines[index] = np.column_stack([one.points_px, sigma])
    return frames, lines


@pytest.mark.parametrize("stated", [None, 0.2])
def test_contacts_know_how_well_a_tracker_sees(stated: float | None) -> None:
    """One four times as coarse as the calibration's pictures, whose table has no sigma_px, or a fifth of it."""
    errors, located, touched = [], 0, 0
    for kind in KINDS[1:]:
        was = recording(kind, 7, sigma_px=4.0 * kind.sigma_px)
        several = list(measured_lines(was.rig, *tabled(was, stated)))
        assert [one.sigma_factor for one in several] == pytest.approx([1.0 if stated is None else 5.0] * 40, rel=0.2)
        for row, contact in enumerate(ContactEstimator(was.rig).run(several)):
            touched += bool(was.motion.touched[row])
            if contact.status == "ok":
                located += 1
                errors.append((contact.distance_m - was.truth.distance_m[row]) / contact.distance_std_m)
    assert located > 0.6 * touched
    assert np.abs(errors).max() < 4.5
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


def test_frames_by_hand_know_how_well_a_tracker_sees() -> None:
    """From Python without sigma_px the points' own scatter counts, in pixels, on plane C, and for tensors with
    gradients among the readings; it is never less than the calibration's pictures had."""
    for kind in KINDS[1:]:
        was = recording(kind, 7, sigma_px=4.0 * kind.sigma_px)
        estimator, several = ContactEstimator(was.rig), was.frames
        readings = [np.array([getattr(one, name) for one in several]) for name in ("moment_Nm", "pan_rad", "tilt_rad")]
        lines = [one.points_px for one in several]
        own = estimator.estimate_batch(lines, *readings)
        true = estimator.estimate_batch(lines, *readings, sigma_px=4.0 * kind.sigma_px)
        assert (own.status == true.status).mean() > 0.9
        ratio = own.distance_std_m / true.distance_std_m
        assert 0.85 < np.nanmedian(ratio) < 1.15
        on_plane = was.rig.camera_on_plane()(lines[0])[0]
        given = {
            name: torch.tensor(column[0], requires_grad=True)
            for name, column in zip(("moment", "pan", "tilt"), readings, strict=True)
        }
        assert estimator.estimate(plane_xy_m=on_plane, **given).status == estimator.estimate(lines[0], **given).status
