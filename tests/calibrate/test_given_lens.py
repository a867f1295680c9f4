"""A calibration that starts from a known lens agrees with the usual way, is as uncertain as it says, and is tested."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.bundle_adjustment import adjust_bundle
from vbaa_calib.calibrate.antenna.session_rig import make_rig, observe_stills
from vbaa_calib.calibrate.given_lens import GivenLens, given_solution, read_lens
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.calibrate.pipeline import prior_of_session
from vbaa_calib.calibrate.plane_c import find_plane, read_views
from vbaa_calib.camera import Camera
from vbaa_calib.cli.main import main
from vbaa_calib.convert import FORMATS
from vbaa_calib.convert.values import Exchanged
from vbaa_calib.geometry.covariance import independent_axes
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session
from vbaa_calib.simulate.scene.scene_file import load_scene

from ..small_scene import small_rig
from .synthetic_views import SPEC
from .test_diagnose_views import INTRINSICS, SIZE, pictures


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small session without pictures for the lens."""
    folder = tmp_path_factory.mktemp("bare") / "session"
    shutil.copytree(small_rig() / "session", folder, ignore=shutil.ignore_patterns("intrinsics", "recording"))
    return folder


def true_camera() -> Camera:
    lens = load_scene(small_rig() / "scene.yaml").lens
    return Camera(lens.model, lens.image_size, lens.matrix, lens.distortion)


def test_a_known_lens_gives_the_rig_of_the_usual_way(
    bare: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the covariance that its file states; or with an assumed one, which is named wherever the rig is.

    A file without distortion is that of somebody who did not measure it.
    """
    usual = Rig.load(small_rig() / "rig.json")
    forgotten = replace(true_camera(), distortion=np.zeros(4))
    for name, camera in (("vbaa", usual.camera), ("kalibr", forgotten)):
        file, out = tmp_path / name, tmp_path / f"{name}.json"
        file.write_text(FORMATS[name].write(Exchanged(camera)))
        assert main(["calibrate", str(bare), "--camera", str(file), "-o", str(out)]) == 0
        rig, quality = Rig.load(out), json.loads(out.read_text())["quality"]
        off = rig.T_antenna_camera.tangent_from(usual.T_antenna_camera)
        both = np.diag(rig.covariance)[:6] + np.diag(usual.covariance)[:6]
        assert np.all(np.abs(off) < 4.0 * np.sqrt(both))
        ratio = np.log(rig.antenna.stiffness_Nm2 / usual.antenna.stiffness_Nm2)
        assert abs(ratio) < 4.0 * np.hypot(rig.std("log_stiffness_Nm2"), usual.std("log_stiffness_Nm2"))
        said = capsys.readouterr().err
        assumed = quality["given_lens"]["uncertainty"]
        assert quality["given_lens"]["file"] == name
        assert quality["given_lens"]["sha256"] in json.loads(out.read_text())["inputs_sha256"].values()
        if name != "vbaa":
            words = assumed.removeprefix("assumed: ")
            assert words != assumed
            assert all(words in place for place in (said, quality["lens"]["warnings"][0], quality["warnings"][0]))
            assert quality["lens"]["grade"] == "look at"
        else:
            assert "one standard deviation of" not in said


@pytest.mark.slow
@pytest.mark.parametrize("draws", [60])
def test_an_assumed_lens_is_as_uncertain_as_it_says(bare: Path, tmp_path: Path, draws: int) -> None:
    """Lenses that are off as is assumed: the points of plane C that they see, and EI, are off as is predicted."""
    session, true = load_session(bare), true_camera()
    scene, views, rng = load_scene(small_rig() / "scene.yaml"), read_views(session), np.random.default_rng(5)
    points = np.array([[x, y, 0.0] for x in (0.05, 0.12, 0.2) for y in (-0.03, 0.03)])
    pixels, _ = true.project(scene.T_antenna_camera.inverse() @ points)
    stiffness = scene.antenna.stiffness_Nm2 * scene.true.stiffness_factor
    file = tmp_path / "camera_info.yaml"
    observations, on_plane, of_stiffness = None, [], []
    for _ in range(draws):
        file.write_text(FORMATS["ros"].write(Exchanged(true)))
        assumed = read_lens(file).camera
        assert assumed.covariance is not None
        off = independent_axes(assumed.covariance) @ rng.normal(size=len(assumed.parameters))
        file.write_text(FORMATS["ros"].write(Exchanged(replace(assumed.moved(off), covariance=None))))
        lens = given_solution(read_lens(file), [], session.board, [("plane", view) for view in views["jig"]])
        assert [one.name for one in lens.verdict.findings] == ["lens_uncertainty_assumed"]
        plane = find_plane(session, lens.camera, lens.board_shape, **views)
        before = prior_of_session(session, lens, plane)
        observations = observations or observe_stills(session, plane.kinematics, before)
        joint = adjust_bundle(observations, before, session.antenna.length_m, session.moment_std_Nm)
        rig = make_rig(session, plane.kinematics, joint, observations)
        seen, _ = rig.camera_on_plane().project(pixels)
        jacobian = np.asarray(rig.camera_on_plane().calibration_jacobian(pixels))
        covariance = jacobian @ rig.plane_covariance() @ np.swapaxes(jacobian, -1, -2)
        on_plane.append((seen - points[:, :2]) / np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)))
        of_stiffness.append(np.log(rig.antenna.stiffness_Nm2 / stiffness) / rig.std("log_stiffness_Nm2"))
    # all draws share the pictures and their noise
    assert 0.4 < np.sqrt(np.mean(np.square(on_plane))) < 1.3
    assert 0.2 < np.sqrt(np.mean(np.square(of_stiffness))) < 1.8


def known(intrinsics: np.ndarray, std: float | None = None) -> GivenLens:
    """A lens as a file would give it, with the deviations of a good calibration; or with assumed ones."""
    name = {4: "none", 8: "opencv4"}[len(intrinsics)]
    camera = camera_of(LENS_MODELS[name], intrinsics, SIZE)
    if std is not None:
        deviations = std * np.array([1, 1, 1, 1, 1e-3, 3e-3, 1e-4, 1e-4])[: len(intrinsics)]
        camera = replace(camera, covariance=np.diag(deviations**2))
    return GivenLens(camera, Path("camera.json"), "camera.json", (), "")


def test_pictures_that_contradict_a_known_lens_are_heard() -> None:
    """They hold one that is right as far as it says; a zoom, a forgotten distortion and another centre they do not."""
    wrong = [
        (INTRINSICS * [1.01, 1.01, 1, 1, 1, 1, 1, 1], "do not use"),
        (INTRINSICS * [1, 1, 1, 1, 0, 0, 0, 0], "do not use"),
        (INTRINSICS + np.array([0, 0, 12, 0, 0, 0, 0, 0]), "do not use"),
    ]
    off = np.random.default_rng(0).normal(size=8) * [1, 1, 1, 1, 1e-3, 3e-3, 1e-4, 1e-4]
    right = given_solution(known(INTRINSICS + off, 1.0), pictures(40, np.ones(14)), SPEC)
    assert "given_lens_contradicted" not in {one.name for one in right.verdict.findings}
    for seed, (intrinsics, grade) in enumerate(wrong):
        found = given_solution(known(intrinsics, 0.5), pictures(41 + seed, np.ones(10)), SPEC)
        assert "given_lens_contradicted" in {one.name for one in found.verdict.findings}
        assert found.grade == grade


@pytest.mark.parametrize("both", [True, False])
@pytest.mark.parametrize("rectified", [True, False])
def test_rectified_pictures_are_told_by_straight_lines(rectified: bool, both: bool) -> None:
    """A lens of raw pictures for rectified ones, and the other way round; neither where the pictures are as it says,
    or bend by half of its distortion. both : the file has the other lens, too."""
    raw, onto = INTRINSICS, INTRINSICS[:4] * [0.95, 0.96, 1.0, 1.0]
    lenses = {True: known(onto, 0.5), False: known(raw, 0.5)}
    given = replace(lenses[rectified], other=lenses[not rectified].camera if both else None)
    names = {True: "pictures_not_rectified", False: "pictures_rectified"}
    half = raw * [1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 1.0, 1.0]
    for seed, (truth, straight) in enumerate(((raw, False), (np.append(onto, np.zeros(4)), True), (half, None))):
        views = pictures(60 + seed, np.ones(8), intrinsics=truth)
        for several, placed in ((views, []), ([], [("plane", view) for view in views])):
            found = {one.name: one for one in given_solution(given, several, SPEC, placed).verdict.findings}
            wrong = straight is not None and straight != rectified and (both or not rectified)
            assert (names[rectified] in found) == wrong
            assert wrong <= ("given_lens_contradicted" not in found)
            assert not wrong or ("--rectified" in found[names[rectified]].remedy) == both


def test_the_board_in_the_jig_contradicts_the_lens_of_another_camera(bare: Path) -> None:
    """A file for the same sensor with another lens: nothing else in the session tells."""
    session, true = load_session(bare), true_camera()
    placed = [("plane", view) for view in read_views(session)["jig"]]
    for factor, wrong in ((1.0, False), (2.0, True), (0.6, True)):
        matrix = true.matrix * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]])
        camera = replace(true, matrix=matrix, covariance=np.diag(np.array([1, 1, 1, 1, 1e-3, 3e-3, 1e-4, 1e-4]) ** 2))
        found = given_solution(GivenLens(camera, Path("c.json"), "", (), ""), [], session.board, placed).verdict
        assert ("given_lens_contradicted" in {one.name for one in found.findings}) == wrong
