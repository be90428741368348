"""A small motor, measured by another integrator, for the tests of the page and the files of an analysis."""

import math
from types import SimpleNamespace

import numpy as np
from scipy.integrate import solve_ivp

from rover_hil.gap import Array, Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from sim_backends.state_model.equations import Signal

STEP_S = 0.05
SAMPLES = 60
NOISE_RAD_S = 0.05


def make_motor() -> StateModel:
    """Return the model: inertia and viscous friction; Coulomb friction and drag may be missing."""

    def derivative(
        x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal
    ) -> dict[str, Array]:
        return {"speed": port("torque", u.drive - p.viscous * x.speed) / p.inertia}

    return StateModel(
        name="page_motor",
        states={"speed": "rad/s"},
        inputs={"drive": "N m"},
        channels=(Channel(name="speed", unit="rad/s", sigma=NOISE_RAD_S),),
        parameters=(
            Parameter(name="inertia", unit="kg m^2", nominal=0.1, prior_sd=0.01, lower=0.01, upper=1.0),
            Parameter(name="viscous", unit="N m s", nominal=0.1, prior_sd=0.01, lower=0.01, upper=1.0),
        ),
        derivative=derivative,
        start=lambda p, _: {"speed": p.first_speed},
        output=lambda x, _, __, ___: {"speed": x.speed},
        step_s=STEP_S,
        run_parameters=(RunParameter(name="first_speed", unit="rad/s", prior_sd=0.2),),
        ports=(Port(name="torque", unit="N m", force_sd=0.1),),
        port_effects=(
            effects.coulomb_friction("torque", velocity="speed", size=0.2, slow=0.2),
            effects.quadratic_drag("torque", velocity="speed", size=0.02),
        ),
    )


def measure_motor(count: int = 5, *, coulomb_nm: float = 0.0, cubic: float = 0.0, seed: int = 0) -> list[Run]:
    """Return runs of the true motor under sums of two sines.

    Args:
        count: Number of runs.
        coulomb_nm: Coulomb friction.
        cubic: Torque per cube of the speed, which no effect of the model describes.
        seed: Of the noise and the inputs.
    """
    rng = np.random.default_rng(seed)
    runs = []
    for number in range(count):
        times: Array = STEP_S * np.arange(SAMPLES, dtype=np.float64)
        first, second = rng.uniform(0.15, 0.35), rng.uniform(0.5, 1.0)
        drive: Array = 0.7 * np.sin(math.tau * first * times + rng.uniform(0.0, math.tau))
        drive += 0.4 * np.sin(math.tau * second * times + rng.uniform(0.0, math.tau))
        speed = _speed(times, drive, coulomb_nm, cubic, rng.normal(0.0, 0.1))
        noisy = speed + rng.normal(0.0, NOISE_RAD_S, SAMPLES)
        runs.append(Run(name=f"r{number}", conditions={}, inputs={"drive": drive}, measured={"speed": noisy}))
    return runs


def _speed(times: Array, drive: Array, coulomb_nm: float, cubic: float, start: float) -> Array:
    def rate(t: float, speed: Array) -> Array:
        held = drive[min(int(t / STEP_S + 1e-9), SAMPLES - 1)]
        friction = 0.1 * speed + coulomb_nm * np.tanh(speed / 0.2) + cubic * speed**3
        found: Array = (held - friction) / 0.1
        return found

    solved = solve_ivp(rate, (0.0, times[-1]), [start], t_eval=times, rtol=1e-6, atol=1e-8, max_step=0.05)
    speed: Array = solved.y[0]
    return speed
