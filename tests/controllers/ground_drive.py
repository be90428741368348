"""A simulated rover, its control loop, and a camera that sees the ground move."""

from dataclasses import dataclass, replace

import numpy as np

from controllers.control_loop import ControlLoop, StepOutput
from controllers.ground_motion.settings import GroundMotionSettings
from controllers.motion.settings import WaypointsMission
from controllers.roles import DeviceRoles
from rover_hil.config import load_config
from sim_backends.world.plant import Truth
from tests.controllers.simulated import (
    LONG_WAY,
    PERIOD_NS,
    SECOND_NS,
    Noise,
    SimulatedRover,
    make_settings,
    omni_rover,
)
from tests.nature.ground_camera import DEVICE, CameraErrors, GroundCamera

EXACT = CameraErrors(share_sd=0.0, scale_sd=0.0, drift_sd=0.0, burst_probability=0.0)
WITH_GYRO = DeviceRoles(wheels="wheels", gyro="gyro", required={"wheels": 0.15, "gyro": 0.15}, camera=DEVICE)
WITHOUT_GYRO = replace(WITH_GYRO, gyro=None, required={"wheels": 0.15})


class Mount:
    """A simulated rover as a camera sees it."""

    def __init__(self, rover: SimulatedRover) -> None:
        self.rover = rover

    def truth(self) -> Truth:
        rover = self.rover
        return Truth(
            t_ns=rover.t_ns,
            x_m=rover.place.real,
            y_m=rover.place.imag,
            yaw_rad=rover.yaw_rad,
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=0.0,
            velocity_y_m_s=0.0,
            yaw_rate_rad_s=0.0,
            wheel_position_rad=(),
            wheel_speed_rad_s=(),
            motor_current_a=(),
            slip=(),
            battery_v=0.0,
            bumper_pressed=False,
        )


@dataclass
class Drive:
    """A rover with a camera and its loop."""

    rover: SimulatedRover
    loop: ControlLoop
    camera: GroundCamera

    def run(self, duration_s: float) -> list[StepOutput]:
        outputs: list[StepOutput] = []
        for _ in range(round(duration_s * SECOND_NS / PERIOD_NS)):
            samples = self.rover.advance(self.rover.t_ns + PERIOD_NS)
            samples += self.camera.frames(self.rover.t_ns)
            outputs.append(self.loop.step(self.rover.t_ns, samples))
            self.rover.set_point_rad_s = np.array(outputs[-1].command.speed_rad_s)
        return outputs

    def loop_odometry_m(self) -> float:
        """Return the travel of the wheels so far."""
        return self.run(PERIOD_NS / SECOND_NS)[-1].odometry.x_m

    def error_m(self, output: StepOutput) -> float:
        """Return the distance of the estimate from the truth."""
        return abs(complex(output.estimate.x_m, output.estimate.y_m) - self.rover.place)


def start(
    errors: CameraErrors = EXACT,
    *,
    slip: float = 0.0,
    roles: DeviceRoles = WITH_GYRO,
    mission: WaypointsMission | None = LONG_WAY,
    camera: type[GroundCamera] = GroundCamera,
) -> Drive:
    rover = omni_rover(noise=Noise())
    rover.slip = slip
    rig = load_config("el-dorado").scomp
    assert rig is not None
    assert rig.rig is not None
    settings = make_settings(mission=mission).model_copy(
        update={"ground_motion": GroundMotionSettings(rig=rig.rig)}
    )
    meter = camera(Mount(rover), np.random.default_rng(0), errors)
    return Drive(rover, ControlLoop(settings, roles, meter=meter), meter)
