"""`vbaa bench guided`: pictures of the board where suggested and at random, until plane C is known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.boards import BARREL, BOARD, HD, MILD, VGA, WIDE, Optics, pose_by, rms_on_plane_mm
from benchmarks.figures import COLOURS, INK, label, panels
from benchmarks.harness import Draws, Findings, Options, aligned, cell, column, of_any, or_none, rms, rms_known, row_of
from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.guide.next_view import lens_progress
from vbaa_calib.calibrate.guide.settings import GuideSettings
from vbaa_calib.calibrate.guide.suggestion import Suggestion, visible_corners
from vbaa_calib.calibrate.guide.view_uncertainty import WorkPlane
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.bundle import BoardCorners
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.pose.board_pose import solve_board_pose, start_poses
from vbaa_calib.camera import Camera
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.board import board_patch, print_sheet
from vbaa_calib.simulate.render.picture import digitise, expose, studio, surroundings
from vbaa_calib.simulate.scene.lens import Lens
from vbaa_calib.simulate.scene.scene import PictureSpec

GOAL_MM = 0.1
_CARD = BoardSpec(squares_x=6, squares_y=5, square_m=0.025, marker_m=0.019)
_DIM = PictureSpec(1.2, 6.0, 12.0, 0.35, 0.3, 0.35, 0.3, 0.2, 0.4, 0.0)
_HAND_TURN_RAD, _HAND_DISTANCE, _HAND_PLACE = np.radians(5.0), 0.05, 0.03
_LEAST_CORNERS, _TRIES = 8, 40


@dataclass(frozen=True, eq=False)
class Rig(Optics):
    """A camera, a board, and plane C: 240 x 120 mm at 0.4 m, tilted by 35°.

    sigma_px : deviation of a corner per axis, where corners are projected. picture : how pictures come about where
        they are rendered and the board is found in them; None where corners are projected.
    """

    board: BoardSpec
    sigma_px: float
    picture: PictureSpec | None = None

    @property
    def plane(self) -> WorkPlane:
        """Plane C, as the user describes it."""
        return WorkPlane.about(0.4, float(np.radians(35.0)), 0.24)

    @property
    def half_board_m(self) -> np.ndarray:
        """(3,) from the board's corner to its middle."""
        return self.board.square_m * np.array([self.board.squares_x, self.board.squares_y, 0.0]) / 2


def rigs() -> list[Rig]:
    """Two that are hard on the lens, one of them rendered too, and an easy one."""
    return [
        Rig("VGA, barrel, 15 cm board, 0.3 px", "opencv5", VGA, BARREL, _CARD, 0.3),
        Rig("VGA, barrel, 15 cm board, rendered", "opencv5", VGA, BARREL, _CARD, 0.0, _DIM),
        Rig("wide rational, 15 cm board, 0.3 px", "rational", HD, WIDE, _CARD, 0.3),
        Rig("f 900, A4 board, 0.15 px", "opencv5", HD, MILD, BOARD, 0.15),
    ]


def true_error_mm(camera: Camera, rig: Rig, board_pose: Pose | None = None) -> float:
    """Rms distance on C between points and where the lens puts their true pixels, mm; 100 mm where there is no ray.

    board_pose : of the board in the jig as it was found with this lens; without it, found from exact corners.
    """
    truth, plane = rig.camera, rig.plane
    pixels, inside = _seen(truth, plane.T_camera_plane @ np.column_stack([plane.points, np.zeros(len(plane.points))]))
    true_board = plane.board_pose(rig.board)
    if board_pose is None:
        points = corner_points(rig.board)
        corners, shown = _seen(truth, true_board @ points)
        board_pose = pose_by(camera, true_board, BoardCorners(points[shown], corners[shown]))
    T_camera_plane = board_pose @ true_board.inverse() @ plane.T_camera_plane
    return rms_on_plane_mm(camera, T_camera_plane, plane.points[inside], pixels[inside])


def _seen(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pixels, valid = camera.project(points)
    return pixels, valid & camera.in_picture(pixels)


class Photographer:
    """Takes pictures of the board on one rig; noise, hand and lighting all from the seed."""

    def __init__(self, rig: Rig, seed: int) -> None:
        self.rig, self.rng, self.camera = rig, np.random.default_rng(seed), rig.camera
        self._taken = 0
        if rig.picture is not None:
            lens = Lens(self.camera.model, rig.image_size, self.camera.matrix, self.camera.distortion)
            self._studio = studio(lens, rig.picture, self.rng)
            self._sheet = print_sheet(rig.board)

    def by_hand(self, wanted: Pose) -> BoardView | None:
        """The picture of the board held at about this pose: ± 5°, ± 5 % of the distance, ± 3 % of it to the side.

        A picture on which the board is not found is taken again; None after many.
        """
        half = self.rig.half_board_m
        for _ in range(_TRIES):
            turn = Rotation.from_rotvec(_HAND_TURN_RAD * self.rng.normal(size=3)).as_matrix()
            middle = wanted @ half
            aside = _HAND_PLACE * middle[2] * self.rng.normal(size=2)
            moved = middle * (1.0 + _HAND_DISTANCE * self.rng.normal()) + np.append(aside, 0.0)
            rotation = turn @ wanted.rotation
            view = self.picture(Pose(rotation, moved - rotation @ half))
            if view is not None:
                return view
        return None

    def picture(self, pose: Pose) -> BoardView | None:
        """The board at exactly this pose; None where fewer than 8 corners are found."""
        name = f"{self._taken:03d}.png"
        view = self._projected(pose, name) if self.rig.picture is None else self._rendered(pose, name)
        if len(view.ids) < _LEAST_CORNERS:
            return None
        self._taken += 1
        return view

    def _projected(self, pose: Pose, name: str) -> BoardView:
        ids = visible_corners(self.camera, [pose], self.rig.board)[0]
        pixels, _ = self.camera.project(pose @ corner_points(self.rig.board)[ids])
        noisy = pixels + self.rig.sigma_px * self.rng.normal(size=pixels.shape)
        return BoardView(name, ids, noisy, self.rig.image_size, np.arange(self.rig.board.corner_count // 2))

    def _rendered(self, pose: Pose, name: str) -> BoardView:
        # the camera looks down on the bench and is turned about its axis a little from picture to picture
        about = Rotation.from_rotvec([0.0, 0.0, self.rng.uniform(-0.5, 0.5)]).as_matrix()
        world = about @ np.diag([1.0, -1.0, -1.0])
        patch = board_patch(self._studio, self._sheet, pose, world)
        grey = expose(self._studio, surroundings(self._studio, world), [] if patch is None else [patch])
        return detect_corners(digitise(self._studio.spec, grey, self.rng), self.rig.board, name)

    def in_the_jig(self, camera: Camera) -> Pose | None:
        """T_camera_board in the jig, found with a lens in 8 pictures of their own noise; None where it is not found."""
        views = [self.picture(self.rig.plane.board_pose(self.rig.board)) for _ in range(8)]
        found = [view for view in views if view is not None]
        flat = BoardShape.flat(corner_points(self.rig.board))
        return solve_board_pose(found, flat, camera).T_camera_board if found else None


def wanted_pose(suggestion: Suggestion, rig: Rig, camera: Camera | None) -> Pose:
    """Where the board goes when a suggestion is followed: its pose, or its outline while there is no lens yet.

    camera : the lens so far.
    """
    flat, seen = rig.camera.unproject_normalized(suggestion.outline_px)
    if camera is not None or not seen.all():
        return suggestion.T_camera_board
    width, height = 2.0 * rig.half_board_m[:2]
    corners = np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0.0, height, 0.0]])
    return start_poses(corners, flat)[0]


_PEOPLES_TILT_RAD, _PEOPLES_PLACE = np.radians(40.0), 0.33
_SHARE = 0.35
"""Of the board's corners that a picture must show."""
_GIVEN_UP = 100
"""Pictures with too little of the board in them that are taken before a strategy gives up."""

Strategy = Callable[[Photographer, Sequence[BoardView], LensSolution | None], BoardView | None]


def _suggested(
    photographer: Photographer, views: Sequence[BoardView], solution: LensSolution | None
) -> BoardView | None:
    """What `lens_progress` asks for, held by hand."""
    rig = photographer.rig
    progress = lens_progress(views, rig.board, rig.plane, image_size=rig.image_size, solution=solution)
    if progress.suggestion is None:
        return None
    camera = None if solution is None else solution.camera
    return photographer.by_hand(wanted_pose(progress.suggestion, rig, camera))


def _as_people_do(photographer: Photographer, *_views: object) -> BoardView | None:
    """Tilted by up to 40°, rolled a little, its middle in the middle two thirds, at any distance that is in focus.

    None where picture after picture shows too little of the board.
    """
    rng, rig = photographer.rng, photographer.rig
    for _ in range(_GIVEN_UP):
        around, tilt_rad = rng.uniform(0, 2 * np.pi), rng.uniform(0.0, _PEOPLES_TILT_RAD)
        tilt = Rotation.from_rotvec(tilt_rad * np.array([np.cos(around), np.sin(around), 0.0]))
        rotation = (tilt * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.5, 0.5)])).as_matrix()
        place = 0.5 + rng.uniform(-_PEOPLES_PLACE, _PEOPLES_PLACE, 2)
        ray = photographer.camera.unproject((place * (np.array(rig.image_size) - 1))[None])[0][0]
        distance = rig.plane.distance_m * rng.uniform(GuideSettings.nearest, 1.4)
        view = photographer.picture(Pose(rotation, distance * ray - rotation @ rig.half_board_m))
        if view is not None and len(view.ids) >= _SHARE * rig.board.corner_count:
            return view
    return None


SUGGESTED, PEOPLE = "as suggested", "random, as people do"
STRATEGIES: dict[str, Strategy] = {SUGGESTED: _suggested, PEOPLE: _as_people_do}
"""Name → strategy; the first is ours, and works out the next pose from the lens so far."""


if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COUNTS = (3, 4, 6, 8, 10, 12, 15, 18)
"""Numbers of pictures at which lenses are judged."""
ENOUGH_SUGGESTED = 8
"""Pictures taken where each has to be worked out from those before it."""
_NO_LENS_MM = 100.0


def _off(judged: Draws) -> np.ndarray:
    """True errors in predicted deviations, of the seeds with a lens."""
    return (judged.true / judged.predicted)[np.isfinite(judged.predicted)]


@dataclass(frozen=True)
class Row:
    """One strategy on one rig, after so many pictures, over the seeds.

    true_rms_mm : root mean square over seeds of the true error of points on C, the camera's pose found again in the jig
        with this lens from exact corners; a seed without a lens counts as 100 mm. true_median_mm : the median.
    jig_rms_mm : the same with the board's pose found in rendered pictures of the jig; None where nothing is rendered.
    predicted_mm : root mean square over seeds of the deviation predicted. off : rms over seeds of the true error in
        predicted deviations; off_median : its median. None where no seed has a lens.
    reached : share of seeds whose predicted deviation is at most the goal.
    models : the lens models chosen and how often.
    """

    rig: str
    way: str
    pictures: int
    seeds: int = column(of=len)
    true_rms_mm: float = column(of=lambda judged: rms(judged.true))
    true_median_mm: float = column(of=lambda judged: float(np.median(judged.true)))
    jig_rms_mm: float | None = column(of=lambda judged: or_none(rms(judged.jig)))
    predicted_mm: float | None = column(of=lambda judged: or_none(rms_known(judged.predicted)))
    off: float | None = column(of=lambda judged: or_none(rms(_off(judged))))
    off_median: float | None = column(of=lambda judged: of_any(np.median, _off(judged)))
    reached: float = column(of=lambda judged: float((judged.predicted <= GOAL_MM).mean()))
    models: str = column(default="")


@dataclass(frozen=True)
class _Judged:
    """One seed after so many pictures, mm; NaN where there is no lens."""

    true: float
    jig: float
    predicted: float
    model: str


def run(draws: int, seed: int) -> list[Row]:
    """Every strategy on every rig, over the same seeds."""
    cells = [(rig, way) for rig in rigs() for way in STRATEGIES]
    rows: list[Row] = []
    for rig, way in progress(cells, "rigs and strategies", len(cells)):
        sequences = [sequence(rig, way, seed + number) for number in range(draws)]
        counts = sorted({count for judged in sequences for count in judged})
        for count in counts:
            judged = [each.get(count, _nothing(rig)) for each in sequences]
            models = Counter(one.model for one in judged if one.model).most_common()
            words = ", ".join(f"{model} {number}" for model, number in models)
            rows.append(row_of(Row, Draws(judged), rig.name, way, count, models=words))
    return rows


def _nothing(rig: Rig) -> _Judged:
    """Of a seed without a lens."""
    return _Judged(_NO_LENS_MM, np.nan if rig.picture is None else _NO_LENS_MM, np.nan, "")


def sequence(rig: Rig, way: str, seed: int) -> dict[int, _Judged]:
    """Pictures taken one after the other by one strategy; the lens judged at `_COUNTS`."""
    photographer, views = Photographer(rig, seed), list[BoardView]()
    solution: LensSolution | None = None
    judged: dict[int, _Judged] = {}
    while len(views) < (ENOUGH_SUGGESTED if way == SUGGESTED else _COUNTS[-1]):
        view = STRATEGIES[way](photographer, views, solution)
        if view is None:
            break
        views.append(view)
        if way == SUGGESTED or len(views) in _COUNTS:
            try:
                solution = solve_intrinsics(views, rig.board)
            except InputError:
                solution = None
        if len(views) in _COUNTS:
            judged[len(views)] = _judge(photographer, views, solution)
    return judged


def _judge(photographer: Photographer, views: list[BoardView], solution: LensSolution | None) -> _Judged:
    rig = photographer.rig
    if solution is None:
        return _nothing(rig)
    camera = solution.camera
    found = photographer.in_the_jig(camera) if rig.picture is not None else None
    jig = np.nan if found is None else true_error_mm(camera, rig, found)
    predicted = lens_progress(views, rig.board, rig.plane, solution=solution).std_m
    return _Judged(true_error_mm(camera, rig), jig, 1e3 * predicted, solution.model)


_SHARE_GOAL = 2.0 / 3.0
"""Pictures that suggested poses may need, for each that random ones need."""


def pictures_needed(rows: Sequence[Row], name: str) -> int | None:
    """Of one rig and strategy: pictures from which on the number `name`, mm, stays within the goal; None for never."""
    needed: int | None = None
    for row in sorted(rows, key=lambda row: -row.pictures):
        value = getattr(row, name)
        if value is None or value > GOAL_MM:
            break
        needed = row.pictures
    return needed


def _needed(rows: Sequence[Row], name: str = "true_rms_mm") -> str:
    return str(pictures_needed(rows, name) or f"> {max(row.pictures for row in rows)}")


def _of(rows: Sequence[Row], rig: str, way: str) -> list[Row]:
    return [row for row in rows if (row.rig, row.way) == (rig, way)]


def as_text(rows: Sequence[Row], draws: int) -> str:
    """After how many pictures the goal is reached, errors on the way, and a verdict on each rig."""
    title = (
        f"{draws} seeds; mm on C, rms over seeds: true, and predicted; off: true error in predicted deviations, "
        f"rms and median;\nneeded: pictures from which on it stays within {GOAL_MM} mm, truly and as predicted"
    )
    lines = [["rig", "poses", "needed", "predicted", "errors: pictures true/predicted (off, median)"]]
    for rig, way in dict.fromkeys((row.rig, row.way) for row in rows):
        own, errors = _of(rows, rig, way), []
        for row in (row for row in own if row.pictures in (3, 4, 6, 10, 15)):
            predicted, off, median = cell(row.predicted_mm, ".3f"), cell(row.off, ".2f"), cell(row.off_median, ".2f")
            errors.append(f"{row.pictures}: {row.true_rms_mm:.3f}/{predicted} ({off}, {median})")
        lines.append([rig, way, _needed(own), _needed(own, "predicted_mm"), "  ".join(errors)])
    verdicts = [f"{rig}: {_verdict(rows, rig)}" for rig in dict.fromkeys(row.rig for row in rows)]
    return "\n".join([aligned(lines, (True, True, False, False, True), title), *verdicts])


def _verdict(rows: Sequence[Row], rig: str) -> str:
    ours, random = _of(rows, rig, SUGGESTED), _of(rows, rig, PEOPLE)
    if not ours or not random:
        return "not compared"
    first, second = pictures_needed(ours, "true_rms_mm"), pictures_needed(random, "true_rms_mm")
    if first is None:
        return f"missed: suggested poses do not reach the goal in {max(row.pictures for row in ours)} pictures"
    share = first / (second or max(row.pictures for row in random))
    size = f"{'at most ' if second is None else ''}{share:.2f} of the pictures that random poses need"
    return f"{'met' if share <= _SHARE_GOAL else 'missed'}: {size}"


def _figure(rows: Sequence[Row]) -> Figure:
    """True (line) and predicted (dashes) error over the number of pictures, rig by rig."""
    names, ways = (list(dict.fromkeys(getattr(row, name) for row in rows)) for name in ("rig", "way"))
    drawn, every = panels(len(names), len(names), (4.2, 4.0))
    for panel, name in zip(every, names, strict=True):
        panel.axhline(GOAL_MM, color=INK, lw=0.8)
        for way, colour in zip(ways, COLOURS, strict=False):
            own = _of(rows, name, way)
            if own:
                counts, true = [row.pictures for row in own], [row.true_rms_mm for row in own]
                panel.loglog(counts, true, "o-", color=colour, markersize=3, lw=1.4, label=way)
                panel.loglog(counts, [row.predicted_mm or np.nan for row in own], "--", color=colour, lw=0.9)
        panel.set_ylim(0.003, 3.0)
        panel.set_xticks([3, 4, 6, 10, 15], ["3", "4", "6", "10", "15"])
        label(panel, name, "pictures")
        panel.legend(fontsize=7, title="true; dashed: predicted", title_fontsize=7)
    every[0].set_ylabel("error of points on plane C, mm rms")
    return drawn


def measure(options: Options) -> Findings:
    """Every strategy on every rig; a draw is one sequence of pictures."""
    rows = run(options.draws, options.seed)
    # on the rigs in turn, by suggestion and by chance
    suggested, random = (
        ", ".join(_needed(own) for rig in dict.fromkeys(row.rig for row in rows) if (own := _of(rows, rig, way)))
        for way in (SUGGESTED, PEOPLE)
    )
    return Findings(
        as_text(rows, options.draws),
        {"guided.csv": rows},
        {"guided.png": lambda: _figure(rows)},
        {"rows": rows},
        f"{GOAL_MM} mm on plane C takes {suggested} suggested pictures, {random} at random",
    )
