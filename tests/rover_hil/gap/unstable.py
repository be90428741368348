"""An inverted pendulum on a motor that a controller holds up: bounded, unlike its simulation."""

import math

import numpy as np

from rover_hil.gap import Channel, Parameter, Port, Run, RunParameter, StateModel, effects

STEP_S, PARTS = 0.02, 20
RATE_PER_S2 = 12.0
GAIN = 5.0
DAMPING_PER_S = 0.4
SENSOR_RAD = 0.002


def balanced_runs(
    count: int = 5, *, samples: int = 300, drag: float = 0.0, seed: int = 20261128
) -> list[Run]:
    """Return runs of angle'' = rate sin(angle) - damping angle' - drag + gain u, held up by feedback.

    Args:
        count: Number of runs.
        samples: Of each run; an error at the start grows by e to the 3.3 per second.
        drag: Of the square of the rate, 1/rad.
        seed: Of setpoints and noise.
    """
    rng = np.random.default_rng(seed)
    runs = []
    for number in range(count):
        wanted = np.repeat(rng.uniform(-0.4, 0.4, samples // 50 + 1), 50)[:samples]
        angle, rate = float(rng.normal(0.0, 0.05)), 0.0
        inputs, readings = np.empty(samples), np.empty(samples)
        for sample in range(samples):
            readings[sample] = angle + SENSOR_RAD * rng.standard_normal()
            inputs[sample] = -8.0 * (angle - float(wanted[sample])) - 2.0 * rate
            for _ in range(PARTS):
                push = RATE_PER_S2 * math.sin(angle) - DAMPING_PER_S * rate + GAIN * float(inputs[sample])
                rate += STEP_S / PARTS * (push - drag * abs(rate) * rate)
                angle += STEP_S / PARTS * rate
        runs.append(
            Run(
                name=f"run{number}",
                conditions={},
                inputs={"current": inputs},
                measured={"angle_sensor": readings},
            )
        )
    return runs


def pendulum_model(**nominal: float) -> StateModel:
    """Return the model that a user would write."""
    parameters = (
        Parameter(name="rate", unit="1/s^2", nominal=12.0, prior_sd=0.6, lower=1.0, upper=50.0),
        Parameter(name="gain", unit="rad/s^2/A", nominal=5.0, prior_sd=0.25, lower=0.1, upper=50.0),
        Parameter(name="damping", unit="1/s", nominal=0.4, prior_sd=0.1, lower=0.0, upper=10.0),
    )
    return StateModel(
        name="balanced",
        states={"angle": "rad", "speed": "rad/s"},
        inputs={"current": "A"},
        channels=(Channel(name="angle_sensor", unit="rad", sigma=SENSOR_RAD),),
        parameters=parameters,
        run_parameters=(
            RunParameter(name="first_angle", unit="rad", prior_sd=0.05, channel="angle_sensor"),
            RunParameter(name="first_speed", unit="rad/s", prior_sd=1.0),
        ),
        ports=(Port(name="torque", unit="rad/s^2", force_sd=0.5),),
        derivative=lambda x, u, p, port: {
            "angle": x.speed,
            "speed": port("torque", p.rate * np.sin(x.angle) - p.damping * x.speed + p.gain * u.current),
        },
        start=lambda p, _: {"angle": p.first_angle, "speed": p.first_speed},
        output=lambda x, *_: {"angle_sensor": x.angle},
        step_s=STEP_S,
        port_effects=(
            effects.coulomb_friction("torque", velocity="speed", size=0.5, slow=0.02),
            effects.quadratic_drag("torque", velocity="speed", size=0.2),
            effects.offset("angle_sensor", size=0.01),
        ),
    )
