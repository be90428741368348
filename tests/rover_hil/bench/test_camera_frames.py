"""Frames of a camera on the page: which are shown, and where the trace is drawn."""

from collections.abc import Sequence
from dataclasses import replace
from multiprocessing import Pipe
from typing import cast

import cv2
import numpy as np
import pytest

from controllers.control_loop import StepOutput
from controllers.ftrace.reading import TraceReading
from controllers.slip.scomp.compensator import ScompReport
from drivers.clock import VirtualClock
from drivers.link import NoTap
from drivers.samples import FrameSample, Image
from rover_hil.bench.camera_frames import CameraFrame, FrameChoice, pack
from rover_hil.bench.page_operator import VIEW_PERIOD_NS, PageOperator
from rover_hil.bench.views import View
from rover_hil.config import load_config
from rover_hil.run.composition import build_virtual_rig
from rover_hil.run.executive import CycleView
from sim_backends.world.plant import Truth
from tests.rover_hil.bench.kept import Kept
from tests.rover_hil.bench.rovers import quick

MS_NS = 1_000_000
RIG = load_config("el-dorado").scomp.rig.geometry()  # type: ignore[union-attr]
IMAGE = np.full((480, 640), 120, np.uint8)
READING = TraceReading(
    t_ns=0, detected=True, theta_rad=0.0, confidence=0.9, source="trace", theta_sd_rad=0.02
)


def first_cycle() -> CycleView:
    clock = VirtualClock()
    rig, world = build_virtual_rig(quick(), clock, NoTap())
    rig.connect(1.0)
    clock.sleep_until(clock.now_ns() + 20_000_000)
    samples, output, sent = rig.cycle(clock.now_ns())
    rig.close()
    return CycleView(samples, output, sent, [], 0, 0, world.plant.truth())


CYCLE = first_cycle()


def frame(t_ms: int, camera: str = "rear") -> FrameSample:
    return FrameSample(device=camera, t_ns=t_ms * MS_NS, image=IMAGE, t_capture_ns=None, index=t_ms)


def output(reading_ms: int | None) -> StepOutput:
    if reading_ms is None:
        return CYCLE.output
    trace = replace(READING, t_ns=reading_ms * MS_NS)
    report = ScompReport(slip=0.1, slip_angle_rad=0.0, trace=trace, reason="")
    return replace(CYCLE.output, scomp=report)


def shown(cycles: Sequence[tuple[list[FrameSample], int | None]]) -> list[CameraFrame]:
    choice = FrameChoice("rear", RIG)
    return [
        picture
        for frames, reading_ms in cycles
        for picture in choice.choose(CYCLE._replace(samples=frames, output=output(reading_ms)))
    ]


def test_a_rear_frame_waits_for_its_trace_and_is_shown_once() -> None:
    (picture,) = shown([([frame(0)], None), ([], None), ([], 0), ([], 0)])
    assert picture.reading is not None
    assert picture.reading.t_ns == 0


def test_a_rear_frame_without_a_trace_is_shown_with_the_next_one() -> None:
    assert [picture.reading for picture in shown([([frame(0)], None), ([frame(200)], 7)])] == [None]


def test_at_most_six_frames_a_second_are_shown() -> None:
    cycles: list[tuple[list[FrameSample], int | None]] = [
        ([frame(t_ms, "side")], None) for t_ms in range(0, 1000, 20)
    ]
    assert 5 <= len(shown(cycles)) <= 6


@pytest.mark.parametrize(("detected", "colour"), [(True, (0, 220, 0)), (False, (0, 160, 255))])
def test_the_edges_of_the_trace_are_drawn_where_the_wheel_rolled(
    detected: bool, colour: tuple[int, int, int]
) -> None:
    picture = pack(CameraFrame("rear", IMAGE, replace(READING, detected=detected), RIG))
    pixels = cv2.imdecode(np.frombuffer(picture["jpeg"], np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    # 0.3 m behind the contact at (-0.3, 0.22), half the width of 0.11 m to each side.
    for left_m in (0.165, 0.275):
        point = RIG.rotation.T @ (np.array([-0.6, left_m, 0.0]) - RIG.position_m)
        column, row, depth = RIG.camera_matrix @ point
        x, y = round(column / depth), round(row / depth)
        near = pixels[y - 2 : y + 3, x - 4 : x + 5].reshape(-1, 3).astype(int)
        assert np.abs(near - colour).sum(axis=1).min() < 60
    assert picture["words"] == "+0.0 deg from trace, confidence 0.90"


def test_without_a_rig_the_frame_is_shown_as_it_is() -> None:
    large: Image = np.zeros((960, 1280, 3), np.uint8)
    picture = pack(CameraFrame("side", large, None, None))
    pixels = cv2.imdecode(np.frombuffer(picture["jpeg"], np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == (480, 640, 3)
    assert picture["words"] == ""


def test_a_frame_that_the_page_does_not_take_is_dropped() -> None:
    orders, _ours = Pipe(duplex=False)
    kept = Kept(0)
    operator = PageOperator(orders, kept, 3, None, FrameChoice(None, None))
    operator.show(CYCLE._replace(samples=[frame(0)]))
    kept.most = 1
    operator.show(CYCLE._replace(output=replace(CYCLE.output, t_ns=CYCLE.output.t_ns + VIEW_PERIOD_NS)))
    assert cast("View", kept.items[0])["dropped"] == 2


def test_the_truth_counts_from_where_the_rover_was_at_first() -> None:
    assert CYCLE.truth is not None
    first: Truth = replace(CYCLE.truth, x_m=2.0, y_m=1.0, yaw_rad=np.pi / 2)
    orders, _ours = Pipe(duplex=False)
    kept = Kept(9)
    operator = PageOperator(orders, kept, 3, None)
    operator.show(CYCLE._replace(truth=first))
    moved = replace(first, x_m=1.9, y_m=1.3, yaw_rad=np.pi / 2 + 0.1)
    later = replace(CYCLE.output, t_ns=CYCLE.output.t_ns + 100 * MS_NS)
    operator.show(CYCLE._replace(truth=moved, output=later))
    operator.show(CYCLE._replace(truth=None, output=replace(later, t_ns=later.t_ns + 100 * MS_NS)))
    truths = [
        item["truth"] for item in kept.items if not isinstance(item, CameraFrame) and item["kind"] == "view"
    ]
    assert truths[1] == pytest.approx((0.3, 0.1, 0.1))
    assert truths[2] is None
