"""Plane C by all three ways of one rendered session: they agree, and a wrong one is named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from targets.board import corner_points
from vbaa_calib.calibrate.antenna.session_rig import ExpectedAntenna, nominal_parameters, observe
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.pipeline import calibrate, stills_prior
from vbaa_calib.calibrate.plane_c import PlaneViews, find_plane, picture_folders, read_views
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.polyline import beside
from vbaa_calib.detect.board.corners import detect_folder
from vbaa_calib.geometry import Pose
from vbaa_calib.session import Session, Still, load_session, read_loads, read_noload
from vbaa_calib.simulate.scene.scene import Scene, bundled_scene
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.write import write_session

WAYS = {
    "kinematics": {"axis_offset_m": 0.002, "axis_skew_deg": 0.3, "tilt_zero_deg": 0.25},
    "sweep": True,
    "over": {"height_m": 0.012, "center_m": [0.13, 0.0], "turn_deg": 8.0, "pictures": 1},
}


@dataclass(frozen=True, eq=False)
class Rendered:
    """A session that shows plane C in three ways, what is true of it, and its lens."""

    scene: Scene
    session: Session
    lens: LensSolution
    views: PlaneViews


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Rendered:
    folder = tmp_path_factory.mktemp("ways")
    data = read_yaml(bundled_scene("upright_knife")) | WAYS
    # two thirds of the picture, and fewer of the board
    data["camera"]["image_size"] = [640, 480]
    data["camera"]["matrix"] = [[645.3, 0.0, 321.9], [0.0, 646.7, 236.8], [0.0, 0.0, 1.0]]
    data["intrinsics"]["pictures"] = 10
    (folder / "scene.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    scene = load_scene(folder / "scene.yaml")
    stroke = replace(scene.recording.sweeps[0], frames=1, free_frames=0)
    scene = replace(scene, recording=replace(scene.recording, sweeps=(stroke,)))
    write_session(scene, folder / "session", recording_pictures=False)
    session = load_session(folder / "session")
    lens = solve_intrinsics(detect_folder(session.root / "intrinsics", session.board), session.board, "opencv4")
    return Rendered(scene, session, lens, read_views(session))


def off_std(pose: Pose, covariance: np.ndarray, true: Pose) -> np.ndarray:
    """(6,) a pose's errors over their deviations."""
    return pose.tangent_from(true) / np.sqrt(np.diag(covariance))


def test_three_ways_agree_and_the_joints_are_found(rendered: Rendered) -> None:
    lens = rendered.lens
    plane = find_plane(rendered.session, lens.camera, lens.board_shape, rendered.views)
    assert [estimate.way for estimate in plane.estimates] == ["jig", "sweep", "over board"]
    assert all(difference.agrees for difference in plane.differences)
    for estimate in plane.estimates:
        covariance = lens.camera.covariance
        whole = estimate.covariance + estimate.lens_sensitivity @ covariance @ estimate.lens_sensitivity.T
        off = off_std(estimate.T_antenna_camera, whole, rendered.scene.T_antenna_camera)
        assert np.abs(off).max() < 4.0, (estimate.way, off)
    true = rendered.scene.kinematics
    assert plane.kinematics.axis_skew_rad == pytest.approx(true.axis_skew_rad, abs=4e-4)
    assert plane.kinematics.axis_offset_m == pytest.approx(true.axis_offset_m, abs=2e-4)
    # what the sweep and the pose leave open of the axes holds what they are off
    names = ("axis_skew_rad", "axis_offset_m", "tilt_zero_rad")
    missed = np.array([getattr(plane.kinematics, name) - getattr(true, name) for name in names])
    assert (np.abs(missed) < 4.0 * plane.kinematics.axes_std).all()
    assert (plane.kinematics.axes_std < [4e-3, 4e-4, 4e-3]).all()
    # the zero of the tilt is what sweep and jig say together
    assert plane.kinematics.tilt_zero_rad == pytest.approx(true.tilt_zero_rad, abs=8e-4)


def test_a_jig_that_is_not_where_it_is_said_to_be_stands_alone(rendered: Rendered) -> None:
    shifted = Pose(np.eye(3), np.array([0.0, 4e-3, 0.0])) @ rendered.session.T_antenna_board
    wrong = replace(rendered.session, T_antenna_board=shifted)
    views = replace(rendered.views, over=None)
    with pytest.raises(
        InputError, match=r"jig and sweep differ by .* one of them is wrong: the board in the jig lies off"
    ):
        find_plane(wrong, rendered.lens.camera, rendered.lens.board_shape, views)
    # said to be known to no better than that, it agrees
    doubtful = replace(wrong, jig_translation_std_m=4e-3)
    plane = find_plane(doubtful, rendered.lens.camera, rendered.lens.board_shape, views)
    assert plane.differences[0].agrees


def test_each_way_alone_will_do(rendered: Rendered) -> None:
    camera, flex, session = rendered.lens.camera, rendered.lens.board_shape, rendered.session
    swept = find_plane(session, camera, flex, PlaneViews(None, rendered.views.sweep, None))
    # the tilt's zero stays open without another way, and the deviation says so
    assert swept.kinematics.tilt_zero_rad == 0.0
    # it goes with the camera's pose, whose doubt it is
    swung = swept.kinematics.axes_by_pose[2] @ swept.estimates[0].covariance @ swept.kinematics.axes_by_pose[2]
    assert np.sqrt(swung) == pytest.approx(session.tilt_zero_std_rad, rel=0.01)
    assert np.sqrt(swept.estimates[0].covariance[1, 1]) == pytest.approx(session.tilt_zero_std_rad, rel=0.01)
    alone = PlaneViews(None, None, rendered.views.over)
    with pytest.raises(InputError, match=r"which of them is the clamp .* over\.clamp_px"):
        find_plane(session, camera, flex, alone)
    clamp, _ = camera.project(rendered.scene.T_antenna_camera.inverse() @ np.zeros(3))
    assert session.over is not None
    marked = replace(session, over=replace(session.over, clamp_px=(float(clamp[0]) + 9.0, float(clamp[1]))))
    over = find_plane(marked, camera, flex, alone)
    assert over.by_antenna_alone
    assert not swept.by_antenna_alone
    away = over.estimates[0].T_antenna_camera.tangent_from(rendered.scene.T_antenna_camera)
    # the antenna's own frame: its clamp is 14 mrad and 0.2 mm off the base's
    assert np.abs(away[3:]).max() < 5e-3
    assert np.abs(away[:3]).max() < 0.03


def test_a_session_without_a_way_is_refused(rendered: Rendered, tmp_path: Path) -> None:
    nothing = replace(rendered.session, root=tmp_path, T_antenna_board=None, over=None)
    with pytest.raises(InputError, match="jig is missing"):
        picture_folders(nothing)
    (tmp_path / "over").mkdir()
    with pytest.raises(InputError, match="over is missing"):
        picture_folders(nothing)


@pytest.mark.slow
def test_the_whole_calibration_takes_all_ways(rendered: Rendered) -> None:
    found = calibrate(rendered.session, "opencv4")
    off = off_std(found.rig.T_antenna_camera, found.rig.covariance[:6, :6], rendered.scene.T_antenna_camera)
    assert np.abs(off).max() < 4.0
    assert found.rig.antenna.stiffness_Nm2 == pytest.approx(
        rendered.scene.antenna.stiffness_Nm2 * rendered.scene.true.stiffness_factor, rel=2e-3
    )
    assert found.rig.kinematics.tilt_zero_rad == found.plane.kinematics.tilt_zero_rad != 0.0


def test_a_print_known_roughly_leaves_the_distance_to_the_board_open(rendered: Rendered) -> None:
    """A scale that is off by a part moves the camera away from the board by that part, and the covariance says so."""
    jig = PlaneViews(rendered.views.jig, None, None)
    lens, session = rendered.lens, rendered.session
    exact = find_plane(session, lens.camera, lens.board_shape, jig).estimates[0]
    rough = find_plane(replace(session, print_scale_std=0.01), lens.camera, lens.board_shape, jig).estimates[0]
    smaller = replace(session.board, square_m=0.99 * session.board.square_m, marker_m=0.99 * session.board.marker_m)
    shrunk = replace(lens.board_shape, nominal_m=corner_points(smaller))
    moved = find_plane(replace(session, board=smaller), lens.camera, shrunk, jig).estimates[0]
    step = moved.T_antenna_camera.tangent_from(exact.T_antenna_camera)
    added = rough.covariance - exact.covariance
    np.testing.assert_allclose(added[3:, 3:], np.outer(step[3:], step[3:]), rtol=0.03, atol=1e-9)
    np.testing.assert_allclose(added[:3], 0.0, atol=1e-15)


def test_a_load_before_other_things_is_looked_at_with_its_own_paint(rendered: Rendered, tmp_path: Path) -> None:
    """Its picture inverted. Free antennas are looked at with one paint, which the rig keeps."""
    session, lens = rendered.session, rendered.lens
    plane = find_plane(session, lens.camera, lens.board_shape, rendered.views)
    before = stills_prior(session, lens, plane)
    expected = ExpectedAntenna(session.antenna, before.camera, before.start, nominal_parameters(session.antenna))
    noload, loads = read_noload(session), read_loads(session)
    _, learnt = observe(session, plane.kinematics, noload, expected, "free antenna")

    def inverted(still: Still) -> Still:
        path = tmp_path / still.image.name
        cv2.imwrite(str(path), 255 - cv2.imread(str(still.image)))
        return replace(still, image=path)

    both = (loads[0], inverted(loads[0]))
    (usual,), (own,) = (observe(session, plane.kinematics, [one], learnt, "")[0] for one in both)
    assert own.paint != usual.paint == learnt.paint
    assert np.abs(beside(usual.points_px, own.points_px)[1]).max() < 0.3
    with pytest.raises(InputError, match="no antenna found"):
        observe(session, plane.kinematics, [inverted(noload[0])], learnt, "")


def _turned(matrix: np.ndarray, about: list[float]) -> np.ndarray:
    """Homography of a camera that turned by 0.3°."""
    turn = Pose.from_rotvec(np.radians(0.3) * np.array(about), np.zeros(3)).rotation
    return matrix @ turn @ np.linalg.inv(matrix)
