"""Estimates a pose from samples of one's own, with the public names of `drivers` and `controllers` alone."""

from controllers import (
    ControlLoop,
    ControlSettings,
    DeviceRoles,
    LimitSettings,
    OmniRoverSettings,
    make_kinematics,
)
from drivers import WheelSample, nanoseconds

PERIOD_S = 0.02
rover = OmniRoverSettings(kinematics="omni3", wheel_radius_m=0.040, base_radius_m=0.125)
limits = LimitSettings(wheel_speed_rad_s=20.0, wheel_acceleration_rad_s2=40.0)
loop = ControlLoop(
    ControlSettings(rover=rover, limits=limits),
    DeviceRoles(wheels="board", required={"board": 0.15}),
)
speeds_rad_s = make_kinematics(rover).wheel_speeds(0.2, 0.0, 0.0)  # 0.2 m/s forward
for cycle in range(251):
    now_ns = nanoseconds(1.0 + cycle * PERIOD_S)
    positions = [
        WheelSample(device="board", t_ns=now_ns, wheel=wheel, position_rad=speed * cycle * PERIOD_S)
        for wheel, speed in enumerate(speeds_rad_s)
    ]
    output = loop.step(now_ns, positions)
estimate = output.estimate
print(f"x {estimate.x_m:.3f} m, y {estimate.y_m:.3f} m, yaw {estimate.yaw_rad:.3f} rad, {output.mode}")
