"""One set of behaviour for every device on every backend; a device type without a case fails."""

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest

from drivers.clock import VirtualClock
from drivers.device_settings import FrameDeviceSettings
from drivers.driver import AnyDriver, DeviceState
from drivers.errors import NotConnectedError, StaleSampleError
from drivers.link import CameraImage, LinkChange
from drivers.registry import device_types
from drivers.samples import LinkSample, Sample
from rover_hil.run.replay_link import ReplayLink
from sim_backends.settings import emulator_of
from tests.conformance.benches import ADAPTER, BACKENDS, CASES, NAME, Bench, Case

START_LIMIT_S = 3.0


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=CASES, ids=lambda case: case.device_type)
def bench(request: pytest.FixtureRequest, backend: str, tmp_path: Path) -> Iterator[Bench]:
    with BACKENDS[backend](request.param, tmp_path) as bench:
        yield bench


def heard_all(bench: Bench, samples: list[Sample]) -> bool:
    return set(bench.case.says) <= {type(sample) for sample in samples}


def test_every_device_type_has_a_case_and_an_emulator() -> None:
    known = {get_args(settings.model_fields["type"].annotation)[0] for settings in device_types()}
    assert known == {case.device_type for case in CASES}
    assert all(callable(emulator_of(device_type)) for device_type in known)


def test_nothing_happens_before_connect(bench: Bench) -> None:
    bench.pass_time(0.05)
    assert bench.driver.health().state is DeviceState.CLOSED
    with pytest.raises(NotConnectedError, match=NAME):
        bench.driver.poll()


def test_it_streams_what_it_must(bench: Bench) -> None:
    bench.driver.connect()
    assert bench.driver.health().state is DeviceState.CONNECTED
    said = bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    assert bench.driver.health().state is DeviceState.STREAMING
    assert {sample.device for sample in said} == {NAME}
    kind = bench.case.says[0]
    assert bench.driver.latest(kind, max_age_s=1.0).device == NAME


def test_stamps_are_arrival_times_in_order(bench: Bench) -> None:
    before_ns = bench.clock.now_ns()
    bench.driver.connect()
    bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    bench.forward(0.5)
    stamps = [sample.t_ns for sample in bench.samples]
    assert stamps == sorted(stamps)
    assert before_ns <= stamps[0]
    assert stamps[-1] <= bench.clock.now_ns()


def test_connect_and_close_may_be_repeated(bench: Bench) -> None:
    bench.driver.connect()
    bench.driver.connect()
    bench.driver.close()
    bench.driver.close()
    assert bench.driver.health().state is DeviceState.CLOSED
    bench.driver.connect()
    bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)


def test_what_came_before_the_connection_is_not_told(bench: Bench) -> None:
    bench.driver.connect()
    bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    bench.driver.close()
    bench.pass_time(0.5)
    before_ns = bench.clock.now_ns()
    bench.driver.connect()
    said = bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    assert min(sample.t_ns for sample in said) >= before_ns


def test_pulled_plug_is_told_and_a_restored_one_streams_again(bench: Bench) -> None:
    bench.driver.connect()
    bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    bench.set_plug(pulled=True)
    said = bench.forward_until(
        lambda samples: any(isinstance(sample, LinkSample) for sample in samples), limit_s=0.5
    )
    assert [sample.up for sample in said if isinstance(sample, LinkSample)] == [False]
    assert bench.driver.health().state is DeviceState.DEGRADED
    bench.forward(0.3)
    bench.set_plug(pulled=False)
    said = bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    assert [sample.up for sample in said if isinstance(sample, LinkSample)] == [True]
    assert bench.driver.health().state is DeviceState.STREAMING
    assert bench.driver.health().breaks == 1


def test_silence_makes_it_degraded_and_stale(bench: Bench) -> None:
    bench.driver.connect()
    bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    bench.pass_time(0.02)
    bench.driver.poll()
    if isinstance(bench.clock, VirtualClock):
        bench.clock.sleep_until(bench.clock.now_ns() + 2_000_000_000)
    else:
        bench.clock.sleep_until(bench.clock.now_ns() + round(1.5e9 * bench.settings.max_age_s))
    assert bench.driver.health().state is DeviceState.DEGRADED
    with pytest.raises(StaleSampleError):
        bench.driver.latest(bench.case.says[0], max_age_s=bench.settings.max_age_s)


def test_garbage_is_counted_and_streaming_goes_on(bench: Bench) -> None:
    bench.driver.connect()
    bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    before = sum(bench.driver.health().rejected.values())

    def is_counted(samples: list[Sample]) -> bool:
        # Again and again: on a busy machine a link of pictures passes over all but the newest.
        bench.babble()
        return sum(bench.driver.health().rejected.values()) > before

    bench.forward_until(is_counted, START_LIMIT_S)
    assert sum(bench.driver.health().rejected.values()) > before
    said = bench.forward_until(lambda samples: heard_all(bench, samples), START_LIMIT_S)
    assert said


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.device_type)
def test_missing_port_fails_clearly_and_leaves_no_handle(case: Case, tmp_path: Path) -> None:
    clock = VirtualClock()
    settings = ADAPTER.validate_python({"type": case.device_type, **case.settings(tmp_path / "nowhere")})
    driver: AnyDriver
    if isinstance(settings, FrameDeviceSettings):
        driver = settings.make_driver(NAME, settings.make_link(clock), clock)
    else:
        driver = settings.make_driver(NAME, settings.make_link(clock), clock)
    with pytest.raises(NotConnectedError, match="nowhere"):
        driver.connect(timeout_s=0.05)
    assert driver.health().state is DeviceState.CLOSED
    driver.close()


def test_recorded_raw_data_give_the_same_samples(bench: Bench) -> None:
    bench.driver.connect()
    bench.forward_until(bool, 1.0)
    bench.forward(0.5)
    clock = VirtualClock()
    replayed: AnyDriver
    if isinstance(bench.settings, FrameDeviceSettings):
        image_link = ReplayLink[CameraImage]()
        replayed = bench.settings.make_driver(NAME, image_link, clock)
        for item in bench.tap.items:
            if isinstance(item, LinkChange) or isinstance(item.payload, CameraImage):
                image_link.feed(item)
    else:
        byte_link = ReplayLink[bytes]()
        replayed = bench.settings.make_driver(NAME, byte_link, clock)
        for item in bench.tap.items:
            if isinstance(item, LinkChange) or isinstance(item.payload, bytes):
                byte_link.feed(item)
    replayed.connect()
    said = replayed.poll()
    assert len(said) == len(bench.samples) > 0
    assert [repr(sample) for sample in said] == [repr(sample) for sample in bench.samples]
