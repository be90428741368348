"""Vehicle with steering."""

from types import SimpleNamespace

from benchmarks.gap_machines.models.parts import begin, channel, constant, start_error
from rover_hil.gap import Array, Port, StateModel, effects
from sim_backends.state_model.equations import Signal

SLOW_M_S = 0.1
LIMITS_N = (700.0, 1000.0, 1400.0, 1900.0, 2500.0)


def derivative(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
    """Return the rates of speed and yaw rate."""
    speed = x.speed_m_s
    force = port("force", p.drive_gain * u.force_n - p.damping_n_s_m * speed)
    length_m = p.wheelbase_m * (1.0 + (speed / p.characteristic_m_s) ** 2)
    yaw = port("yaw", speed * u.steering_rad / length_m - x.yaw_rate_rad_s)
    return {"speed_m_s": force / p.mass_kg, "yaw_rate_rad_s": yaw / p.yaw_lag_s}


def start(p: SimpleNamespace, _: SimpleNamespace) -> dict[str, Array]:
    """Return the first speed and yaw rate."""
    return {name: begin(p, name) for name in ("speed_m_s", "yaw_rate_rad_s")}


def output(x: SimpleNamespace, _: SimpleNamespace, __: SimpleNamespace, ___: Signal) -> dict[str, Array]:
    """Return the measured speed and yaw rate."""
    return {"measured_speed_m_s": x.speed_m_s, "measured_yaw_rate_rad_s": x.yaw_rate_rad_s}


def make_model() -> StateModel:
    """Return the model with its candidate effects."""
    return StateModel(
        name="vehicle",
        states={"speed_m_s": "m/s", "yaw_rate_rad_s": "rad/s"},
        inputs={"force_n": "N", "steering_rad": "rad"},
        channels=(
            channel("measured_speed_m_s", "m/s", 0.05, 0.01),
            channel("measured_yaw_rate_rad_s", "rad/s", 0.005, 0.002),
        ),
        parameters=(
            constant("mass_kg", "kg", 1200.0, 0.04, 0.0005),
            constant("damping_n_s_m", "N s/m", 60.0, 0.15, 0.004),
            constant("drive_gain", "1", 1.0, 0.02, 0.001),
            constant("wheelbase_m", "m", 2.6, 0.01, 0.0),
            constant("characteristic_m_s", "m/s", 20.0, 0.08, 0.002),
            constant("yaw_lag_s", "s", 0.2, 0.15, 0.0),
        ),
        derivative=derivative,
        start=start,
        output=output,
        step_s=0.05,
        run_parameters=(
            start_error("speed_m_s", "m/s", 0.1),
            start_error("yaw_rate_rad_s", "rad/s", 0.003),
        ),
        ports=(
            Port(name="force", unit="N", force_sd=150.0),
            Port(name="yaw", unit="rad/s", force_sd=0.02),
        ),
        port_effects=(
            effects.coulomb_friction(
                "force", velocity="speed_m_s", size=500.0, slow=SLOW_M_S, name="rolling_friction"
            ),
            effects.quadratic_drag("force", velocity="speed_m_s", size=3.0),
            effects.saturation("force_n", limits=LIMITS_N),
            effects.delay("steering_rad", size=0.27, longest=1.5, name="input_delay"),
            effects.play("steering_rad", size=0.017, name="steering_backlash"),
            effects.offset("measured_yaw_rate_rad_s", size=0.07, name="sensor_offset"),
            effects.gain_error("measured_speed_m_s", size=0.07),
        ),
        condition_units={"start_speed_m_s": "m/s", "start_yaw_rate_rad_s": "rad/s"},
    )
