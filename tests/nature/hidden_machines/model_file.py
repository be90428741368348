"""The model that the user of a machine writes by the tutorial."""

import numpy as np

from tests.nature.hidden_machines.draw import Case, noise_rng, rounded, true_size
from tests.nature.hidden_machines.effect import Effect
from tests.nature.hidden_machines.machine import Number, Sensor, Start

GUESS = 3.0
"""Factor by which a user's guess of a size may be wrong."""
LIMITS = (0.4, 0.55, 0.7, 0.9)
"""Trial limits of a user, over the greatest signal in the runs."""


def model_text(case: Case) -> str:
    """Return the Python file of the model."""
    machine = case.machine
    states = ", ".join(f'"{state}": p.first_{state}' for state in machine.states)
    conditions = {condition.name: condition.unit for condition in machine.conditions}
    lines = [
        f'"""A user\'s model: {machine.name}."""',
        "",
        "import numpy as np",
        "",
        "from rover_hil.gap import Channel, Parameter, Port, RunParameter, StateModel, effects",
        "",
        "",
        "def derivative(x, u, p, port):",
        machine.derivative.strip("\n"),
        "",
        "",
        "def start(p, u):",
        f"    return {{{states}}}",
        "",
        "",
        "def output(x, u, p, port):",
        f"    return {machine.output}",
        "",
        "",
        "def make():",
        "    return StateModel(",
        f'        name="{machine.name}",',
        f"        states={dict(machine.states)!r},",
        f"        inputs={ {command.name: command.unit for command in machine.inputs}!r},",
        *([f"        condition_units={conditions!r},"] if conditions else []),
        "        is_held=True,",
        f"        step_s={machine.step_s!r},",
        "        derivative=derivative,",
        "        start=start,",
        "        output=output,",
        *_block("channels", [_channel(sensor) for sensor in machine.sensors]),
        *_block("parameters", [_parameter(number) for number in machine.numbers]),
        *_block("run_parameters", [_run_parameter(case, start) for start in machine.starts]),
        *_block("ports", [_port(name, *at) for name, at in machine.ports.items()]),
        *_block("port_effects", _effects(case)),
        "    )",
    ]
    return "\n".join(lines) + "\n"


def _block(name: str, entries: list[str]) -> list[str]:
    return [f"        {name}=(", *(f"            {entry}," for entry in entries), "        ),"]


def _channel(sensor: Sensor) -> str:
    quantum = f", quantum={sensor.quantum!r}" if sensor.quantum else ""
    return f'Channel(name="{sensor.name}", unit="{sensor.unit}", sigma={sensor.sigma!r}{quantum})'


def _parameter(number: Number) -> str:
    prior = rounded(number.share_sd * number.nominal, 3)
    low, high = rounded(0.3 * number.nominal, 3), rounded(3.0 * number.nominal, 3)
    start = f'Parameter(name="{number.name}", unit="{number.unit}", nominal={number.nominal!r}'
    return f"{start}, prior_sd={prior!r}, lower={low!r}, upper={high!r})"


def _run_parameter(case: Case, start: Start) -> str:
    noise = {sensor.name: sensor.noise for sensor in case.machine.sensors}
    unit = case.machine.states[start.state]
    prior = rounded(noise.get(start.channel, start.spread), 3)
    channel = f', channel="{start.channel}"' if start.channel else ""
    return f'RunParameter(name="first_{start.state}", unit="{unit}", prior_sd={prior!r}{channel})'


def _port(name: str, unit: str, force: float) -> str:
    return f'Port(name="{name}", unit="{unit}", force_sd={force!r})'


def _greatest(case: Case, effect: Effect) -> float:
    """Return the greatest signal that the user sees, or expects at a port."""
    signal = case.inputs.get(effect.place)
    return effect.reported(0.0) if signal is None else float(np.max(np.abs(signal)))


def _effects(case: Case) -> list[str]:
    """Return a line per listed effect; the guess of a size is drawn about the hidden or the usual one."""
    rng = noise_rng(case, -1)
    sizes = {effect.name: abs(true_size(case, effect, strength)) for effect, strength in case.hidden}
    lines = []
    for effect in case.listed:
        guess = sizes.get(effect.name, effect.typical) * GUESS ** rng.uniform(-1.0, 1.0)
        guess = min(guess, effect.most)
        limits = tuple(rounded(share * _greatest(case, effect), 3) for share in LIMITS)
        lines.append(effect.line.format(size=rounded(max(guess, 1e-9), 2), limits=limits))
    return lines
