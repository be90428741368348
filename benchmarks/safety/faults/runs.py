"""Run one case: the shipped rover, its emulators, the fault between them and the drivers, into a log."""

import zlib
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np

from benchmarks.safety.faults.cases import Case
from benchmarks.safety.faults.injection import Window, inject
from controllers.safety.settings import SafetySettings
from controllers.slip.effort.settings import SURFACES
from drivers.clock import VirtualClock, nanoseconds
from rover_hil.config import Config, load_config
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.schema import END, end_record
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import build_virtual_rig
from rover_hil.run.executive import Executive, RunResult
from sim_backends.world.world import World
from tests.rover_hil.test_gnss_run import config_with

WATCHED_S = 5.0
"""How long the rover is watched after it may drive again."""
MARGIN_S = 1.5
LONGEST_FAULT_S = 3.0


def rover_config(case: Case) -> Config:
    """Return the shipped configuration; the El-Dorado has its camera only where the camera fails.

    A frame costs more than all the rest, and the camera stops nothing.
    """
    if case.device == "gnss":
        return config_with()
    config = load_config(case.rover)
    safety = SafetySettings.model_validate({**config.safety.model_dump(), **case.safety})
    config = config.model_copy(update={"safety": safety})
    if not case.is_excited and config.slip is not None:
        config = config.model_copy(update={"slip": config.slip.model_copy(update={"use": SURFACES})})
    if case.rover != "el-dorado" or case.device == "camera":
        return config
    table = config.model_dump(by_alias=True)
    del table["devices"]["camera"]
    table["roles"]["camera"] = table["scomp"]["rig"] = None
    return Config.model_validate(table)


def run_length_s(config: Config, case: Case, watched_s: float = WATCHED_S) -> float:
    """Return how long the case runs."""
    return (
        config.safety.settle_s + case.after_s + min(case.duration_s, LONGEST_FAULT_S) + watched_s + MARGIN_S
    )


def install(case: Case, world: World, window: Window) -> None:
    """Put the fault of a case into a simulated rover; the seed is that of its name."""
    rng = np.random.default_rng(zlib.crc32(case.title.encode()))
    if case.to_host is not None:
        inject(world.byte_devices[case.device].to_host, window, case.to_host(rng))
    if case.to_device is not None:
        inject(world.byte_devices[case.device].to_device, window, case.to_device(rng))
    if case.frames is not None:
        inject(world.image_devices[case.device].to_host, window, case.frames(rng))
    if case.also is not None:
        install(case.also, world, window)


class FaultTimer:
    """Watches the rover begin to move, and pulls the plug when it is time.

    Args:
        case: The case; its fault is installed.
        world: The simulated rover.
    """

    def __init__(self, case: Case, world: World) -> None:
        self.window = Window(case.after_s, case.duration_s)
        self._case = case
        self._world = world
        self._is_set = not case.is_unplug
        install(case, world, self.window)

    def watch(self, now_ns: int) -> None:
        """Look at the rover; call it often."""
        self.window.watch(now_ns, self._world.plant.truth())
        if not self._is_set and now_ns >= self.window.begin_ns - nanoseconds(self._case.after_s):
            self._is_set = True
            name, world = self._case.device, self._world
            device = world.byte_devices[name] if name in world.byte_devices else world.image_devices[name]
            device.plug_moves.extend([(self.window.begin_ns, True), (self.window.end_ns, False)])


class PausedClock(VirtualClock):
    """Simulated time in which the process is not run for a while, once: stopped, swapped out, suspended."""

    def __init__(self, pause_s: float) -> None:
        super().__init__()
        self.window: Window | None = None
        self._pause_ns = nanoseconds(pause_s)

    def sleep_until(self, deadline_ns: int) -> None:
        """Wake too late when the pause begins."""
        if self._pause_ns and self.window is not None and deadline_ns >= self.window.begin_ns:
            deadline_ns, self._pause_ns = deadline_ns + self._pause_ns, 0
        super().sleep_until(deadline_ns)


def run_case(
    case: Case, path: Path, watched_s: float = WATCHED_S, config: Config | None = None
) -> tuple[RunResult, Window]:
    """Run a case on simulated time into a log, truth included; return the result and when the fault was.

    Another configuration may take the place of the shipped one.
    """
    config = rover_config(case) if config is None else config
    clock = PausedClock(case.pause_s)
    with ExitStack() as resources:
        log = resources.enter_context(
            LogWriter(
                path,
                clock.now_ns(),
                config.model_dump_json(by_alias=True).encode(),
                collect_data_files(config),
                "virtual",
            )
        )
        rig, world = build_virtual_rig(config, clock, log)
        timer = FaultTimer(case, world)
        clock.window = timer.window
        rig.connect(timeout_s=2.0)
        resources.enter_context(closing(rig))

        def on_cycle(now_ns: int) -> None:
            log.truth(now_ns, world.plant.truth())
            timer.watch(now_ns)

        executive = Executive(rig, log, config.loop.rate_hz, on_cycle=on_cycle)
        result = executive.run(run_length_s(config, case, watched_s))
        log.write_json(END, executive.now_ns(), end_record(result))
    return result, timer.window
