"""On the ports of a real rover: every device streams, and nothing that it says is refused.

No wheel is turned: a drive gets zero setpoints with the brakes on, for some answer only when asked.
"""

from collections.abc import Iterator

import pytest

from drivers.clock import NANOSECONDS_PER_SECOND, SystemClock, nanoseconds
from drivers.driver import DeviceState
from drivers.link import NoTap
from rover_hil.config import load_config
from rover_hil.run.composition import Rig, build_real_rig

pytestmark = pytest.mark.rover

CONNECT_TIMEOUT_S = 3.0
LISTEN_S = 3.0
HARMLESS = {"other_sentence", "other_traffic", "other_type"}


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    rig = build_real_rig(load_config(str(request.config.getoption("--rover"))), SystemClock(), NoTap())
    rig.connect(CONNECT_TIMEOUT_S)
    yield rig
    rig.close()


def listen(rig: Rig, duration_s: float) -> None:
    end_ns = rig.clock.now_ns() + nanoseconds(duration_s)
    while rig.clock.now_ns() < end_ns:
        rig.drive.stop()
        rig.clock.sleep_until(rig.clock.now_ns() + NANOSECONDS_PER_SECOND // 20)
        rig.poll()


def test_every_device_streams_without_a_refusal(rig: Rig) -> None:
    listen(rig, LISTEN_S)
    for health in rig.healths():
        assert health.state is DeviceState.STREAMING, health
        assert set(health.rejected) <= HARMLESS, health
        assert health.breaks == 0, health
        assert health.send_failures == 0, health
