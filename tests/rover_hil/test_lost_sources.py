"""A source that is lost and stops nothing is on the screen of `run`, and in the report."""

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.live import Live

from controllers.control_loop import StepOutput
from drivers.clock import nanoseconds
from drivers.driver import DeviceState, Health
from rover_hil.drive.run_surroundings import LostDevices, display
from rover_hil.report.read_run import read_run
from rover_hil.report.summary import summarise
from rover_hil.report.verdict import facts
from rover_hil.run.driving import run_virtual
from rover_hil.terminal import Terminal
from sim_backends.world.faults import StateFault
from tests.rover_hil.test_gnss_run import config_with
from tests.rover_hil.test_log_schema import OUTPUT

LOST = (DeviceState.DEGRADED, DeviceState.FAILED, DeviceState.CONNECTED)


def health(device: str, state: DeviceState, age_s: float | None = 0.1) -> Health:
    return Health(
        device=device,
        state=state,
        rate_hz=5.0,
        age_s=age_s,
        accepted=1,
        rejected={},
        breaks=0,
        sent=0,
        send_failures=0,
        last_link_reason="",
    )


def at(t_s: float, reason: str = "", suspicion: str = "") -> StepOutput:
    return replace(OUTPUT, t_ns=nanoseconds(t_s), reason=reason, suspicion=suspicion)


@pytest.mark.parametrize("state", LOST)
def test_a_lost_source_is_named_with_its_time_until_it_is_back(state: DeviceState) -> None:
    lost = LostDevices()
    wheels = health("wheels", DeviceState.STREAMING)
    streaming, gone = health("gnss", DeviceState.STREAMING), health("gnss", state)
    assert lost.lines(at(0.0), [wheels, streaming]) == []
    for t_s in (12.0, 20.0, 21.0):
        assert lost.lines(at(t_s), [wheels, gone]) == ["warning: gnss lost since 12 s of the run"]
    assert lost.lines(at(22.0), [wheels, streaming]) == []
    assert lost.lines(at(30.0), [wheels, gone]) == ["warning: gnss lost since 30 s of the run"]


def test_a_device_that_stops_the_rover_is_not_named_twice() -> None:
    gone = health("imu", DeviceState.DEGRADED)
    assert LostDevices().lines(at(9.0, reason="imu: link down (unplugged)"), [gone]) == []


def test_a_device_has_two_seconds_for_its_first_sample() -> None:
    lost, silent = LostDevices(), health("camera", DeviceState.CONNECTED, None)
    assert lost.lines(at(0.0), [silent]) == lost.lines(at(1.9), [silent]) == []
    assert lost.lines(at(2.0), [silent]) == ["warning: camera lost since 0 s of the run"]


def test_the_screen_shows_lost_devices_and_warnings() -> None:
    printed = io.StringIO()
    console = Terminal(file=printed, soft_wrap=True)
    console.width = 200
    with Live(console=console, auto_refresh=False) as live:
        show = display(live, console, config_with(), "")
        show(at(0.0), [health("camera", DeviceState.STREAMING)])
        show(at(5.0, suspicion="wheel 0: turns at 40 %"), [health("camera", DeviceState.FAILED)])
    shown = printed.getvalue()
    assert "warning: camera lost since 5 s of the run" in shown
    assert "warning: wheel 0: turns at 40 %" in shown


def test_a_run_shows_and_reports_a_receiver_that_is_unplugged(tmp_path: Path) -> None:
    config = config_with()
    fault = StateFault(type="unplug", device="gnss", start_s=2.0, duration_s=1e5)
    simulation = config.require_simulation().model_copy(update={"faults": (fault,)})
    seen: list[tuple[StepOutput, list[Health]]] = []
    log = tmp_path / "run.mcap"
    run_virtual(
        config.model_copy(update={"simulation": simulation}),
        log,
        5.0,
        lambda output, healths: seen.append((output, list(healths))),
    )
    assert {each.device for _, healths in seen for each in healths} >= {"gnss"}
    told = [fact for fact in facts(summarise(read_run(log))) if fact.name == "device lost"]
    assert [fact.value for fact in told] == ["gnss"]
