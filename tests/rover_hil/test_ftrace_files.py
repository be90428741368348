"""What the trace command reads: rig, telemetry, frames; and how it says what is wrong with them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.config import read_rig
from rover_hil.ftrace.frames import FrameFile, FrameSource, to_grey
from rover_hil.ftrace.run import longest_gap
from rover_hil.ftrace.telemetry import read_telemetry
from tests.rover_hil.ftrace_files import rig_table, write_rig

Table = dict[str, Any]


def test_a_rig_file_is_read(tmp_path: Path) -> None:
    table = rig_table()
    table["wheel"]["steer_deg"] = 10.0
    geometry = read_rig(write_rig(tmp_path / "rig.json", table)).geometry()

    assert geometry.width == 640
    assert geometry.steer_rad == pytest.approx(np.radians(10))
    assert np.allclose(geometry.rotation, table["R_vehicle_camera"])
    assert geometry.wheel_width_m == table["wheel"]["width_m"]
    assert geometry.max_slip_rad == pytest.approx(np.radians(table["max_slip_angle_deg"]))


WHEEL = [-0.3, 0.2, 0.0]
FRONT, OTHER_SIDE, SAME_AXLE = [0.3, 0.22, 0.0], [0.3, -0.2, 0.0], [-0.3, -0.2, 0.0]


@pytest.mark.parametrize(
    ("others", "lead_m"),
    [
        (
            [{"contact_point": SAME_AXLE}, {"contact_point": OTHER_SIDE}, {"contact_point": FRONT}],
            (0.6, 0.02),
        ),
        ({"front_left": {"contact_point": FRONT, "note": "driven"}}, (0.6, 0.02)),
        ([{"contact_point": OTHER_SIDE}, {"contact_point": SAME_AXLE}], None),
        (
            [
                {"name": "front_left"},
                "front_right",
                {"contact_point": ["0.3", 0.2, 0.0]},
                {"contact_point": [1.0]},
            ],
            None,
        ),
        ([{"contact_point": [0.9, 0.2, 0.0]}, {"contact_point": FRONT}], (0.6, 0.02)),
        ([{"contact_point": [0.9, 0.2, 0.0]}, {"contact_point": [0.3, 0.2, 0.0]}], (0.6, 0.0)),
        ([{"contact_point": [10**18, 0.2, 0.0]}, {"contact_point": [1e9, 0.2, 0.0]}], None),
        ([{"contact_point": [True, 0.2, 0.0]}, {"contact_point": [0.3, 0.2, "junk"]}], None),
        ([], None),
        (None, None),
    ],
)
def test_the_wheel_ahead_is_the_one_on_the_same_side(
    tmp_path: Path, others: Any, lead_m: tuple[float, float] | None
) -> None:
    table = rig_table()
    table["wheel"]["contact_point"], table["other_wheels"] = WHEEL, others

    found = read_rig(write_rig(tmp_path / "rig.json", table)).geometry().lead_m

    assert (found is None) == (lead_m is None)
    assert found is None or found == pytest.approx(lead_m)


def without(table: Table, key: str) -> Table:
    del table[key]
    return table


def changed(table: Table, path: str, value: Any) -> Table:
    *way, last = path.split(".")
    inner = table
    for key in way:
        inner = inner[key]
    inner[last] = value
    return table


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda table: without(table, "b_m"), "b_m"),
        (lambda table: without(table, "camera_matrix"), "camera_matrix"),
        (lambda table: changed(table, "colour", 1), "colour"),
        (lambda table: changed(table, "wheel.colour", 1), "colour"),
        (lambda table: changed(table, "schema", "rear-camera-rig/2"), "rear-camera-rig/1"),
        (lambda table: changed(table, "wheel.width_m", "wide"), "width_m"),
        (lambda table: changed(table, "wheel.width_m", -0.1), "width_m"),
        (lambda table: changed(table, "wheel.steer_deg", 120.0), "steer_deg"),
        (lambda table: changed(table, "image.fps", 0), "fps"),
        (lambda table: changed(table, "dist_coeffs.values", [0.1, 0.2]), "dist_coeffs"),
        (lambda table: changed(table, "dist_coeffs.model", "fisheye"), "k1 k2 p1 p2 k3"),
        (lambda table: changed(table, "camera_matrix", [[1, 2], [3, 4]]), "camera_matrix"),
        (lambda table: changed(table, "max_slip_angle_deg", 89), "max_slip_angle_deg"),
        (lambda table: changed(table, "t_vehicle_camera", [0, 0, float("nan")]), "t_vehicle_camera"),
    ],
)
def test_a_wrong_rig_file_names_the_key(tmp_path: Path, change: Callable[[Table], Table], named: str) -> None:
    path = write_rig(tmp_path / "rig.json", change(rig_table()))

    with pytest.raises(ConfigError, match=named) as caught:
        read_rig(path)

    assert str(path) in str(caught.value)


@pytest.mark.parametrize("text", ["{", "[]", "3", '"rig"', "\x00\xff"])
def test_a_rig_file_that_holds_no_rig(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.json"
    path.write_text(text, encoding="latin-1")

    with pytest.raises(ConfigError, match=r"rig\.json"):
        read_rig(path)


def test_a_rig_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot read rig file"):
        read_rig(tmp_path / "none.json")


def telemetry(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "telemetry.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_telemetry_is_turned_into_si(tmp_path: Path) -> None:
    head = "frame,t,wheel_speed_mps,compass_deg,gyro_roll_dps,gyro_pitch_dps,gyro_yaw_dps"
    rows = read_telemetry(telemetry(tmp_path, f"{head}\n0,0.5,0.08,90,1,2,180\n7,0.9,,,,,\n"))

    assert rows[0].t_s == 0.5
    assert rows[0].wheel_speed_m_s == 0.08
    assert rows[0].rates_rad_s == pytest.approx((np.radians(1), np.radians(2), np.pi))
    assert rows[7].wheel_speed_m_s is None
    assert rows[7].rates_rad_s is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,wheel_speed_mps\n0,1\n", "no column 'frame'"),
        ("", "no column 'frame'"),
        ("frame,t\n0,0.0\n1,0.2\n2,0.1\n", "line 4: time 0.1 s is not after 0.2 s"),
        ("frame,t\n0,0.0\n1,0.0\n", "line 3"),
        ("frame,t\n0,soon\n", "'soon'"),
        ("frame,t\n0.5,0\n", "whole number"),
        ("frame,t\n0,\n", "line 2"),
        ("frame,t,t\n0,0.0,5.0\n", "column 't' twice: leave one out"),
        ("frame,t\n0,0.0\n0,0.2\n", "line 3: frame 0 comes twice"),
    ],
)
def test_wrong_telemetry(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_telemetry(telemetry(tmp_path, text))


def test_pictures_come_in_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (2, 10, 1):
        cv2.imwrite(str(tmp_path / f"frame{number}.png"), np.full((4, 4), number, np.uint8))
    (tmp_path / "notes.txt").write_text("not a picture", encoding="utf-8")

    assert [(frame.number, frame.image[0, 0]) for frame in FrameSource(tmp_path)] == [
        (1, 1),
        (2, 2),
        (10, 10),
    ]


def test_pictures_without_numbers_come_in_order_of_name(tmp_path: Path) -> None:
    for name in ("b", "a"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((4, 4), ord(name), np.uint8))

    assert [(frame.number, frame.image[0, 0]) for frame in FrameSource(tmp_path)] == [(0, 97), (1, 98)]


def test_a_broken_picture_is_black(tmp_path: Path) -> None:
    (tmp_path / "0.png").write_bytes(b"\x89PNG broken")

    (frame,) = FrameSource(tmp_path)

    assert not to_grey(frame, 8, 6).any()


def test_colour_becomes_grey() -> None:
    frame = FrameFile(0, np.full((6, 8, 3), 90, np.uint8))

    assert to_grey(frame, 8, 6).shape == (6, 8)
    with pytest.raises(ConfigError, match="frame 0 has 8 x 6 pixels, the rig 8 x 7"):
        to_grey(frame, 8, 7)


@pytest.mark.parametrize("name", ["none", "empty", "text.mp4"])
def test_nothing_to_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mp4").write_text("no video", encoding="utf-8")

    with pytest.raises(ConfigError, match="folder of pictures"):
        FrameSource(tmp_path / name)


def test_longest_gap() -> None:
    assert longest_gap([False, True, False, False, True, False]) == 2
    assert longest_gap([]) == 0
    assert json.dumps(longest_gap([True])) == "0"
