"""The odometry of a rover on four wheels that do not steer, and the effects that may be missing in it.

Base: the wheels roll without slip or drift; the mean speeds of both sides give speed and turn; gyro and
compass measure the true rate and heading except for an offset. All is compared as mean rates in windows of
0.2 s, so that an error affects only its own windows.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from sim_backends.models.delay import later
from sim_backends.models.drive_effects import true_wheel_speed
from sim_backends.models.four_wheel_drive.effects import drift_angle, iron_deg, lagging_heading, slip_on_soil
from sim_backends.models.interface import Array, Channel, EffectCard, Run, Values
from sim_backends.models.nominal_values import NominalValues
from sim_backends.models.tables import read_tables

WHEELS = (1, 2, 3, 4)
RADIUS_M = 0.092
TRACK_M = 0.44
TURN_WINDOWS = 5

CHANNELS = (
    Channel(name="forward_m_s", unit="m/s", is_optional=True),
    Channel(name="left_m_s", unit="m/s", is_optional=True),
    Channel(name="turn_rad_s", unit="rad/s", is_optional=True),
    Channel(name="gyro_deg_s", unit="deg/s", is_optional=True),
    Channel(name="compass_error_deg", unit="deg", is_optional=True),
)

PARAMETERS, EFFECTS = read_tables(__file__)
NOMINAL = NominalValues(PARAMETERS, EFFECTS)


class FourWheelDrive:
    """A `Model` of a four-wheel rover's odometry.

    Conditions: mean climb, roll and speed of a drive. Labels of a run that the model uses: `wheel_radius_m`,
    `track_m`; else 92 mm and 440 mm.
    """

    name = "four-wheel-drive"
    channels: tuple[Channel, ...] = CHANNELS
    condition_units: Mapping[str, str] = {"climb_deg": "deg", "roll_deg": "deg", "speed_m_s": "m/s"}
    input_units: Mapping[str, str] = {
        "t_s": "s",
        **{f"wheel_{wheel}_rad_s": "rad/s" for wheel in WHEELS},
        "pitch_rad": "rad",
        "roll_rad": "rad",
        "heading_rad": "rad",
        "true_turn_rad_s": "rad/s",
    }
    parameters = PARAMETERS
    effects: tuple[EffectCard, ...] = EFFECTS

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict the motion of every run and the readings of its sensors. See `Model.predict`."""
        base, active = NOMINAL.fill(parameters, effects)
        return [_motion(run, base, active) | _sensors(run, base, active) for run in runs]


def _motion(run: Run, base: Values, active: Mapping[str, Values]) -> dict[str, Array]:
    radius_m = run.conditions.get("wheel_radius_m", RADIUS_M)
    radius_m *= 1.0 + base["radius_error"] + active["wheel_radius"]["error"]
    left_side, right_side = _sides(run, active)
    right_side = right_side * (1.0 + base["side_error"])
    rim = radius_m * 0.5 * (left_side + right_side)
    track_m = run.conditions.get("track_m", TRACK_M)
    track_m *= 1.0 + base["track_error"] + active["base_radius"]["error"]
    turn = radius_m * (right_side - left_side) / track_m
    climb = run.inputs["pitch_rad"] - base["pitch_zero_rad"]
    forward = rim * (1.0 - slip_on_soil(active["wheel_slip"], active["slope_slip"], climb, rim))
    drift = drift_angle(active["side_drift"], run.inputs["roll_rad"] - base["roll_zero_rad"])
    left = np.abs(forward) * np.tan(drift)
    # Wheels are logged late: the true motion is ahead of them.
    shift = active["latency"]["time"]
    return {
        "forward_m_s": later(run.inputs["t_s"], forward, shift),
        "left_m_s": later(run.inputs["t_s"], left, shift),
        "turn_rad_s": later(run.inputs["t_s"], turn, shift),
    }


def _sides(run: Run, active: Mapping[str, Values]) -> tuple[Array, Array]:
    """Return the mean speed of the left and of the right wheels."""
    lost = active["encoder_dropouts"]
    speeds = [true_wheel_speed(lost, wheel, run.inputs[f"wheel_{wheel}_rad_s"]) for wheel in WHEELS]
    return 0.5 * (speeds[0] + speeds[2]), 0.5 * (speeds[1] + speeds[3])


def _sensors(run: Run, base: Values, active: Mapping[str, Values]) -> dict[str, Array]:
    t_s, heading = run.inputs["t_s"], run.inputs["heading_rad"]
    turn = np.degrees(run.inputs["true_turn_rad_s"])
    shown = lagging_heading(active["compass_lag"], t_s, heading)
    # Over five windows, errors of the true heading at their edges differ from those of the compass.
    steady_turn = uniform_filter1d(turn, TURN_WINDOWS, mode="nearest")
    error = np.degrees(shown - heading) + base["compass_offset_deg"] + active["compass_offset"]["angle"]
    error = error - base["compass_age_s"] * steady_turn
    error = error + iron_deg(active["hard_iron"], shown, 1.0)
    error = error + iron_deg(active["soft_iron"], shown, 2.0)
    bias = base["gyro_bias_deg_s"] + active["gyro_bias"]["rate"]
    return {
        "gyro_deg_s": turn + active["gyro_scale"]["error"] * steady_turn + bias,
        "compass_error_deg": error,
    }


def make_model() -> FourWheelDrive:
    """Return the model with its effects."""
    return FourWheelDrive()
