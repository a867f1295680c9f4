"""Cameras of every kind, and files as other programs write them."""

from __future__ import annotations

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose

SIZE = (960, 720)
MATRIX = np.array([[968.1, 0.0, 483.1], [0.0, 970.3, 355.4], [0.0, 0.0, 1.0]])
COEFFICIENTS = [-0.21, 0.09, -4e-4, 6e-4, -0.01, 0.013, -0.021, 0.0043, 1.2e-3, -3e-4, 7e-4, 2e-4, 0.011, -0.017]
POSE = Pose.from_rotvec(np.array([2.9, -0.2, 0.35]), np.array([0.12, -0.03, 0.36]))


def camera(count: int) -> Camera:
    """With the first `count` of OpenCV's coefficients."""
    return Camera("opencv", SIZE, MATRIX, np.array(COEFFICIENTS[:count]))


def fisheye() -> Camera:
    """A wide one."""
    matrix = np.array([[310.5, 0.0, 479.2], [0.0, 309.9, 361.7], [0.0, 0.0, 1.0]])
    return Camera("fisheye", SIZE, matrix, np.array([-0.018, 0.0042, -0.0031, 7e-4]))


def points() -> np.ndarray:
    """(N, 3) in front of the camera, all over the picture."""
    x, y = np.meshgrid(np.linspace(-0.42, 0.42, 9), np.linspace(-0.32, 0.32, 7))
    depth = 0.3 + 0.2 * np.cos(7 * x + 3 * y)
    return np.stack([x * depth, y * depth, depth], axis=-1).reshape(-1, 3)


ROS = """\
image_width: 640
image_height: 480
camera_name: usb_cam
camera_matrix:
  rows: 3
  cols: 3
  data: [536.5713701935, 0. , 315.0555172451,
         0. , 537.7138835637, 241.0382730485,
         0. , 0. , 1. ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.3962120869278, -1.084940116527, -0.0001640638427870, -0.005099474937516, 1.008031733388]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [ 536.5713701935, 0. , 315.0555172451, 0. ,
          0. , 537.7138835637, 241.0382730485, 0. ,
          0. , 0. , 1. , 0. ]
"""
"""As ROS' camera_calibration writes it."""

OPENCV = """\
%YAML:1.0
---
nframes: 13
image_width: 640
image_height: 480
board_width: 9
board_height: 6
square_size: 2.5000000372529030e-02
aspectRatio: 1.
flags: 2
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.3591573396163199e+02, 0., 3.4228315473308373e+02, 0.,
       5.3591573396163199e+02, 2.3557082909788173e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.6637260909660682e-01, -3.8588898922304653e-02,
       1.7831947042852964e-03, -2.8122100441115472e-04,
       2.3839153080878486e-01 ]
avg_reprojection_error: 3.9259098975581364e-01
"""
"""The head of OpenCV's samples/data/left_intrinsics.yml."""

KALIBR = """\
cam0:
  camera_model: pinhole
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  distortion_model: radtan
  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 0.00011556]
  T_cam_imu:
  - [0.01779318, 0.99967549,-0.01822936, 0.07008565]
  - [-0.9998017, 0.01795239, 0.00860714,-0.01771023]
  - [0.00893160, 0.01807260, 0.99979678, 0.00399246]
  - [0.0, 0.0, 0.0, 1.0]
  timeshift_cam_imu: -8.121e-05
  rostopic: /cam0/image_raw
  resolution: [752, 480]
cam1:
  camera_model: omni
  intrinsics: [0.80065662, 833.006, 830.345, 373.850, 253.749]
  distortion_model: radtan
  distortion_coeffs: [-0.33518750, 0.13211436, 0.00055967, 0.00057686]
  T_cn_cnm1:
  - [ 0.99998854, 0.00216014, 0.00427195,-0.11003785]
  - [-0.00221074, 0.99992702, 0.01187697, 0.00045792]
  - [-0.00424598,-0.01188627, 0.99992034,-0.00064487]
  - [0.0, 0.0, 0.0, 1.0]
  rostopic: /cam1/image_raw
  resolution: [752, 480]
"""
"""The example of Kalibr's wiki, but for the last transformation's digits."""

MRCAL = """\
{
    'lens_model':  'LENSMODEL_OPENCV8',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ 1761.181055, 1761.250444, 1965.706996, 1087.518797, -0.01266096516, 0.03590794372, \
-0.0002547045941, 0.0005275929652, 0.01968883397, 0.01482863541, -0.0562239888, 0.0500223357,],

    # extrinsics are rt_fromref
    'extrinsics': [ 2e-2, -3e-1, -1e-2,  1., 2, -3., ],

    'imagersize': [ 4000, 2200 ]
}
"""
"""mrcal's test/data/cam0.opencv8.cameramodel."""

COLMAP = """\
# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 3
1 SIMPLE_PINHOLE 3072 2304 2559.81 1536 1152
2 PINHOLE 3072 2304 2560.56 2560.56 1536 1152
3 SIMPLE_RADIAL 3072 2304 2559.69 1536 1152 -0.0218531
"""
"""The example of COLMAP's documentation."""

NUMBERS = """\
{"mtx": [[900.0, 0.0, 639.5], [0.0, 905.0, 479.5], [0.0, 0.0, 1.0]],
 "dist": [[-0.2, 0.1, 0.001, -0.0005, 0.01]], "image_size": [1280, 960]}
"""

ORB_SLAM = """\
%YAML:1.0

File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: 458.654
Camera1.fy: 457.296
Camera1.cx: 367.215
Camera1.cy: 248.375
Camera1.k1: -0.28340811
Camera1.k2: 0.07395907
Camera1.p1: 0.00019359
Camera1.p2: 1.76187114e-05
Camera.width: 752
Camera.height: 480
"""
"""The head of ORB-SLAM3's Examples/Monocular/EuRoC.yaml."""

CAHVOR = """\
Model = CAHVOR = perspective, distortion
Dimensions = 1280 960
C = 0.1 0.2 0.3
A = 0.0 0.0 1.0
H = 900.0 0.0 639.5
V = 0.0 900.0 479.5
O = 0.002 -0.001 0.9999975
R = 0.0 -0.2 0.05
"""

SAMPLES = {"ros": ROS, "opencv": OPENCV, "kalibr": KALIBR, "mrcal": MRCAL, "colmap": COLMAP}
READ_ONLY = {"numbers": NUMBERS, "orbslam": ORB_SLAM, "cahvor": CAHVOR}
WHICH = {"kalibr": "cam0", "colmap": "3"}
