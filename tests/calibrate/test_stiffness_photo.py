"""EI from photographs: simulated ones drawn here from an integrated elastica, and real ones beside hand-drawn lines."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from vbaa_calib.calibrate.photo.centreline import RodLine, search_rod
from vbaa_calib.calibrate.photo.stiffness import PhotoSetting, PhotoStiffness, solve_photo
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import read_picture
from vbaa_calib.core.polyline import offsets_from

from ..csv_files import read_rows

DATA = Path(__file__).parents[3] / "shared/data"
HAND = Path(__file__).with_name("hand_drawn_centrelines.csv")
LENGTH = 0.2
YARNS = [f"{length}cm_{number}" for length in (10, 20) for number in range(1, 6)]


def rod(bend, load: float, weight: float, start: float = 0.0) -> np.ndarray:
    """(N, 2) u, v in metres of a rod clamped at 0 in the direction `start`, gravity along +v.

    bend(s, M) is its curvature at arc length s under the moment M; integrated from the tip, whose angle is looked for.
    """

    def back(tip: float):
        def slope(q: float, state: np.ndarray) -> list[float]:
            angle, moment = state[:2]
            return [-bend(LENGTH - q, moment), (weight * q + load) * np.cos(angle), -np.cos(angle), -np.sin(angle)]

        return solve_ivp(slope, (0.0, LENGTH), [tip, 0.0, 0.0, 0.0], rtol=1e-7, atol=1e-10, dense_output=True)

    angles = np.linspace(start - 0.3, 1.9, 24)
    missed = [back(angle).y[0, -1] - start for angle in angles]
    turn = np.flatnonzero(np.diff(np.sign(missed)))[-1]
    found = back(brentq(lambda angle: back(angle).y[0, -1] - start, *angles[turn : turn + 2], xtol=1e-9))
    places = found.sol(np.linspace(LENGTH, 0.0, 400))[2:]
    return (places - places[:, :1]).T


def drawn(line_m: np.ndarray, rng: np.random.Generator, tilt: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """(480, 520) photograph of a rod held at the left border, 2000 px/m, by a camera 0.4 m away, tilted."""
    flat = np.column_stack([line_m - [0.12, 0.09], np.zeros(len(line_m))])
    for axis, angle in enumerate(tilt):
        turned = flat[:, axis] * np.cos(angle) - flat[:, 2] * np.sin(angle)
        flat[:, 2] = flat[:, axis] * np.sin(angle) + flat[:, 2] * np.cos(angle)
        flat[:, axis] = turned
    seen = 2000.0 * flat[:, :2] * 0.4 / (0.4 + flat[:, 2:])
    seen += [-seen[0, 0], 260.0]
    fine = np.stack([np.interp(np.linspace(0, 1, 4000), np.linspace(0, 1, len(seen)), each) for each in seen.T], axis=1)
    grid = np.stack(np.meshgrid(np.arange(520.0), np.arange(480.0)), axis=-1)
    away = cKDTree(fine).query(grid, distance_upper_bound=8.0)[0]
    ahead = (fine[-1] - fine[-9]) / np.hypot(*(fine[-1] - fine[-9]))
    away += (
        9.0
        * np.clip((grid - fine[-1]) @ ahead + 0.5, 0.0, 1.0)
        * (np.hypot(*(grid - fine[-1]).transpose(2, 0, 1)) < 8.0)
    )
    ground = 40.0 + 20.0 * grid[..., 0] / 520.0
    picture = ground + (190.0 - ground) * np.clip(4.5 - away, 0.0, 1.0) + rng.normal(0.0, 4.0, ground.shape)
    return np.clip(picture, 0, 255).astype(np.uint8)


def solved(picture: np.ndarray, setting: PhotoSetting, unloaded: np.ndarray | None = None) -> PhotoStiffness:
    return solve_photo([search_rod(each).line() for each in (picture, unloaded) if each is not None], setting)


@pytest.mark.parametrize(
    ("stiffness", "bow", "draws"),
    [
        (2e-4, -2.0, 2),
        *(pytest.param(*each, 4, marks=pytest.mark.slow) for each in ((2e-3, 0.0), (2e-4, -2.0), (4e-5, 3.0))),
    ],
)
def test_a_heavy_rod_is_recovered_within_its_deviation(stiffness: float, bow: float, draws: int) -> None:
    """EI per weight from slopes of 25° to beyond 80°, the tilt being what the deviation says, drawn at random."""
    rng = np.random.default_rng(int(1e6 * stiffness))
    scores, deviations = [], []
    for _ in range(draws):
        line = rod(lambda s, moment: moment / stiffness + bow, 0.0, 1.0, rng.normal(0.0, 0.1))
        found = solved(
            drawn(line, rng, tuple(rng.normal(0.0, np.radians(3.0), 2))), PhotoSetting(LENGTH, scale_std=1e-3)
        )
        scores.append((found.inverse - 1.0 / stiffness) / found.inverse_std)
        deviations.append(found.inverse_std * stiffness)
    assert np.abs(scores).max() < 3.2
    assert abs(np.mean(scores)) < 1.6
    assert 0.005 < np.median(deviations) < 0.2


@pytest.mark.parametrize("amount", ["2.0", *(pytest.param(each, marks=pytest.mark.slow) for each in ("0.5", "10.0"))])
def test_a_tip_load_by_the_closed_form(amount: str) -> None:
    if not (DATA / "elastica_reference.txt").exists():
        pytest.skip("no ../shared/data here")
    rows = [row.split() for row in (DATA / "elastica_reference.txt").read_text().splitlines() if row[0] != "#"]
    force, rng = 0.05, np.random.default_rng(1)
    _, _, sag, _, short, *_ = next(row for row in rows if row[0] == amount)
    stiffness = force * LENGTH**2 / float(amount)
    line = rod(lambda s, moment: moment / stiffness, force, 0.0)
    np.testing.assert_allclose(line[-1] / LENGTH, [1.0 - float(short), float(sag)], atol=2e-5)
    found = solved(drawn(line, rng), PhotoSetting(LENGTH, load_N=force, straight=True))
    assert found.interval[0] < stiffness < found.interval[1]
    assert found.inverse == pytest.approx(1.0 / stiffness, rel=0.03)


def hand_drawn() -> dict[str, np.ndarray]:
    """Picture → (N, 2) middles between the edges that a person marked: yarns of 10 cm as lines along 84 rows, the
    others as chords. Chords of 10cm_4 marked twice agree within 0.7 px, chords and lines of a yarn within 2 px."""
    middles: dict[str, list[np.ndarray]] = {}
    for row in read_rows(HAND):
        if row["drawing"] == ("2" if row["picture"].startswith("10cm") else "1"):
            one, other = (np.array([float(row[f"{name}{axis}_px"]) for axis in "uv"]) for name in ("", "other_"))
            middles.setdefault(row["picture"], []).append(0.5 * (one + other))
    return {name: np.array(each) for name, each in middles.items()}


@cache
def photographed(name: str) -> RodLine:
    """The rod in a real photograph, in colour as `vbaa stiffness` reads it."""
    path = DATA / ("fabric_strip/strip.jpg" if name == "strip" else f"yarn_over_ledge/{name}.jpg")
    if not path.exists():
        pytest.skip("no ../shared/data here")
    return search_rod(read_picture(path)).line()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name not in ("10cm_1", "20cm_4", "strip")))
        for name in (*YARNS, "strip")
    ],
)
def test_real_lines_run_where_a_person_draws_them(name: str) -> None:
    _, apart = offsets_from(photographed(name).curve_px, hand_drawn()[name])
    assert np.sqrt(np.mean(apart**2)) < 1.6
    assert np.median(np.abs(apart)) < 1.25


@pytest.mark.parametrize(("bar", "contrast", "reach"), [(40.0, 60.0, 380), (80.0, 40.0, 520)])
def test_no_rod_goes_round_a_corner(bar: float, contrast: float, reach: int) -> None:
    """A bar to which a rod is fixed is not a part of it: the rod is found, or none."""
    share, rng = np.linspace(0.0, 1.0, 200), np.random.default_rng(1)
    true, picture = np.stack([180.0 + 40.0 * share**2, 80.0 + 330.0 * share], axis=1), np.full((480, 640), 150.0)
    for line, grey, width in ((np.array([[180, 80], [reach, 74]]), bar, 9), (true, contrast, 11)):
        cv2.polylines(picture, [(16.0 * line).astype(np.int32)], False, 150.0 - grey, width, cv2.LINE_AA, 4)
    seen = cv2.GaussianBlur(picture, (0, 0), 1.0) + rng.normal(0.0, 2.0, picture.shape)
    try:
        found = search_rod(np.clip(seen, 0, 255).astype(np.uint8)).line()
    except InputError:
        return
    assert np.abs(offsets_from(true, found.curve_px)[1]).max() < 6.0


@pytest.mark.parametrize("most", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_one_yarn_is_as_stiff_at_either_length(most: int) -> None:
    """Random effects: each length's mean of 1/EI per weight, with the scatter of its own samples."""
    means = []
    for length, samples in ((10, (1, 2, 3, 4)), (20, (4, 1, 2, 3, 5))):  # the tip of 10cm_5 is not in its picture
        setting = PhotoSetting(0.01 * length)
        found = [solve_photo([photographed(f"{length}cm_{n}")], setting) for n in samples[:most]]
        value, variance = (np.array(each) for each in zip(*((f.inverse, f.inverse_std**2) for f in found), strict=True))
        fixed = np.average(value, weights=1.0 / variance)
        excess = np.sum((value - fixed) ** 2 / variance) - (len(value) - 1)
        inverse = 1.0 / variance
        between = max(0.0, excess / (inverse.sum() - (inverse**2).sum() / inverse.sum()))
        weights = 1.0 / (variance + between)
        means.append((np.average(value, weights=weights), 1.0 / weights.sum()))
    (short, one), (long, other) = means
    assert abs(short - long) < 2.0 * np.sqrt(one + other)
    assert 1e-5 < 1.0 / np.average([short, long], weights=[1 / one, 1 / other]) < 3e-5


def test_the_strip_bends_as_its_reference_says() -> None:
    """Moment at the same curvature, from 1 1/m to 10: less is a slope's noise, more is the clamp's edge."""
    line = photographed("strip")
    marks = np.array([[0.0, 0.0], [1000.0, 0.0]])
    found = solve_photo([line], PhotoSetting(marks_px=marks, marks_m=0.1101, weight_N_m=0.68))
    reference = np.loadtxt(DATA / "fabric_strip/reference_moment_curvature.csv", delimiter=",", skiprows=1)
    moments, curvatures = found.views[0].moment / 0.05, found.curvature
    for curvature in (1.0, 2.0, 4.0, 7.0, 10.0):
        last = int(np.flatnonzero((curvatures > curvature) & (found.views[0].middles_m < 0.08))[-1])
        ours = np.interp(curvature, curvatures[last + 1 : last - 1 : -1], moments[last + 1 : last - 1 : -1])
        theirs = np.interp(curvature, reference[::-1, 2], reference[::-1, 3])
        assert ours == pytest.approx(theirs, rel=0.15)
    assert found.linear.uncurled < 0.05


def test_the_verb_writes_what_it_says(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    line = rod(lambda s, moment: moment / 1e-3, 0.0, 1.0)
    cv2.imwrite(str(tmp_path / "rod.png"), drawn(line, np.random.default_rng(0)))
    out = [str(tmp_path / name) for name in ("out.json", "line.png", "moments.csv")]
    call = ["stiffness", str(tmp_path / "rod.png"), "--length", "0.2", "--weight", "0.3", "--json"]
    assert main([*call, "-o", out[0], "--overlay", out[1], "--moments", out[2]]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads(Path(out[0]).read_text())
    low, high = document["stiffness_interval_95_Nm2"]
    assert low < 0.3e-3 < high
    assert cv2.imread(out[1]) is not None
    assert len(Path(out[2]).read_text().splitlines()) == 1 + len(document["moment_curvature"])
    assert main([*call, "-o", out[0]]) == 2
    assert "--force" in capsys.readouterr().err


def test_a_phone_on_its_side_is_turned_upright(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Gravity and clicks are those of the picture that a viewer turns by its EXIF orientation."""
    upright = drawn(rod(lambda s, moment: moment / 1e-3, 0.0, 1.0), np.random.default_rng(0))
    stored = cv2.imencode(".jpg", cv2.rotate(upright, cv2.ROTATE_90_COUNTERCLOCKWISE))[1].tobytes()
    turn = b"Exif\0\0MM\0*\0\0\0\x08\0\x01" + bytes.fromhex("0112 0003 00000001 0006 0000 00000000")
    pictures = {"upright.jpg": cv2.imencode(".jpg", upright)[1].tobytes()}
    pictures["turned.jpg"] = stored[:2] + b"\xff\xe1" + (len(turn) + 2).to_bytes(2, "big") + turn + stored[2:]
    found = []
    for name, data in pictures.items():
        (tmp_path / name).write_bytes(data)
        assert main(["stiffness", str(tmp_path / name), "--length", "0.2", "--weight", "0.3", "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    one, other = ([*each["clamp_px"], *each["tip_px"], 1e6 * each["stiffness_Nm2"]] for each in found)
    assert one == pytest.approx(other, rel=0.02, abs=1.0)
