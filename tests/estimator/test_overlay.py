"""The debug picture of a frame shows what was seen and estimated, where it is, whatever the status."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.contact.estimate import ContactEstimator
from estimator.contact.overlay import _marks as marks
from estimator.contact.overlay import frame_picture
from estimator.contact.recording import FrameContact, estimate_picture
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.detect.drawing.overlay import HIDDEN

from .drawn_frames import frame_of, path_px, picture, rig_of, shape

SIZE = (512, 384)
SCALE = 2
HIDING = (0.45, 0.7)


@pytest.fixture(scope="module")
def estimator() -> ContactEstimator:
    return ContactEstimator(rig_of(SIZE), "elastica")


@pytest.fixture(scope="module")
def curves(estimator: ContactEstimator) -> Curves:
    return shape(estimator.rig)


@pytest.fixture(scope="module")
def item(estimator: ContactEstimator, curves: Curves, tmp_path_factory: pytest.TempPathFactory) -> FrameContact:
    image = picture(estimator.rig, curves, HIDING)
    frame = frame_of(tmp_path_factory.mktemp("frame"), image, float(curves.moment_Nm[0]))
    return estimate_picture(estimator, frame)


def coloured(image: np.ndarray, colour: tuple[int, int, int], slack: int = 40) -> np.ndarray:
    """(H, W) where a picture has about this colour."""
    return np.asarray(np.abs(image.astype(int) - np.array(colour)).max(axis=-1) <= slack)


def around(image: np.ndarray, points_px: np.ndarray, reach: int = 4) -> np.ndarray:
    """(N, 2·reach + 1, 2·reach + 1, 3) the drawn picture around points of the camera's picture (N, 2)."""
    at = np.rint((points_px + 0.5) * SCALE - 0.5).astype(int)
    return np.stack([image[v - reach : v + reach + 1, u - reach : u + reach + 1] for u, v in at])


def test_seen_and_hidden_parts_are_marked_where_they_are(
    estimator: ContactEstimator, curves: Curves, item: FrameContact
) -> None:
    assert item.contact.status == "ok"
    drawn, path = frame_picture(estimator, item), path_px(estimator.rig, curves)
    seen = path[[int(share * len(path)) for share in (0.15, 0.3, 0.8, 0.9)]]
    hidden = path[int(0.5 * len(path)) : int(0.6 * len(path)) : 8]
    bright = around(drawn, seen).astype(int)
    assert (bright[..., 0] - bright[..., 2] > 150).any(axis=(1, 2)).all()  # cyan to violet: blue, little red
    assert coloured(around(drawn, hidden), HIDDEN).any(axis=(1, 2)).mean() > 0.4  # dashed
    assert not coloured(around(drawn, seen[:2]), HIDDEN).any()


def test_contact_and_fitted_shape_lie_on_the_true_antenna(
    estimator: ContactEstimator, curves: Curves, item: FrameContact
) -> None:
    found, rig = marks(estimator, item), estimator.rig
    true = rig.camera.project(rig.T_antenna_camera.inverse() @ curves.points_m[0])[0]
    gap = np.linalg.norm(path_px(rig, curves)[None, ::4] - found.shape[:, None], axis=-1).min(axis=1)
    assert gap.max() < 0.7
    assert np.linalg.norm(found.contact - true[39]) < 3.0
    ahead = curves.contact_m[0] + 0.02 * curves.force_N[0] / np.linalg.norm(curves.force_N[0])
    way = rig.camera.project((rig.T_antenna_camera.inverse() @ ahead)[None])[0][0] - true[39]
    drawn = found.force - found.contact
    assert drawn @ way / np.linalg.norm(drawn) / np.linalg.norm(way) > 0.99
