"""Where each part of the state of the pose filter is."""

from collections.abc import Sequence
from dataclasses import dataclass

from controllers.estimation.settings import FilterSettings
from drivers.samples import HeadingReference

X, Y, YAW, BIAS, FIRST_OFFSET = range(5)
_, _, _, SCALE, DIRECTION = range(5)
"""Index of scale and direction of the measured travel, after the pose at the newest frame."""
FRAME_STATES = 5
CERTAIN = 1e-12
UNKNOWN_ANGLE_RAD2 = 10.0
UNKNOWN_POSITION_M2 = 1e4
HARMONICS = 4
"""Of the deviation of a compass over the heading: sin, cos, sin 2, cos 2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StateLayout:
    """Indices of the states.

    [x, y, yaw, gyro bias, offsets, origins, frame, remaining slip, deviations, slip compensator].

    Attributes:
        offsets: Of the heading at a yaw of zero, by device and reference.
        origins: First index of the pose of the local frame on the floor of a device that gives fixes.
        frame: Pose at the newest frame of the camera, scale and direction of its travel; without a camera
            none of these states.
        first_slip: Pairs of slips: that of a place, or what compensation leaves; that of the ground, where
            nothing measures it; that while a camera measures it.
        slip_pairs: Number of pairs; the third one only with a camera.
        deviations: First harmonic of the deviation of a compass, by device and reference; empty without.
        block: States of the slip compensator.
        variances: At the start, shape (n,).
        angles: Which states are angles.
    """

    offsets: dict[tuple[str, HeadingReference], int]
    origins: dict[str, int]
    frame: int
    first_slip: int
    slip_pairs: int
    deviations: dict[tuple[str, HeadingReference], int]
    block: slice
    variances: tuple[float, ...]
    angles: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.variances)

    @property
    def assumed_slip(self) -> int:
        """Index of the slip of the ground, where nothing measures it."""
        return self.first_slip + 2

    @property
    def measured_slip(self) -> int:
        """Index of the slip while the motion over the ground is measured."""
        return self.first_slip + 4


def lay_out(
    settings: FilterSettings,
    heading_devices: Sequence[str],
    fix_devices: Sequence[str],
    *,
    has_ground: bool,
    block_variances: Sequence[float],
) -> StateLayout:
    """Return the indices of the states of a pose filter, and their variances at the start."""
    sources = [(device, reference) for device in heading_devices for reference in HeadingReference]
    first_origin = FIRST_OFFSET + len(sources)
    frame = first_origin + 3 * len(fix_devices)
    first_slip = frame + (FRAME_STATES if has_ground else 0)
    slip_pairs = 2 + has_ground
    first_deviation = first_slip + 2 * slip_pairs
    deviating = sources if settings.heading_deviation_rad > 0.0 else []
    first_state = first_deviation + HARMONICS * len(deviating)
    origins = {device: first_origin + 3 * i for i, device in enumerate(fix_devices)}
    offsets = {source: FIRST_OFFSET + i for i, source in enumerate(sources)}
    return StateLayout(
        offsets=offsets,
        origins=origins,
        frame=frame,
        first_slip=first_slip,
        slip_pairs=slip_pairs,
        deviations={source: first_deviation + HARMONICS * i for i, source in enumerate(deviating)},
        block=slice(first_state, first_state + len(block_variances)),
        variances=(
            *[CERTAIN] * BIAS,
            settings.gyro_bias_rad_s**2,
            *[UNKNOWN_ANGLE_RAD2] * len(sources),
            *[UNKNOWN_POSITION_M2, UNKNOWN_POSITION_M2, UNKNOWN_ANGLE_RAD2] * len(fix_devices),
            *[CERTAIN] * (FRAME_STATES if has_ground else 0),
            *[1.0] * (2 * slip_pairs),
            *[settings.heading_deviation_rad**2] * (HARMONICS * len(deviating)),
            *(max(float(variance), CERTAIN) for variance in block_variances),
        ),
        angles=(
            YAW,
            *offsets.values(),
            *(index + YAW for index in origins.values()),
            *([frame + YAW] if has_ground else []),
        ),
    )
