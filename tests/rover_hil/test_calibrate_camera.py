"""`rover-hil calibrate camera` on rendered pictures of a board, with a camera that is known."""

import json
import math
import shutil
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from drivers.errors import ConfigError
from drivers.link import CameraImage, Received
from drivers.samples import Image
from rover_hil.app.app import app
from rover_hil.config import load_config, read_rig
from rover_hil.ftrace.frames import FrameFile
from rover_hil.ready.camera import fit
from rover_hil.ready.camera.calibration import CameraCalibration
from rover_hil.ready.camera.fit import Board, GroundTarget, find_corners, fit_camera, rig_text
from rover_hil.ready.procedure import Request, run
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from tests.rear_scene.rig_file import CalibratedRig
from tests.rover_hil.ftrace_files import rig_table
from tests.sim_backends.rear_drives import rig

Floats = NDArray[np.float64]
Kind = Literal["chessboard", "charuco"]

SQUARE_M, COLUMNS, ROWS, SQUARE_PX = 0.04, 8, 6, 60
GROUND = GroundTarget(x_m=-0.72, y_m=0.10, yaw_rad=math.radians(75.0))
"""Columns grow to the left and a little ahead, rows ahead and a little to the right."""
CAMERA_KEYS = ("schema", "image", "camera_matrix", "dist_coeffs", "R_vehicle_camera", "t_vehicle_camera")


def board_of(kind: Kind) -> Board:
    return Board(kind=kind, columns=COLUMNS, rows=ROWS, square_m=SQUARE_M)


def print_board(kind: Kind) -> Image:
    """Return the board as printed; row and column 0 at its upper left corner."""
    if kind == "chessboard":
        rows, columns = np.indices((ROWS * SQUARE_PX, COLUMNS * SQUARE_PX)) // SQUARE_PX
        return np.asarray(np.where((rows + columns) % 2, 255, 0), np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    pattern = cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE_M, 0.75 * SQUARE_M, dictionary)
    return np.asarray(pattern.generateImage((COLUMNS * SQUARE_PX, ROWS * SQUARE_PX)), np.uint8)


def photograph(
    camera: CalibratedRig, paper: Image, to_camera: Floats, shift: Floats, rng: np.random.Generator
) -> Image:
    """Return the picture of a board with these axes and this upper left corner in the camera."""
    rays = np.concatenate([camera.rays(), np.ones((camera.height, camera.width, 1))], axis=2)
    normal = to_camera[:, 2]
    along = (normal @ shift) / (rays @ normal)
    place = (rays * along[..., None] - shift) @ to_camera[:, :2] / SQUARE_M * SQUARE_PX - 0.5
    # Shrunk in the picture the board must be smoothed first, as a lens does.
    soft = cv2.GaussianBlur(paper, (0, 0), 1.5)
    edge = cv2.copyMakeBorder(soft, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=(255.0,))
    shown = cv2.remap(
        edge, (place[..., 0] + 60).astype(np.float32), (place[..., 1] + 60).astype(np.float32),
        cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(150.0,),
    )  # fmt: skip
    return np.asarray(np.clip(30 + 0.7 * shown + rng.normal(0, 1.5, shown.shape), 0, 255), np.uint8)


def in_hand(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return a board held before the camera: axes in the camera, and its corner."""
    turned, _ = cv2.Rodrigues(rng.uniform(-0.45, 0.45, 3))
    axes = np.asarray(turned, np.float64)
    middle = np.array([rng.uniform(-0.1, 0.1), rng.uniform(-0.08, 0.08), rng.uniform(0.35, 0.5)])
    half = np.array([COLUMNS, ROWS, 0]) * SQUARE_M / 2
    return axes, middle - axes @ half


def on_ground(camera: CalibratedRig) -> tuple[Floats, Floats]:
    """Return the board on the ground where `GROUND` says: axes in the camera, and its corner."""
    c, s = math.cos(GROUND.yaw_rad), math.sin(GROUND.yaw_rad)
    # Printed side up: columns, rows clockwise of them seen from above, and into the ground.
    axes = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
    corner = np.array([GROUND.x_m, GROUND.y_m, 0.0]) - axes @ np.array([SQUARE_M, SQUARE_M, 0.0])
    back = camera.vehicle_from_camera.T
    return back @ axes, back @ (corner - camera.camera_m)


def write_pictures(folder: Path, kind: Kind, count: int = 12) -> Path:
    camera, paper, rng = rig(), print_board(kind), np.random.default_rng(4)
    (folder / "views").mkdir(parents=True)
    for number in range(count):
        view = photograph(camera, paper, *in_hand(rng), rng)
        cv2.imwrite(str(folder / "views" / f"{number}.png"), view)
    cv2.imwrite(str(folder / "ground.png"), photograph(camera, paper, *on_ground(camera), rng))
    rover = {key: value for key, value in rig_table().items() if key not in CAMERA_KEYS}
    (folder / "rover.json").write_text(json.dumps(rover), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def charuco(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pictures(tmp_path_factory.mktemp("calibrate") / "charuco", "charuco")


@pytest.fixture(scope="module")
def chessboard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pictures(tmp_path_factory.mktemp("calibrate") / "chessboard", "chessboard")


def options(folder: Path, kind: Kind, out: Path) -> list[str]:
    return [
        *("calibrate", "camera", str(folder / "views"), "--ground", str(folder / "ground.png")),
        *("--rover", str(folder / "rover.json"), "--board", kind, "--columns", str(COLUMNS)),
        *("--rows", str(ROWS), "--square", str(SQUARE_M), "--ground-x", str(GROUND.x_m)),
        *("--ground-y", str(GROUND.y_m), "--ground-yaw", "75", "--out", str(out)),
    ]


@pytest.mark.parametrize("kind", ["charuco", "chessboard"])
@pytest.mark.slow
def test_the_camera_is_found(kind: Kind, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    folder: Path = request.getfixturevalue(kind)
    result = CliRunner().invoke(app, options(folder, kind, tmp_path / "rig.json"))

    assert result.exit_code == 0, result.output
    camera, found = rig(), read_rig(tmp_path / "rig.json").geometry()
    assert np.allclose(found.position_m, camera.camera_m, atol=0.004)
    turned = found.rotation @ camera.vehicle_from_camera.T
    assert math.degrees(math.acos(min(1.0, (np.trace(turned) - 1) / 2))) < 0.4
    assert found.camera_matrix[0, 0] == pytest.approx(camera.camera_matrix[0, 0], rel=0.01)
    assert found.distortion[0] == pytest.approx(camera.distortion[0], abs=0.03)
    assert found.wheel_width_m == camera.wheel.width_m
    page = (tmp_path / "rig.html").read_text("utf-8")
    assert page.count("<img") == 2
    assert "Camera: lens and pose" in page


def test_a_log_gives_the_same_as_its_pictures(charuco: Path, tmp_path: Path) -> None:
    """Frames of the log are the pictures, and its last frame is that of the board on the ground."""
    names = [f"{number}.png" for number in range(12)]
    config = load_config("el-dorado")
    files = collect_data_files(config)
    with LogWriter(
        tmp_path / "run.mcap", 0, config.model_dump_json(by_alias=True).encode(), files, "real"
    ) as log:
        for number, path in enumerate(
            [*(charuco / "views" / name for name in names), charuco / "ground.png"]
        ):
            t_ns = 200_000_000 * (number + 1)
            image = np.asarray(cv2.imread(str(path)), np.uint8)
            log.received("camera", Received(t_ns, CameraImage(image, t_ns)))
    arguments = options(charuco, "charuco", tmp_path / "by_log.json")
    arguments[2] = arguments[4] = str(tmp_path / "run.mcap")

    result = CliRunner().invoke(app, arguments)

    assert result.exit_code == 0, result.output
    found = read_rig(tmp_path / "by_log.json").geometry()
    assert np.allclose(found.position_m, rig().camera_m, atol=0.004)


def calibrate_camera(
    pictures: Path, *, ground: Path, board: Board, target: GroundTarget, rover: Path, fps: float, out: Path
) -> int:
    return run(CameraCalibration(ground, rover, board, target, fps), Request(source=str(pictures), out=out))


def test_the_ground_picture_of_a_long_log_is_found_without_holding_all_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    images: list[weakref.ref[Image]] = []
    most = 0

    def frames(path: Path) -> Iterator[FrameFile]:
        nonlocal most
        for number in range(5):
            image = np.full((2, 2), number, np.uint8)
            images.append(weakref.ref(image))
            yield FrameFile(number, image)
            del image
            most = max(most, sum(each() is not None for each in images))

    monkeypatch.setattr(fit, "LogFrames", frames)
    assert fit._ground_picture(tmp_path / "run.mcap")[0, 0] == 4
    assert most <= 2


def test_the_page_shows_a_board_that_does_not_fit(charuco: Path, tmp_path: Path) -> None:
    """Pictures of two cameras have no common lens."""
    views = tmp_path / "views"
    shutil.copytree(charuco / "views", views)
    for path in sorted(views.iterdir())[::2]:
        picture = np.asarray(cv2.imread(str(path)), np.uint8)
        cv2.imwrite(str(path), cv2.resize(picture[:, 80:560], picture.shape[1::-1]))
    arguments = options(charuco, "charuco", tmp_path / "rig.json")
    arguments[2] = str(views)

    result = CliRunner().invoke(app, arguments)

    assert result.exit_code == 1
    assert "not written: worse than 1 px" in result.output
    assert not (tmp_path / "rig.json").exists()
    assert "Camera: not calibrated" in (tmp_path / "rig.html").read_text("utf-8")


def test_corners_lie_where_the_board_is(charuco: Path) -> None:
    found = find_corners(np.asarray(cv2.imread(str(charuco / "ground.png")), np.uint8), board_of("charuco"))

    assert found is not None
    flat, pixels = found
    axes, corner = on_ground(rig())
    points = (flat + np.array([SQUARE_M, SQUARE_M, 0.0])) @ axes.T + corner
    true, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), rig().camera_matrix, rig().distortion)
    assert np.abs(true.reshape(-1, 2) - pixels).max() < 0.6


def test_a_wrong_square_puts_the_camera_too_high(charuco: Path, tmp_path: Path) -> None:
    """The lens fits all the same, but a larger board on the ground lies farther from a higher camera."""
    code = calibrate_camera(
        charuco / "views", ground=charuco / "ground.png", rover=charuco / "rover.json", fps=5.0,
        board=Board(kind="charuco", columns=COLUMNS, rows=ROWS, square_m=2 * SQUARE_M),
        target=GROUND, out=tmp_path / "rig.json",
    )  # fmt: skip

    assert code == 0
    assert read_rig(tmp_path / "rig.json").geometry().position_m[2] > 0.8


def test_too_few_pictures_show_the_board(charuco: Path, tmp_path: Path) -> None:
    views = tmp_path / "views"
    views.mkdir()
    for number in range(3):
        shutil.copy(charuco / "views" / f"{number}.png", views)
    with pytest.raises(ConfigError, match="--columns, --rows"):
        calibrate_camera(
            views, ground=charuco / "ground.png", rover=charuco / "rover.json", fps=5.0,
            board=Board(kind="chessboard", columns=12, rows=9, square_m=0.04), target=GROUND,
            out=tmp_path / "rig.json",
        )  # fmt: skip


def test_the_ground_picture_must_show_the_board(charuco: Path, tmp_path: Path) -> None:
    grey = tmp_path / "grey.png"
    cv2.imwrite(str(grey), np.full((480, 640), 90, np.uint8))

    with pytest.raises(ConfigError, match=r"grey\.png does not show the board"):
        calibrate_camera(
            charuco / "views", ground=grey, rover=charuco / "rover.json", fps=5.0,
            board=board_of("charuco"), target=GROUND, out=tmp_path / "rig.json",
        )  # fmt: skip


def test_a_calibration_is_never_overwritten(charuco: Path, tmp_path: Path) -> None:
    out = tmp_path / "rig.json"
    out.write_text("precious", encoding="utf-8")

    with pytest.raises(ConfigError, match="never overwritten"):
        calibrate_camera(
            charuco / "views", ground=charuco / "ground.png", rover=charuco / "rover.json", fps=5.0,
            board=board_of("charuco"), target=GROUND, out=out,
        )  # fmt: skip

    assert out.read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize(
    ("text", "named"), [("{", "not valid JSON"), ("[]", "object"), ("{}", "vehicle_frame")]
)
def test_a_wrong_rover_file(tmp_path: Path, text: str, named: str, charuco: Path) -> None:
    found = fit_camera(charuco / "views", charuco / "ground.png", board_of("charuco"), GROUND)
    (tmp_path / "rover.json").write_text(text, encoding="utf-8")

    with pytest.raises(ConfigError, match=named):
        rig_text(tmp_path / "rover.json", found, 5.0)
