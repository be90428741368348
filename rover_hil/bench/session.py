"""The state behind the page: who is in control, what runs, what was seen of it."""

import threading
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from pathlib import Path
from uuid import uuid4

from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import make_kinematics
from controllers.motion.missions.mission import GAIN_UNITS, LARGEST_COORDINATE_M, PathSettings
from controllers.motion.settings import (
    ByHandMission,
    MissionSettings,
    WaypointsMission,
)
from controllers.operator import OperatorInput, check_gains, gain_ranges
from controllers.settings import find_area_conflicts
from controllers.slip.effort.settings import SURFACES, YAW_PROBE
from drivers.camera.settings import CameraSettings
from drivers.clock import SystemClock, nanoseconds, wall_time_text
from drivers.errors import ConfigError
from rover_hil.bench.finished_runs import list_runs
from rover_hil.bench.loop_process import LoopProcess, ReportFunction, RunFunction
from rover_hil.bench.views import Confirmation, EndOrder, Notice, Order, Picture, RunOrder
from rover_hil.config import Config
from rover_hil.recording.text import strict_json
from rover_hil.run.drive_order import rover_words
from rover_hil.run.excitation import for_real_rover
from rover_hil.run.executive import End

LOG_NAME = "run.mcap"
ARMED_S = 30.0
"""A real run must begin within this time after arming."""
BY_HAND_LIMIT_S = 3600.0
VIEWS_KEPT = 2400
"""Two minutes."""
NOT_IN_CONTROL = (
    "another browser is in control: close its page, and press Take control if a run goes on; you can watch "
    "and press the emergency stop"
)
STILL_THERE = "the browser in control answers: close its page first"
LOOP_HANGS = "the loop of the run takes no orders at the moment: wait, or press the emergency stop"


class State(StrEnum):
    """What the page is doing."""

    IDLE = "idle"
    STARTING = "starting"
    RUNNING = "running"
    REPORTING = "writing report"


class Kind(StrEnum):
    """What a run does: drive the mission, driven by hand, or drive through clicked way-points."""

    MISSION = "mission"
    BY_HAND = "by hand"
    WAYPOINTS = "way-points"


class StopAnswer(StrEnum):
    """What became of an emergency stop.

    ENDED: The run for which it was pressed does not go on.
    SENT: The loop has been ordered to end the run, and has not answered yet.
    OTHER: That run does not go on, but another one does. It was not stopped.
    """

    ENDED = "ended"
    SENT = "sent"
    OTHER = "other run"


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What a page needs to draw itself, but for the views.

    Attributes:
        run: Name of the run that no other run ever has; a page begins anew with each. Empty before the first.
        mission: Corners of the path in m; empty by hand.
        area: Border of the rover's area in m, a closed line; empty without one.
        log_bytes: Size of the log.
        pictures: Of each camera, the number of its newest picture and words on the trace in it.
        is_control_free: Nobody is in control, or who is does not answer.
        runs: Names of the finished runs, the newest first.
        refused: Orders from browsers that were refused because they were no finite numbers.
        server_late_ms: How late the program of the page gave a heartbeat at most, since the run began.
    """

    state: State
    run: str
    is_real: bool
    kind: Kind | None
    is_paused: bool
    is_armed: bool
    message: str
    run_name: str
    report_name: str
    mission: list[tuple[float, float]]
    area: list[tuple[float, float]]
    log_bytes: int
    controller: str | None
    is_control_free: bool
    gains: Mapping[str, float]
    pictures: Mapping[str, tuple[int, str]]
    runs: tuple[str, ...]
    refused: int
    server_late_ms: float


class Session:
    """One rover, at most one run at a time, at most one browser in control.

    Every method may be called from any thread. But for `start`, `look_at_files` and `close` none waits for a
    disk or another process: the event loop that serves the emergency stop calls them. Orders come with the
    name of the browser; those of a browser that is not in control are refused, but for the emergency stop.

    Args:
        config: The rover.
        folder: Folder of all runs.
        stem: Beginning of the names of new runs.
        run: Runs an order, in another process.
        report: Writes its report there.
    """

    def __init__(
        self, config: Config, folder: Path, stem: str, run: RunFunction, report: ReportFunction
    ) -> None:
        self.config = config
        self.folder = folder
        self._stem = stem
        self._functions = run, report
        self._clock = SystemClock()
        self._lock = threading.RLock()
        self._state = State.IDLE
        self._is_closing = False
        self._process = self._make_process()
        self._controller: str | None = None
        self._answered_ns = 0
        self._lines: Counter[str] = Counter()
        self._armed_until_ns = 0
        self._views: deque[bytes] = deque(maxlen=VIEWS_KEPT)
        self._number = 0
        self._pictures: dict[str, tuple[int, Picture]] = {}
        self._run = ""
        self._order: RunOrder | None = None
        self._is_stop_sent = False
        self._runs: tuple[str, ...] = ()
        self._log_bytes = 0
        self._refused = 0
        self._late_ns = 0
        self._kind: Kind | None = None
        self._is_paused = False
        self._message = "" if config.mission is not None else "the configuration has no mission"
        self._report_name = ""
        self._gains = _gains_of(config.mission)

    def enter(self, browser: str) -> None:
        """Note a connection of a browser."""
        with self._lock:
            self._lines[browser] += 1

    def leave(self, browser: str) -> None:
        """Note that a connection of a browser has ended; with its last one the browser is gone.

        While a run goes on it stays in control: the rover drives on for nobody else who happens to look.
        Commands by hand expire on their own.
        """
        with self._lock:
            self._lines[browser] -= 1
            if self._lines[browser] > 0:
                return
            del self._lines[browser]
            if self._controller == browser:
                self._armed_until_ns = 0
                if self._order is None:
                    self._controller = None

    def take_control(self, browser: str) -> None:
        """Give control to a browser whose user asks for it.

        Raises:
            ConfigError: The browser in control is there.
        """
        with self._lock:
            if not self._is_control_free():
                raise ConfigError(STILL_THERE)
            self._controller = browser
            self._answered_ns = self._clock.now_ns()
            self._armed_until_ns = 0

    def arm(self, browser: str) -> None:
        """Allow one start of the real rover within 30 s.

        Raises:
            ConfigError: The browser is not in control.
        """
        with self._lock:
            self._require_control(browser)
            self._armed_until_ns = self._clock.now_ns() + nanoseconds(ARMED_S)

    def start(
        self,
        browser: str,
        kind: Kind,
        *,
        is_real: bool,
        points: tuple[tuple[float, float], ...] = (),
    ) -> None:
        """Start a run; with the present gains.

        Raises:
            ConfigError: The browser is not in control, something runs, the rover is not armed, or it cannot
                drive this.
        """
        with self._lock:
            self._require_control(browser)
            if self._state is not State.IDLE:
                raise ConfigError(f"a run is {self._state.value}: wait for its end, or stop it")
            if is_real and self._clock.now_ns() >= self._armed_until_ns:
                raise ConfigError(
                    "the real rover is not armed: check its surroundings, then arm it and start"
                )
            if not is_real:
                self.config.require_simulation()
            config = self._config_for(kind, points)
            changed = ""
            if is_real:
                config, changed = for_real_rover(config)
                moving = f"moving {rover_words(self._stem, config.devices)}"
                changed = f"{moving}; {changed}" if changed else moving
            name = self._free_name()
            self._armed_until_ns = 0
            self._order = RunOrder(
                source=self._stem,
                config=config,
                log_path=self.folder / name / LOG_NAME,
                limit_s=BY_HAND_LIMIT_S if kind is Kind.BY_HAND else config.loop.time_limit_s,
                is_virtual=not is_real,
            )
            self._kind = kind
            self._is_paused = False
            self._message = changed
            self._report_name = ""
            self._run = uuid4().hex
            self._is_stop_sent = False
            self._log_bytes = self._late_ns = 0
            self._views.clear()
            self._pictures.clear()
            self._state = State.STARTING
            self._process.send(self._order)

    def pause(self, browser: str, *, is_paused: bool) -> None:
        """Pause or resume the run; raises ConfigError as `arm`."""
        with self._lock:
            self._operate(browser, OperatorInput(is_paused=is_paused))
            self._is_paused = is_paused

    def stop(self, browser: str) -> None:
        """End the run; raises ConfigError as `arm`."""
        with self._lock:
            self._operate(browser, EndOrder(end=End.STOPPED_BY_USER, reason="stopped by the user"))

    def emergency_stop(self, run: str | None = None) -> tuple[StopAnswer, str]:
        """End a run, whoever asks; nothing happens where it does not go on.

        Args:
            run: Its name. Another one is not ended: whoever pressed may not know of it. None for any.

        Returns:
            What became of it, and the name of the present run.
        """
        with self._lock:
            self._armed_until_ns = 0
            if self._order is None or self._state is State.REPORTING:
                return StopAnswer.ENDED, self._run
            if run not in (None, self._run):
                return StopAnswer.OTHER, self._run
            if not self._is_stop_sent:
                reason = "emergency stop pressed on the page"
                self._process.send(EndOrder(end=End.EMERGENCY_STOP, reason=reason))
                self._is_stop_sent = True
            return StopAnswer.SENT, self._run

    def drive(self, browser: str, motion: BodyMotion) -> None:
        """Drive by hand; raises ConfigError as `arm`."""
        with self._lock:
            if self._kind is Kind.BY_HAND:
                self._operate(browser, OperatorInput(motion=motion))

    def confirm(self, browser: str, stops: int) -> None:
        """Confirm that the stopped rover may move; raises ConfigError as `arm`.

        Args:
            browser: Whose user has clicked.
            stops: Number of stops in the view that it showed.
        """
        with self._lock:
            self._operate(browser, Confirmation(stops=stops))

    def refuse(self) -> None:
        """Count an order that is no list of finite numbers."""
        with self._lock:
            self._refused += 1

    def give_life(self, late_ns: int) -> None:
        """Give the loop a heartbeat of the event loop that serves the emergency stop.

        Args:
            late_ns: How late it comes.
        """
        self._late_ns = max(self._late_ns, late_ns)
        self._process.server_life.give()

    def answered(self, browser: str) -> None:
        """Note that the script of a page has answered; of the page in control the loop gets a heartbeat.

        A page that only watches keeps no rover moving: it would hide that the page whose user drives hangs.

        If none is in control, it is now. While a run goes on one is, also when it is gone: only a user gives
        control to another one then.
        """
        with self._lock:
            self._controller = self._controller or browser
            if self._controller == browser:
                self._answered_ns = self._clock.now_ns()
                self._process.browser_life.give()

    def look_at_files(self) -> None:
        """Renew the size of the log and the list of finished runs; waits for the disk."""
        with self._lock:
            order = self._order
        if order is None:
            self._runs = tuple(list_runs(self.folder, LOG_NAME))
        else:
            self._log_bytes = _size(order)

    def has_camera(self) -> bool:
        """Return whether the rover has a camera whose frames can be shown."""
        return any(isinstance(device, CameraSettings) for device in self.config.devices.values())

    def gain_ranges(self) -> dict[str, tuple[float, float]]:
        """Return the allowed range of each gain: that of [tune], else that of the key itself."""
        mission = self.config.mission or ByHandMission(type="by_hand")
        ranges = gain_ranges(self.config.model_copy(update={"mission": mission}))
        tunable = {} if self.config.tune is None else self.config.tune.parameters
        for name, (low, high) in ranges.items():
            parameter = tunable.get(f"mission.{name}")
            if parameter is not None:
                ranges[name] = max(low, parameter.low), min(high, parameter.high)
        return ranges

    def set_gain(self, browser: str, name: str, value: float) -> None:
        """Change a gain of the run, or of the next one.

        Raises:
            ConfigError: The value is outside its range, or the browser is not in control.
        """
        with self._lock:
            self._require_control(browser)
            check_gains(self.gain_ranges(), {name: value})
            self._operate(browser, OperatorInput(gains={name: value}))
            self._gains[name] = value

    def views(self, number: int, most: int) -> tuple[int, list[bytes]]:
        """Return the number of the last of at most so many views after a number, and these as JSON."""
        with self._lock:
            first = max(0, number - (self._number - len(self._views)))
            views = list(islice(self._views, first, first + most))
            return self._number - len(self._views) + first + len(views), views

    def snapshot(self) -> Snapshot:
        """Return the present state."""
        with self._lock:
            order = self._order
            mission = None if order is None else order.config.mission
            return Snapshot(
                state=self._state,
                run=self._run,
                is_real=order is not None and not order.is_virtual,
                kind=self._kind,
                is_paused=self._is_paused,
                is_armed=self._clock.now_ns() < self._armed_until_ns,
                message=self._message,
                run_name="" if order is None else order.log_path.parent.name,
                report_name=self._report_name,
                mission=_corners(self.config.mission if mission is None else mission),
                area=[] if self.config.safety.area is None else list(self.config.safety.area.outline()),
                log_bytes=self._log_bytes,
                controller=self._controller,
                is_control_free=self._is_control_free(),
                gains=dict(self._gains),
                pictures={name: (number, item["words"]) for name, (number, item) in self._pictures.items()},
                runs=self._runs,
                refused=self._refused,
                server_late_ms=self._late_ns / 1e6,
            )

    def picture(self, camera: str) -> bytes | None:
        """Return the newest picture of a camera as JPEG; None before the first."""
        with self._lock:
            picture = self._pictures.get(camera)
            return None if picture is None else picture[1]["jpeg"]

    def close(self) -> None:
        """End the run and its process."""
        with self._lock:
            self._is_closing = True
        self._process.close()

    def _is_control_free(self) -> bool:
        silent_ns = self._clock.now_ns() - self._answered_ns
        return self._controller is None or silent_ns > nanoseconds(self.config.bench.page_timeout_s)

    def _require_control(self, browser: str) -> None:
        if browser != self._controller:
            raise ConfigError(NOT_IN_CONTROL)

    def _operate(self, browser: str, order: Order) -> None:
        self._require_control(browser)
        if self._order is not None and not self._process.send(order):
            raise ConfigError(LOOP_HANGS)

    def _config_for(self, kind: Kind, points: tuple[tuple[float, float], ...]) -> Config:
        config, update = self.config, dict[str, object]()
        mission = config.mission
        path = {} if mission is None else mission.model_dump(include=set(PathSettings.model_fields))
        if kind is Kind.BY_HAND:
            mission = ByHandMission.model_validate({**path, "type": "by_hand", "heading": "along_path"})
            if config.slip is not None and config.slip.use == YAW_PROBE:
                # The excitation would turn a rover that someone drives.
                update["slip"] = config.slip.model_copy(update={"use": SURFACES})
        elif kind is Kind.WAYPOINTS:
            _check_points(points)
            mission = WaypointsMission.model_validate({**path, "type": "waypoints", "points": points})
        if mission is None:
            raise ConfigError("the configuration has no mission: add [mission], or drive by hand")
        mission = mission.model_copy(update=self._gains)
        for conflict in mission.conflicts(make_kinematics(config.rover)):
            raise ConfigError(conflict)
        for conflict in find_area_conflicts(config.rover, mission, config.safety):
            raise ConfigError(conflict)
        return config.model_copy(update={**update, "mission": mission})

    def _free_name(self) -> str:
        name = f"{self._stem}-{wall_time_text()}"
        while (self.folder / name).exists():
            name += "-2"
        return name

    def _make_process(self) -> LoopProcess:
        return LoopProcess(*self._functions, self._take)

    def _take(self, notice: Notice) -> None:
        is_last = notice["kind"] in ("reported", "failed")
        # Before the lock is held: starting a process takes long, and the emergency stop needs the lock.
        process = self._make_process() if is_last and not self._is_closing else None
        view = strict_json(notice) if notice["kind"] == "view" else b""
        with self._lock:
            if notice["kind"] == "view":
                self._state = State.RUNNING
                self._views.append(view)
                self._number += 1
            elif notice["kind"] == "picture":
                number, _ = self._pictures.get(notice["camera"], (0, None))
                self._pictures[notice["camera"]] = number + 1, notice
            elif notice["kind"] == "ended":
                self._state = State.REPORTING
                self._message = notice["reason"]
            else:
                if notice["kind"] == "failed":
                    self._message = notice["error"]
                elif self._order is not None:
                    self._report_name = self._order.log_path.parent.name
                self._order = None
                self._state = State.IDLE
                if self._controller not in self._lines:
                    self._controller = None
                if process is not None and not self._is_closing:
                    self._process, process = process, None
        if process is not None:
            process.close()  # the program has begun to end meanwhile


def _gains_of(mission: MissionSettings | None) -> dict[str, float]:
    settings = mission or ByHandMission(type="by_hand")
    return {name: float(getattr(settings, name)) for name in GAIN_UNITS}


def _check_points(points: tuple[tuple[float, float], ...]) -> None:
    if not points:
        raise ConfigError("there are no way-points: click into the picture of the path first")
    for number, point in enumerate(points, start=1):
        if not all(abs(value) <= LARGEST_COORDINATE_M for value in point):
            x_m, y_m = point
            raise ConfigError(
                f"way-point {number} at {x_m:g}, {y_m:g} m is outside -{LARGEST_COORDINATE_M:g} .. "
                f"{LARGEST_COORDINATE_M:g} m: clear the way-points and set them again"
            )


def _corners(mission: MissionSettings | None) -> list[tuple[float, float]]:
    return list(mission.corners()) if mission is not None and mission.has_path else []


def _size(order: RunOrder) -> int:
    try:
        return order.log_path.stat().st_size
    except OSError:
        return 0
