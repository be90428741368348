"""`rover-hil simulate`: serve the simulated rover on its ports in real time."""

import math
import signal
from pathlib import Path
from typing import Annotated

from rich.live import Live
from rich.text import Text

from drivers.clock import Clock, SystemClock, seconds
from rover_hil.config import load_config
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.options import LONGEST_S, ConfigArgument, PlantModelOption, number_option
from rover_hil.run.checks import SIMULATE_CHECKS
from rover_hil.run.end_signals import end_signals
from rover_hil.terminal import Terminal
from sim_backends.build import build_world
from sim_backends.serving.server import Server, put_on_ports
from sim_backends.settings import SimulationSettings

STATUS_PERIOD_S = 0.25
FIRST_WORD_S = 3.0
"""The first cycles compile and load; later the machine should keep up."""
SLOW_FACTOR = 2.0
"""Due cycles over those that were run; a simulated camera alone takes a third of them."""


def simulate(
    config_name: ConfigArgument,
    duration_s: Annotated[
        float | None, number_option("End after this many seconds.", "s", 0.1, LONGEST_S, "--duration")
    ] = None,
    model: PlantModelOption = None,
) -> int:
    """Serve the simulated rover on the ports that the configuration names, until ctrl-C.

    Example: `rover-hil simulate robotino`, and in another terminal `rover-hil run robotino`
    """
    config = load_config(config_name, SIMULATE_CHECKS)
    simulation = config.require_simulation()
    console = Terminal()
    if model is not None:
        from rover_hil.drive.extended_simulation import extend_simulation

        simulation, changed_values = extend_simulation(config, model)
        for line in changed_values:
            console.print(line)
    clock = SystemClock()
    world = build_world(config.devices, simulation, clock.now_ns())
    previous = {number: signal.signal(number, signal.default_int_handler) for number in end_signals()}
    try:
        with Server(world, put_on_ports(world, config.devices), clock) as server:
            _announce(console, server, config_name, simulation)
            if config.ros2 is not None:
                console.print("That run speaks ROS 2; this simulated rover has its devices only.")
            _serve(console, server, clock, math.inf if duration_s is None else duration_s)
    except KeyboardInterrupt:
        pass
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    return EXIT_OK


def _announce(console: Terminal, server: Server, config_name: str, simulation: SimulationSettings) -> None:
    for device in server.served:
        console.print(f"{device.name:<12} {device.port.where}", soft_wrap=True)
    for fault in simulation.faults:
        end_s = fault.start_s + fault.duration_s
        console.print(f"{fault.device:<12} {fault.type} from {fault.start_s:g} s to {end_s:g} s from now")
    console.print(f"In another terminal, in {Path.cwd()}:", soft_wrap=True)
    console.print(f"  rover-hil run {config_name}", soft_wrap=True)
    console.print("End with ctrl-C.")


def _serve(console: Terminal, server: Server, clock: Clock, duration_s: float) -> None:
    start_ns = clock.now_ns()
    time_s = 0.0
    counted_from: tuple[float, int] | None = None
    is_told = False
    with Live(console=console, auto_refresh=False) as live:
        while time_s < duration_s:
            server.run(min(STATUS_PERIOD_S, duration_s - time_s))
            time_s = seconds(clock.now_ns() - start_ns)
            if counted_from is None and time_s >= FIRST_WORD_S:
                counted_from = time_s, server.skipped_cycles
            if counted_from is not None and not is_told and time_s >= counted_from[0] + FIRST_WORD_S:
                words = too_slow(server.skipped_cycles - counted_from[1], time_s - counted_from[0])
                if words:
                    live.console.print(words)
                    is_told = True
            live.update(_status(server, time_s), refresh=True)


def too_slow(skipped_cycles: int, time_s: float) -> str:
    """Return the message for a user whose machine does not keep up with the simulation; "" where it does."""
    due = 1000.0 * time_s
    factor = due / max(1.0, due - skipped_cycles)
    if factor < SLOW_FACTOR:
        return ""
    return (
        f"this machine is too slow to simulate in real time, by a factor of {factor:.1f}: {skipped_cycles} "
        f"of {due:.0f} cycles were skipped, and the devices send late and in bursts. End other programs, "
        "leave a camera out, or use `rover-hil run --virtual`, which needs no real time"
    )


def _status(server: Server, time_s: float) -> Text:
    truth = server.world.plant.truth()
    wheels = " ".join(f"{speed:+.2f}" for speed in truth.wheel_speed_rad_s)
    ports = "  ".join(f"{device.name} {device.sent} sent {device.dropped} lost" for device in server.served)
    return Text(
        f"{time_s:7.1f} s  x {truth.x_m:+.3f} m  y {truth.y_m:+.3f} m  "
        f"yaw {math.degrees(truth.yaw_rad):+.1f} deg\n"
        f"wheels {wheels} rad/s  skipped cycles {server.skipped_cycles}\n{ports}"
    )
