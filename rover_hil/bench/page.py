"""The page itself, in NiceGUI: controls and frames; the pictures are drawn by `static/bench.js`."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from html import escape

from nicegui import Client, ui
from nicegui.events import GenericEventArguments, ValueChangeEventArguments

from controllers.motion.missions.mission import GAIN_UNITS
from drivers.errors import RoverHilError
from rover_hil.bench.finished_runs import RunReader
from rover_hil.bench.session import LOG_NAME, Kind, Session, State

REFRESH_S = 0.25
RECONNECT_S = 60.0
"""A page whose connection is back within this time goes on; later it is loaded again, as another browser."""
GAIN_PERIOD_S = 0.04
SLIDER_STEPS = 400
RUNS_ON_TOP = 2
MOST_WAYPOINTS = 200
CHARTS = {
    "slip": ("Slip", "%"),
    "currents": ("Motor currents", "A"),
    "headings": ("Headings", "deg"),
    "cycles": ("Cycle time", "ms; longest of 50 ms"),
}
PATH_WORDS = "dashed: mission; ellipse: 2 standard deviations; click to set way-points"
CAMERA_WORDS = "the trace as it is estimated: green where it is detected, else orange"
BAR = """
<div id="bench-alarm" role="alert" hidden></div>
<div id="bench-wait" role="alert" hidden><span id="bench-why"></span>
<button id="bench-confirm">Let the rover move again</button></div>
<div id="bench-bar" data-browser="{browser}"><span class="title">{title}</span>
<span id="bench-mode">connecting</span>
<span id="bench-words"></span>
<button id="bench-stop" title="also the Escape key">EMERGENCY STOP</button></div>
"""


@dataclass
class _Controls:
    """The controls of one browser's page."""

    session: Session
    browser: str
    reader: RunReader
    points: list[tuple[float, float]] = field(default_factory=list)

    async def build(self) -> None:
        """Put the page together, card by card: the event loop handles an emergency stop between them."""
        with ui.element("div").classes("bench-page"):
            with ui.element("div").classes("bench-column"):
                with _card("Path", PATH_WORDS).classes("bench-path"):
                    _canvas("path")
                if self.session.has_camera():
                    with _card("Camera", CAMERA_WORDS):
                        ui.html('<div id="bench-cameras">no picture yet</div>', sanitize=False)
                with ui.element("div").classes("bench-charts"):
                    for chart, (title, unit) in CHARTS.items():
                        with _card(title, unit):
                            _canvas(chart)
            await asyncio.sleep(0.0)
            with ui.element("div").classes("bench-column"):
                self._build_run()
                await asyncio.sleep(0.0)
                self._build_stick()
                # Above the cards that grow, so that a slider does not move under the pointer.
                await self._build_gains()
                with _card("Now", ""):
                    _table("bench-facts")
                with _card("Devices", "state, rate, age of the newest sample"):
                    _table("bench-devices")
                self._build_finished()
        ui.timer(REFRESH_S, self._refresh)
        ui.on("drive", self._drive, throttle=0.0)
        ui.on("points", self._take_points)

    def _build_run(self) -> None:
        has_mission = self.session.config.mission is not None
        can_simulate = self.session.config.simulation is not None
        with _card("Run", ""):
            self._rover = ui.toggle(
                {False: "simulated rover", True: "real rover"}, value=not can_simulate
            ).props("dense no-caps")
            self._rover.set_enabled(can_simulate)
            with ui.element("div").classes("bench-row q-mt-sm"):
                self._mission = _button("Start mission", lambda: self._start(Kind.MISSION), "positive")
                self._by_hand = _button("Drive by hand", lambda: self._start(Kind.BY_HAND), "positive")
                self._waypoints = _button("Drive way-points", lambda: self._start(Kind.WAYPOINTS), "positive")
                self._arm = _button("Arm", self._do(lambda: self.session.arm(self.browser)), "warning")
            with ui.element("div").classes("bench-row q-mt-sm"):
                self._pause = _button("Pause", self._toggle_pause, "primary")
                self._stop = _button("Stop", self._do(lambda: self.session.stop(self.browser)), "primary")
                take = self._do(lambda: self.session.take_control(self.browser))
                self._take_control = _button("Take control", take, "warning")
                self._clear = _button("Clear way-points", self._clear_points, "grey-7")
            self._note = ui.label().classes("bench-note q-mt-xs")
            with ui.element("div").classes("bench-report"):
                self._report = ui.link("", "").props('target="_blank"')
        self._has_mission = has_mission

    def _build_stick(self) -> None:
        self._stick = _card("Drive by hand", "")
        with self._stick:
            ui.label(
                "Arrows or W A S D; Q and E move sideways, where the rover can; or a gamepad: "
                "left stick, right stick sideways. Letting go stops the rover."
            ).classes("bench-note")
            ui.html('<div id="bench-stick"><div id="bench-knob"></div></div>', sanitize=False)

    async def _build_gains(self) -> None:
        self._sliders: dict[str, ui.slider] = {}
        with _card("Gains", "within their allowed range; logged, replayed exactly"):
            gains = self.session.snapshot().gains
            for name, (low, high) in self.session.gain_ranges().items():
                with ui.element("div").classes("bench-gain"):
                    ui.label(f"{name} ({low:g} .. {high:g} {GAIN_UNITS[name]})").classes("name")
                    slider = ui.slider(
                        min=low, max=high, step=(high - low) / SLIDER_STEPS, value=gains[name]
                    ).props(f'data-gain="{name}"')
                    number = ui.number(value=gains[name], format="%.4g").props("dense outlined")
                    slider.on(
                        "update:model-value",
                        self._on_slider(name, number),
                        throttle=GAIN_PERIOD_S,
                    )
                    number.on("keydown.enter", self._on_number(name, number, slider))
                    self._sliders[name] = slider
                await asyncio.sleep(0.0)

    def _build_finished(self) -> None:
        with _card("Finished runs", "open one, or two on top of each other"):
            self._runs = (
                ui.select([], multiple=True, label="runs", on_change=self._open_runs, clearable=True)
                .classes("w-full")
                .props("dense outlined use-chips max-values=2")
            )
            self._links = ui.element("div").classes("bench-row")
            self._listed: list[str] = []

    def _do(self, action: Callable[[], None]) -> Callable[[], None]:
        """Return a handler that shows the sentence of an error."""

        def handle() -> None:
            try:
                action()
            except RoverHilError as error:
                ui.notify(str(error), type="negative", position="bottom", multi_line=True)

        return handle

    def _start(self, kind: Kind) -> None:
        is_real = bool(self._rover.value)
        points = tuple(self.points)
        start = self.session.start
        self._do(lambda: start(self.browser, kind, is_real=is_real, points=points))()

    def _toggle_pause(self) -> None:
        is_paused = not self.session.snapshot().is_paused
        self._do(lambda: self.session.pause(self.browser, is_paused=is_paused))()

    def _drive(self, event: GenericEventArguments) -> None:
        shares = self._numbers(event.args, 3)
        if shares is None:
            return
        forward, left, turn = (min(1.0, max(-1.0, share)) for share in shares)
        gains = self.session.snapshot().gains
        speed_m_s, rate_rad_s = gains["speed_m_s"], gains["yaw_rate_limit_rad_s"]
        motion = (forward * speed_m_s, left * speed_m_s, turn * rate_rad_s)
        self._do(lambda: self.session.drive(self.browser, motion))()

    def _take_points(self, event: GenericEventArguments) -> None:
        given = event.args if isinstance(event.args, list) else [None]
        points = [self._numbers(point, 2) for point in given[:MOST_WAYPOINTS]]
        if None not in points:
            self.points = [(point[0], point[1]) for point in points if point is not None]

    def _numbers(self, given: object, count: int) -> list[float] | None:
        """Return so many finite numbers from a browser; None, and count it, where it sent anything else."""
        numbers = finite_numbers(given, count)
        if numbers is None:
            self.session.refuse()
        return numbers

    def _clear_points(self) -> None:
        ui.run_javascript("bench.clearPoints()")

    def _on_slider(self, name: str, number: ui.number) -> Callable[[GenericEventArguments], None]:
        def handle(event: GenericEventArguments) -> None:
            values = self._numbers([event.args], 1)
            if values is not None:
                number.set_value(values[0])
                self._do(lambda: self.session.set_gain(self.browser, name, values[0]))()

        return handle

    def _on_number(self, name: str, number: ui.number, slider: ui.slider) -> Callable[[], None]:
        def handle() -> None:
            value = number.value
            if value is not None:
                self._do(lambda: self.session.set_gain(self.browser, name, float(value)))()
            kept = self.session.snapshot().gains[name]
            number.set_value(kept)
            slider.set_value(kept)

        return handle

    async def _open_runs(self, event: ValueChangeEventArguments[list[str] | None]) -> None:
        names = list(event.value or [])[:RUNS_ON_TOP]
        runs, words, errors = b"[]", list[tuple[str, str]](), list[str]()
        if names:
            folder = self.session.folder
            try:
                runs, words, errors = await asyncio.to_thread(self.reader.read, folder, names, LOG_NAME)
            except RoverHilError as lost:
                errors = [str(lost)]
        if names != list(self._runs.value or [])[:RUNS_ON_TOP]:
            return  # others have been chosen meanwhile
        for error in errors:
            ui.notify(error, type="negative", multi_line=True)
        ui.run_javascript(f"bench.open({runs.decode()})")
        self._links.clear()
        with self._links:
            for name, what in words:
                ui.label(what).classes("bench-note")
                ui.link("report", f"/report/{name}", new_tab=True)

    def _refresh(self) -> None:
        """Enable what is possible now."""
        now = self.session.snapshot()
        is_idle, has_control = now.state is State.IDLE, now.controller == self.browser
        is_running = now.state is State.RUNNING
        is_real = bool(self._rover.value)
        may_start = is_idle and has_control and (now.is_armed or not is_real)
        self._mission.set_enabled(may_start and self._has_mission)
        self._by_hand.set_enabled(may_start)
        self._waypoints.set_enabled(may_start and bool(self.points))
        self._arm.set_visibility(is_real)
        self._arm.set_enabled(is_idle and has_control and not now.is_armed)
        self._arm.set_text("Armed for 30 s" if now.is_armed else "Arm")
        self._pause.set_enabled(is_running and has_control)
        self._pause.set_text("Resume" if now.is_paused else "Pause")
        self._stop.set_enabled(is_running and has_control)
        for button, is_possible in (
            (self._take_control, now.is_control_free and not has_control),
            (self._clear, bool(self.points)),
        ):
            button.set_visibility(is_possible)
            button.set_enabled(is_possible)
        self._stick.set_visibility(is_running and has_control and now.kind is Kind.BY_HAND)
        self._note.set_text(_note(now.state, has_control=has_control, is_real=is_real, is_armed=now.is_armed))
        self._report.set_visibility(bool(now.report_name))
        if now.report_name:
            self._report.set_text(f"report of {now.report_name}")
            self._report.props(f'href="/report/{now.report_name}"')
        if is_idle:
            names = list(now.runs)
            if names != self._listed:
                self._listed = names
                self._runs.set_options(names)


def finite_numbers(given: object, count: int) -> list[float] | None:
    """Return what came from outside as so many finite numbers; None where it is anything else.

    To be asked before anything is computed: a limit makes full speed of what is not a number.
    """
    if not isinstance(given, list) or len(given) != count:
        return None
    if any(isinstance(item, bool) or not isinstance(item, int | float) for item in given):
        return None
    try:
        numbers = [float(item) for item in given]
    except OverflowError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None


def build_page(session: Session, title: str) -> None:
    """Register the page of a session."""
    reader = RunReader()

    @ui.page("/", title=f"{title} - rover_hil bench", dark=None, reconnect_timeout=RECONNECT_S)
    async def bench(client: Client) -> None:
        browser = client.id
        ui.add_head_html('<link rel="stylesheet" href="/static/bench.css">')
        ui.add_body_html(BAR.format(title=escape(title), browser=escape(browser)))
        ui.add_body_html('<script src="/static/plot.js" defer></script>')
        ui.add_body_html('<script src="/static/bench.js" defer></script>')
        ui.add_body_html('<script src="/static/stop.js" defer></script>')
        await _Controls(session, browser, reader).build()


def _note(state: State, *, has_control: bool, is_real: bool, is_armed: bool) -> str:
    if not has_control:
        return "Another browser is in control: you can watch and press the emergency stop."
    if state is not State.IDLE:
        return ""
    if is_real and not is_armed:
        return "The real rover will move: clear its surroundings, keep its own stop at hand, then arm it."
    return ""


def _card(title: str, words: str) -> ui.element:
    card = ui.element("div").classes("bench-card")
    with card:
        ui.html(f"<h2>{escape(title)} <small>{escape(words)}</small></h2>", sanitize=False)
    return card


def _canvas(chart: str) -> None:
    ui.element("canvas").props(f'data-chart="{chart}"')


def _table(name: str) -> None:
    ui.html(f'<table class="bench-table"><tbody id="{name}"></tbody></table>', sanitize=False)


def _button(text: str, action: Callable[[], None], colour: str) -> ui.button:
    """Return a button that is disabled until `_refresh` knows whether its action is possible."""
    button = ui.button(text, on_click=action, color=colour)
    button.props("no-caps unelevated dense padding='6px 12px'").disable()
    return button
