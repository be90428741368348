"""Frames of the camera at events: the right ones, with the trace where it was found."""

import base64
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from controllers.safety import Mode
from drivers.errors import LogError
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import RAW
from rover_hil.report.figures.camera import camera_pictures
from rover_hil.report.read_run import read_run
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Stop, Summary, summarise
from rover_hil.report.tracks import Series
from tests.rover_hil.report.test_read_run import Drive, write_log

GREEN = (0, 220, 0)


@pytest.fixture(scope="module")
def run(el_dorado_log: Path) -> tuple[RunData, Summary]:
    data = read_run(el_dorado_log)
    return data, summarise(data)


def pixels(source: str) -> np.ndarray:
    packed = base64.b64decode(source.removeprefix("data:image/jpeg;base64,"))
    image = cv2.imdecode(np.frombuffer(packed, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.astype(int)


def green_count(image: np.ndarray) -> int:
    return int((np.abs(image - GREEN).sum(axis=2) < 100).sum())


def test_each_event_has_its_frame_and_the_trace_of_that_frame(run: tuple[RunData, Summary]) -> None:
    data, summary = run
    stop = Stop(start_s=2.5, end_s=3.0, mode=Mode.SAFE_STOP, reasons=("a", "b"))
    found = camera_pictures(data, replace(summary, stops=(stop,)))
    assert data.drift is not None
    words = [picture.words for picture in found]
    assert words[0] == "2.5 s: safety stop: a; b"
    assert words[-1].endswith("end of the run")
    assert [float(word.split()[0]) for word in words] == sorted(float(word.split()[0]) for word in words)
    assert {"largest slip", "largest slip angle"} <= {re.split(": |,", word)[1] for word in words}
    with_trace = [picture for picture in found if picture.trace.startswith("trace at")]
    assert with_trace
    angles_deg = np.degrees(data.drift.trace.value)
    for picture in with_trace:
        angle_deg = float(picture.trace.split()[2])
        assert np.abs(angles_deg - angle_deg).min() < 0.06
        assert green_count(pixels(picture.source)) > 400


def test_without_a_trace_in_the_frame_none_is_drawn(run: tuple[RunData, Summary]) -> None:
    data, summary = run
    assert data.drift is not None
    none = Series(data.drift.trace.t_s[:0], data.drift.trace.value[:0])
    found = camera_pictures(replace(data, drift=replace(data.drift, trace=none)), summary)
    assert {picture.trace for picture in found} == {"no trace found in it"}
    assert all(green_count(pixels(picture.source)) == 0 for picture in found)


def test_the_frame_is_the_newest_before_the_event(run: tuple[RunData, Summary], el_dorado_log: Path) -> None:
    data, summary = run
    log = LogReader(el_dorado_log)
    frames = [message for message in log.messages() if message.topic == f"{RAW}camera"]
    event_s = (frames[4].t_ns - log.start_ns) / 1e9 + 0.01
    stop = Stop(start_s=event_s, end_s=event_s, mode=Mode.SAFE_STOP, reasons=("x",))
    plain = replace(data, drift=None, duration_s=event_s)
    (shown, _) = camera_pictures(plain, replace(summary, stops=(stop,)))
    from rover_hil.recording.images import decode_image

    differences = [
        np.abs(pixels(shown.source) - np.atleast_3d(decode_image(frame.data).image)).mean()
        for frame in frames[2:8]
    ]
    assert int(np.argmin(differences)) == 2


def test_a_frame_that_is_damaged_is_said_so(
    run: tuple[RunData, Summary], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(data: bytes) -> None:
        raise LogError("damaged")

    monkeypatch.setattr("rover_hil.report.figures.camera.decode_image", fail)
    found = camera_pictures(*run)
    assert len(found) == 3
    assert {(picture.trace, picture.source) for picture in found} == {("the frame cannot be decoded", "")}


def test_a_rover_without_a_camera_has_none(tmp_path: Path) -> None:
    data = read_run(write_log(tmp_path / "run.mcap", Drive(duration_s=2.0)))
    assert camera_pictures(data, summarise(data)) == []
