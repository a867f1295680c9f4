"""Tables of benchmarks/limits.md that take minutes: `pytest -m slow -s` prints them anew."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.scenes import elastica_shapes, rod_shapes
from benchmarks.estimator.setup import TOWARDS_CLAMP, Setup
from estimator import ContactEstimator
from estimator.contact.motion import _inertia as inertia
from vbaa_calib.rig import Rig

from .contact_scenes import answered, rubbed, scene_deviations
from .test_motion import BEAM, swinging
from .vibrations import frequency_rad_s, mode_shape, modes

PAGE = Path(__file__).parents[2] / "benchmarks/limits.md"
LENGTH_M, SWING_M = 0.24, 0.1
SLOPES_DEG = (5.0, 15.0, 25.0, 35.0)
SEEN_DEG = (4.0, 8.0, 12.0, 18.0, 25.0)
CAMERAS = {
    "upright": (0.0, 0.0),
    "45° across the antenna": (45.0, np.pi / 2),
    "20° towards the clamp": (20.0, TOWARDS_CLAMP),
    "45° towards the clamp": (45.0, TOWARDS_CLAMP),
}


def rig_of(tilt_deg: float = 0.0, azimuth: float = TOWARDS_CLAMP, *, real: bool = False, exact: bool = True) -> Rig:
    """The bench's, its picture wide enough for antennas bent by 35°."""
    return Setup("brown", np.radians(tilt_deg), azimuth, swing_m=SWING_M, real=real, exact=exact).rig()


def printed(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[list[str]]:
    """Rows as given, and a Markdown table of them on the terminal."""
    kept = [list(row) for row in rows]
    print("\n| " + " | ".join(head) + " |")
    for row in kept:
        print("| " + " | ".join(row) + " |")
    return kept


def table_below(mark: str) -> list[list[str]]:
    """Body of the first table of the page after these words."""
    lines = PAGE.read_text(encoding="utf-8").split(mark, 1)[1].splitlines()
    first = next(index for index, line in enumerate(lines) if line.startswith("|"))
    body = []
    for line in lines[first + 2 :]:
        if not line.startswith("|"):
            break
        body.append([cell.strip() for cell in line.strip("|").split("|")])
    return body


def friction_left(exact: bool, reach: float) -> list[str]:
    """Deviation of the friction angle after noise-free frames at each slope; "–" without numbers."""
    given = rubbed(rig_of(exact=exact), [reach] * 4, SLOPES_DEG, 0.0, 0.3, made_by=elastica_shapes)
    return [f"{one.friction_angle_std_rad:.3f}".replace("nan", "–") for one in answered(given)]


@pytest.mark.parametrize(
    "reach", [pytest.param(0.25, marks=pytest.mark.slow), 0.5, pytest.param(0.75, marks=pytest.mark.slow)]
)
def test_what_is_left_of_friction(reach: float) -> None:
    """As in the page's table, to a tenth."""
    ways = [friction_left(exact, reach) for exact in (True, False)]
    cells = [f"{a}, {b}" for a, b in zip(*ways, strict=True)]
    (mine,) = printed(["l/L", *(f"{slope:.0f}°" for slope in SLOPES_DEG)], [[f"{reach:g}", *cells]])
    stated = table_below("deviation of the friction angle after")
    theirs = next(row for row in stated if row[0] == mine[0])
    for a, b in zip(*(" ".join(row).replace(",", "").split() for row in (mine, theirs)), strict=True):
        assert a == b or float(a) == pytest.approx(float(b), rel=0.1), f"{mine} is not {theirs}"


@pytest.mark.parametrize(("exact", "most"), [(True, 6.0), (False, 1.9)])
def test_the_price_of_friction(exact: bool, most: float) -> None:
    """What it costs in l not to know the angle: nothing at small slopes, less than this at large ones."""
    grown = []
    for reach in (0.25, 0.95):
        given = rubbed(rig_of(exact=exact), [reach] * 4, SLOPES_DEG, 0.0, 0.3, made_by=elastica_shapes)
        rough, slippery = (answered(given, "elastica", friction).numbers.std[:, 0] for friction in (0.2, 0.0))
        grown.append(rough / slippery)
    assert 0.99 < np.min(grown) < 1.1
    assert 0.9 * most < np.max(grown) < most


def known_f_z(camera: str, sigma_px: float, slope_deg: float, count: int = 60) -> tuple[float, float]:
    """Share of frames whose f_z is given and known to three deviations, and the largest error in deviations."""
    tilt, azimuth = CAMERAS[camera]
    rng = np.random.default_rng(int(100 * slope_deg) + len(camera))
    reach, roll = rng.uniform(0.3, 0.9, count), rng.uniform(-np.pi, np.pi, count)
    friction = np.clip(rng.normal(0.0, 0.2, count), -0.6, 0.6)
    rig = rig_of(tilt, azimuth, real=True, exact=False)
    given = rubbed(rig, reach, [slope_deg] * count, friction, roll, sigma_px=sigma_px, made_by=rod_shapes).noisy(rng)
    found = answered(given, blind=True)
    sure = np.abs(found.force_N[:, 2]) > 3.0 * found.force_std_N[:, 2]
    off = np.abs(scene_deviations(found, given))
    return float(sure.mean()), float(np.nanmax(off, initial=0.0))


@pytest.mark.slow
def test_vision_alone() -> None:
    """Shares within what 60 frames scatter by, and nothing far off."""
    rows, worst = [], 0.0
    for camera in CAMERAS:
        cells = [known_f_z(camera, sigma, slope) for sigma in (0.1, 0.03) for slope in SEEN_DEG]
        worst = max(worst, *(off for _, off in cells))
        rows.append([camera, *(f"{share:.2f}".lstrip("0") for share, _ in cells)])
    found = printed(["camera", *(f"{slope:.0f}°" for slope in 2 * SEEN_DEG)], rows)
    print(f"largest error: {worst:.1f} deviations")
    assert worst < 8.0
    stated = table_below("share of frames of which f_z is")
    gaps = [
        abs(float(a) - float(b)) for m, t in zip(found, stated, strict=True) for a, b in zip(m[1:], t[1:], strict=True)
    ]
    assert max(gaps) < 0.2


def test_ringing_that_is_seen() -> None:
    """First modes, and the share of their inertia that frames at each rate show: the page's table, to a hundredth."""
    rows = []
    for contact in (0.0, 0.3, 0.5, 0.7, 0.85):
        (wave,), (coefficients,) = modes(contact, 1)
        cells = [f"{contact:g}", f"{frequency_rad_s(wave) / (2 * np.pi):.1f}"]
        for rate_hz in (30.0, 60.0, 240.0, 1000.0):
            at = np.arange(int(0.6 * rate_hz) + 5) / rate_hz
            swing = 1e-4 * np.cos(frequency_rad_s(wave) * at)
            shape = swing[:, None] * mode_shape(BEAM.pieces_m, contact, wave, coefficients)
            cells.append(f"{np.nanmean(inertia(swinging(at, shape, contact), BEAM).response):.2f}")
        rows.append(cells)
    found = printed(["contact", "first mode, Hz", "30", "60", "240", "1000"], rows)
    for mine, theirs in zip(found, table_below("share of its inertia that is seen"), strict=True):
        assert float(mine[1]) == pytest.approx(float(theirs[1].split()[0]), abs=0.5)
        np.testing.assert_allclose([float(cell) for cell in mine[2:]], [float(c) for c in theirs[2:]], atol=0.011)


@pytest.mark.parametrize(("tilt_deg", "factor"), [(0.0, 0.5), (30.0, 2.0)])
@pytest.mark.parametrize("blind", [False, True])
def test_a_wrong_stiffness_hides(blind: bool, factor: float, tilt_deg: float) -> None:
    """benchmarks/limits.md: what is seen of the force follows EI, what is read does not; the distance hardly moves."""
    rig = rig_of(max(tilt_deg, 30.0 * blind))
    given = rubbed(rig, [0.4, 0.6, 0.8], [20.0 if blind else 8.0] * 3, 0.0, 0.6, made_by=elastica_shapes)
    parameters = rig.antenna.parameters + np.log(factor) * (np.arange(9) == 6)
    wrong = ContactEstimator(replace(rig, antenna=replace(rig.antenna, parameters=parameters)))
    moment = None if blind else given.moment_Nm
    found = wrong.estimate_batch(given.points_px, moment, given.pan_rad, given.tilt_rad, sigma_px=0.1)
    assert blind or (found.status == "ok").all()
    force = (found.force_N / given.force_N)[:, 1:]
    expected = np.full((3, 2), [factor, factor if blind else 1.0])
    known = np.isfinite(force)
    assert known[:, 0].all()
    assert known.sum() >= 5
    # over all forces along the line of sight the mean is not the likeliest
    std = (found.force_std_N / np.abs(given.force_N))[:, 1:]
    assert (
        np.abs(force - expected)[known] < (0.03 if blind else 0.08) * expected[known] + (0.5 * blind * std)[known]
    ).all()
    np.testing.assert_allclose(found.distance_m, given.distance_m, rtol=0.01)


@pytest.mark.slow
def test_neighbours_that_err_together() -> None:
    """A correlation of 0.5 between neighbours: as if of each three points there were one, so √3 off in deviations."""
    rng, count, off, loud = np.random.default_rng(6), 200, [], []
    for together in (0.0, 0.5):
        reach, slope, roll = rng.uniform(0.3, 0.8, count), rng.uniform(6.0, 20.0, count), rng.uniform(-0.9, 0.9, count)
        given = rubbed(rig_of(), reach, slope, 0.0, roll, made_by=elastica_shapes)
        noise = rng.normal(size=given.points_px.shape)
        for index in range(1, noise.shape[1]):
            noise[:, index] = together * noise[:, index - 1] + np.sqrt(1 - together**2) * noise[:, index]
        found = answered(replace(given, points_px=given.points_px + 0.1 * noise), "elastica", friction=0.0)
        off.append(float(np.sqrt(np.nanmean(scene_deviations(found, given)[:, 0] ** 2))))
        loud.append(float(np.mean(found.numbers.second_gain > 18.0)))
        print(f"correlation {together}: l off by {off[-1]:.2f} deviations rms, second force in {100 * loud[-1]:.1f} %")
    np.testing.assert_allclose(off, [1.0, 3.0**0.5], rtol=0.15)
    assert max(loud) < 0.03
