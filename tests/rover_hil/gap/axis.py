"""A motor axis by an independent simulation: friction that really sticks, small explicit steps."""

import math

import numpy as np

from rover_hil.gap import Array, Channel, Parameter, Port, Run, RunParameter, StateModel, effects

STEP_S = 0.02
SENSOR_RAD_S = 0.05
SEED = 20261122


def measured_runs(
    count: int = 8,
    *,
    samples: int = 150,
    dry: float = 0.0,
    cube: float = 0.0,
    wear: float = 0.0,
    disturbance: float = 0.0,
    persistence: float = 0.0,
    seed: int = SEED,
) -> list[Run]:
    """Return runs of J dw/dt = k u - b w - friction, with sensor noise.

    Args:
        count: Number of runs.
        samples: Of each run.
        dry: Level of a friction that sticks, rad/s^2.
        cube: Coefficient of a drag with the cube of speed, 1/(rad^2 s).
        wear: Coefficient of a drag with speed times the square of the voltage, 1/(V^2 s).
        disturbance: Size of a slow random force that differs between runs, rad/s^2.
        persistence: Correlation of neighbouring errors of the sensor, whose size stays the same.
        seed: Of inputs, starts and noise.
    """
    rng = np.random.default_rng(seed)
    runs = []
    for number in range(count):
        voltage = np.repeat(rng.uniform(-6.0, 6.0, samples // 25 + 1), 25)[:samples]
        start = float(rng.normal(0.0, 2.0))
        force = _slow(rng, samples) * disturbance
        speed = _simulate(voltage, start, dry, (cube, wear), force)
        noisy = speed + SENSOR_RAD_S * _persistent(rng.standard_normal(samples), persistence)
        runs.append(
            Run(
                name=f"run{number}",
                conditions={},
                inputs={"voltage": voltage},
                measured={"speed_sensor": noisy},
            )
        )
    return runs


def _slow(rng: np.random.Generator, samples: int) -> Array:
    knots = rng.standard_normal(samples // 30 + 2)
    values: Array = np.interp(np.arange(samples), 30.0 * np.arange(knots.size), knots)
    return values


def _persistent(white: Array, persistence: float) -> Array:
    found = white.copy()
    for sample in range(1, white.size):
        found[sample] = persistence * found[sample - 1] + math.sqrt(1.0 - persistence**2) * white[sample]
    return found


def _simulate(voltage: Array, start: float, dry: float, drags: tuple[float, float], force: Array) -> Array:
    parts = 40
    width_s = STEP_S / parts
    cube, wear = drags
    speed, found = start, np.empty(voltage.size)
    for sample, volts in enumerate(voltage):
        found[sample] = speed
        for _ in range(parts):
            drag = (4.0 + cube * speed**2 + wear * volts**2) * speed
            push = 8.0 * volts - drag + float(force[sample])
            if abs(speed) < 1e-12 and abs(push) <= dry:
                speed = 0.0
                continue
            sense = math.copysign(1.0, speed if abs(speed) >= 1e-12 else push)
            after = speed + width_s * (push - sense * dry)
            speed = 0.0 if after * sense < 0.0 else after
    return found


def axis_model(*, has_friction: bool = True, sigma: float = SENSOR_RAD_S) -> StateModel:
    """Return the model that a user would write."""
    friction = effects.coulomb_friction("acceleration", velocity="speed", size=2.0, slow=0.05)
    others = (
        effects.quadratic_drag("acceleration", velocity="speed", size=0.1),
        effects.offset("speed_sensor", size=0.2),
        effects.delay("voltage", size=0.02, longest=0.2),
    )
    return StateModel(
        name="axis",
        states={"speed": "rad/s"},
        inputs={"voltage": "V"},
        channels=(Channel(name="speed_sensor", unit="rad/s", sigma=sigma),),
        parameters=(
            Parameter(name="gain", unit="rad/s^2/V", nominal=8.0, prior_sd=0.4, lower=1.0, upper=50.0),
            Parameter(name="damping", unit="1/s", nominal=4.0, prior_sd=0.4, lower=0.1, upper=50.0),
        ),
        run_parameters=(RunParameter(name="start_speed", unit="rad/s", prior_sd=3.0),),
        ports=(Port(name="acceleration", unit="rad/s^2", force_sd=1.0),),
        derivative=lambda x, u, p, port: {
            "speed": port("acceleration", p.gain * u.voltage - p.damping * x.speed)
        },
        start=lambda p, _: {"speed": p.start_speed},
        output=lambda x, *_: {"speed_sensor": x.speed},
        step_s=STEP_S,
        port_effects=(friction, *others) if has_friction else others,
    )
