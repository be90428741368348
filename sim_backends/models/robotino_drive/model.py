"""The odometry of a Robotino below an overhead camera, with the effects that may be missing in it.

Base: the wheels roll. Their mean speeds in windows of 0.2 s give, by inverse kinematics, the velocity that
the camera measures in the same windows. Pose and heading are not integrated, so that an error affects only
its own windows.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sim_backends.models.delay import earlier
from sim_backends.models.drive_effects import of_wheel, true_wheel_speed
from sim_backends.models.interface import Array, Channel, EffectCard, Run, Values
from sim_backends.models.nominal_values import NominalValues
from sim_backends.models.robotino_drive.effects import wheel_slip
from sim_backends.models.tables import read_tables

WHEELS = (1, 2, 3)
RADIUS_M = 0.04
BASE_M = 0.125
ANGLES_RAD = np.radians([60.0, 180.0, 300.0])
TO_BODY: Array = np.linalg.inv(
    np.stack([-np.sin(ANGLES_RAD), np.cos(ANGLES_RAD), np.full(3, BASE_M)], axis=1)
)
"""From the speeds of the three wheel rims to the velocity forward, to the left, and the turn."""
GYRO = "gyro_rad_s"
CHANNELS = (
    Channel(name="forward_m_s", unit="m/s"),
    Channel(name="left_m_s", unit="m/s"),
    Channel(name="turn_rad_s", unit="rad/s"),
    Channel(name=GYRO, unit="rad/s", is_optional=True),
)

PARAMETERS, EFFECTS = read_tables(__file__)
NOMINAL = NominalValues(PARAMETERS, EFFECTS)


class RobotinoDrive:
    """A `Model` of a Robotino's odometry.

    Conditions: direction of travel by the encoders, mean speed, and number of the surface from 1.
    Labels of a run that the model uses: `wheel_radius_m`, `base_radius_m`, `is_averaged` (no clock to be
    late by).
    """

    name = "robotino-drive"
    channels: tuple[Channel, ...] = CHANNELS
    condition_units: Mapping[str, str] = {"direction_deg": "deg", "speed_m_s": "m/s", "surface": "1"}
    input_units: Mapping[str, str] = {
        "t_s": "s",
        **{f"wheel_{wheel}_rad_s": "rad/s" for wheel in WHEELS},
        **{f"current_{wheel}_a": "A" for wheel in WHEELS},
        "image_x_m": "m",
        "image_y_m": "m",
    }
    parameters = PARAMETERS
    effects: tuple[EffectCard, ...] = EFFECTS

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict the velocity that the camera measures in every run. See `Model.predict`."""
        base, active = NOMINAL.fill(parameters, effects)
        return [_table(run, base, active) for run in runs]


def _table(run: Run, base: Values, active: Mapping[str, Values]) -> dict[str, Array]:
    speeds = _ground_speeds(run, base, active)
    base_m = run.conditions.get("base_radius_m", BASE_M) / BASE_M
    forward, left, turn = TO_BODY @ speeds
    turn = turn / base_m / (1.0 + base["base_error"] + active["base_radius"]["error"])
    turn = turn * (1.0 - active["turn_scrub"]["share"])
    t_s = run.inputs["t_s"]
    is_averaged = run.conditions.get("is_averaged", 0.0) > 0.5
    age_s = 0.0 if is_averaged else max(base["camera_age_s"] + active["latency"]["time"], 0.0)
    measured_forward, measured_left, measured_turn = (
        earlier(t_s, one, age_s) for one in (forward, left, turn)
    )
    scale_error = base["scale_error"] + active["camera_scale"]["error"]
    uneven = base["scale_slope_x"] * run.inputs["image_x_m"] + base["scale_slope_y"] * run.inputs["image_y_m"]
    scale = 1.0 / (1.0 + scale_error + uneven)
    yaw = base["marker_yaw_rad"] + active["marker_yaw"]["angle"]
    cosine, sine = scale * np.cos(yaw), scale * np.sin(yaw)
    return {
        "forward_m_s": cosine * measured_forward + sine * measured_left,
        "left_m_s": cosine * measured_left - sine * measured_forward,
        "turn_rad_s": measured_turn,
        GYRO: (1.0 + active["gyro_scale"]["error"]) * turn + active["gyro_bias"]["rate"],
    }


def _ground_speeds(run: Run, base: Values, active: Mapping[str, Values]) -> Array:
    """Return the speeds of the wheels over the ground: wheels x windows."""
    radius_m = run.conditions.get("wheel_radius_m", RADIUS_M)
    radius_m *= 1.0 + base["radius_error"] + active["wheel_radius"]["error"]
    base_errors = (base["wheel_1_error"], base["wheel_2_error"], 0.0)
    speeds = []
    for wheel, base_error in zip(WHEELS, base_errors, strict=True):
        turned = true_wheel_speed(active["encoder_dropouts"], wheel, run.inputs[f"wheel_{wheel}_rad_s"])
        current_a, surface = run.inputs[f"current_{wheel}_a"], run.conditions["surface"]
        slips = wheel_slip(active["wheel_slip"], current_a, base["idle_current_a"], surface)
        error = base_error + of_wheel(active["uneven_wheel"], wheel, "error")
        speeds.append(radius_m * (1.0 + error) * (1.0 - slips) * turned)
    return np.stack(speeds)


def make_model() -> RobotinoDrive:
    """Return the model with its effects."""
    return RobotinoDrive()
