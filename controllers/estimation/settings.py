"""Noise of the pose filter, the section [filter]."""

from typing import Annotated

from pydantic import Field

from drivers.settings import Settings

PerAmpere = Annotated[float, Field(ge=-10.0, le=10.0)]


class MotorFields(Settings):
    """Field of each motor at a compass, by `rover-hil calibrate motors CONFIG`.

    Attributes:
        source: The log that they were found from.
        identified_on: Day, as 2026-01-31.
        device: The compass.
        per_ampere: Of each motor, ahead and to the left of the rover, over the earth's horizontal field.
        per_ampere_sd: Standard deviations.
    """

    source: str
    identified_on: str
    device: str
    per_ampere: Annotated[tuple[tuple[PerAmpere, PerAmpere], ...], Field(min_length=1, max_length=16)]
    per_ampere_sd: tuple[tuple[PerAmpere, PerAmpere], ...] = ()


class FilterSettings(Settings):
    """Noise of the pose filter. Variances grow with distance, angle and time, never per cycle.

    Attributes:
        position_noise_m_sqrt_m: Standard deviation of the position after one metre, from wheel slip.
        unsure_position_noise_m_sqrt_m: The same where the compensated slip is flagged as not valid.
        slip_sd: Standard deviation of the slip that compensation leaves, as a share of the travel. It changes
            slowly, so that its effect on the position grows with the distance. With [scomp] it is what the
            slip law leaves beside the uncertainty of its parameters. Slip that nothing measures: [ground].
        slip_sd_share: Share of the standard deviation that [slip] reports with its slip, in addition to
            `slip_sd`. Less than 1: only a part of the errors of successive half seconds has one sign.
        cross_slip_ratio: This slip across the travel, over that along it.
        slip_distance_m: The correlation of this slip falls to 37 % over this distance.
        wheel_yaw_noise_rad_sqrt_rad: Standard deviation of the wheels' yaw after turning by one radian.
        wheel_yaw_noise_rad_sqrt_m: Standard deviation of the wheels' yaw after driving one metre.
        gyro_noise_rad_sqrt_s: Standard deviation of the integrated gyro after one second (angle random walk).
        gyro_delay_sd_s: Standard deviation of the unknown delay of the gyro behind the wheels. While the
            rover turns the yaw is wrong by the turn in this time.
        gyro_rate_noise_rad_s: Standard deviation of one gyro reading.
        gyro_bias_rad_s: Standard deviation of the gyro's bias at the start.
        gyro_bias_walk_rad_s_sqrt_s: Standard deviation of the bias' change within one second.
        acceleration_noise_m_s2: Standard deviation of one reading of an accelerometer on each axis while the
            rover stands with its drives on. Readings that scatter more contradict a standstill of the wheels.
        heading_noise_rad: Standard deviation of one heading reading; larger where successive errors are
            correlated.
        heading_lag_s: Delay of the heading device behind the rover.
        heading_deviation_rad: Standard deviation of each harmonic (sin, cos, sin 2, cos 2) of a heading
            device's deviation over the heading. They are estimated while driving; 0 for none.
        motor_fields: Field of the motors at a compass by `rover-hil calibrate motors CONFIG`:
            path of the file. A heading for which a current is not known is then not used: the rover stops
            where the compass is required.
        standstill_s: Wheels that have not moved for this long mean that the rover is at standstill.
        gate_probability: Share of consistent innovations that pass the gate.
    """

    position_noise_m_sqrt_m: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.05
    unsure_position_noise_m_sqrt_m: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.2
    slip_sd: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    slip_sd_share: Annotated[float, Field(ge=0.0, le=2.0)] = 0.0
    cross_slip_ratio: Annotated[float, Field(ge=0.0, le=10.0)] = 1.0
    slip_distance_m: Annotated[float, Field(ge=0.01, le=100.0)] = 0.5
    wheel_yaw_noise_rad_sqrt_rad: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.1
    wheel_yaw_noise_rad_sqrt_m: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.05
    gyro_noise_rad_sqrt_s: Annotated[float, Field(ge=1e-6, le=0.1)] = 0.002
    gyro_delay_sd_s: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0
    gyro_rate_noise_rad_s: Annotated[float, Field(ge=1e-5, le=0.5)] = 0.01
    gyro_bias_rad_s: Annotated[float, Field(ge=1e-6, le=0.5)] = 0.02
    gyro_bias_walk_rad_s_sqrt_s: Annotated[float, Field(ge=1e-7, le=0.01)] = 1e-4
    acceleration_noise_m_s2: Annotated[float, Field(ge=1e-3, le=10.0)] = 0.1
    heading_noise_rad: Annotated[float, Field(ge=1e-3, le=0.8)] = 0.05
    heading_lag_s: Annotated[float, Field(ge=0, le=5.0)] = 0.0
    heading_deviation_rad: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    motor_fields: MotorFields | None = None
    standstill_s: Annotated[float, Field(ge=0.05, le=10.0)] = 0.3
    gate_probability: Annotated[float, Field(ge=0.5, lt=1.0)] = 0.9995
