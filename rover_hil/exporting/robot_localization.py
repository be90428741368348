"""Write what a log and its configuration know as parameters of robot_localization's `ekf_node`.

Names and meanings: docs/how-to/feed_robot_localization.md. `Ekf::predict` multiplies the process noise by the
time of the step: it is a variance per second. That filter takes the errors of successive velocities as
independent, and slip or a gyro's bias are not. So it must not average them: it would lag behind, and be too
sure of the velocity. The process noise of the velocity gives each message the weight `MESSAGE_WEIGHT`.
That of the pose is the least rate at which its variance, with what the covariance of the velocity adds, is
nowhere in the second half of the drive below that of the pose of `/odom`. The first half would count what
does not grow.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from drivers.clock import date_of
from drivers.errors import LogError
from drivers.inertial_settings import InertialSettings
from rover_hil.config import Config
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.odometry_record import REST_M_S, REST_RAD_S, OdometryRecorder
from rover_hil.connect.ros2.mapping import NOT_MEASURED
from rover_hil.drives.arrays import Array
from rover_hil.exporting.wheel_controller import LISTED, wheel_controller
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import ESTIMATE, ESTIMATE_SHAPE, EstimateRecord

STATES = (
    *("x", "y", "z", "roll", "pitch", "yaw"),
    *("vx", "vy", "vz", "vroll", "vpitch", "vyaw"),
    *("ax", "ay", "az"),
)
"""In the order of robot_localization."""
FUSED = ("vx", "vy", "vyaw")
NOTHING = 1e-9
"""Variance of what is known or not estimated: that with which robot_localization starts."""
MESSAGE_WEIGHT = 0.9
"""Of a message in the velocity: a tenth of a change is left for the next message."""
WEIGHING = MESSAGE_WEIGHT**2 / (1.0 - MESSAGE_WEIGHT)
"""Variance of the walk between two messages that gives them their weight, over the variance of a message.

The weight w of a measurement of variance R, every t seconds, of what walks at random with the variance Q in a
second: Q t / R = w^2 / (1 - w).
"""
NO_INTERVAL = "no interval is recorded"


class Entry(NamedTuple):
    """A variance, and where it comes from."""

    value: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Driven:
    """What a log shows of its drive, n messages of odometry.

    Attributes:
        duration_s: From the first to the last estimate.
        step_s: Time since the message before, (n,).
        way_m: Change of the position of `/odom` in it, x and y, (n, 2).
        length_m: Travel of the wheels in it, (n,).
        turned_rad: Their rotation in it, without sign, (n,).
        velocity: Forward, to the left and yaw, in m/s and rad/s, (n, 3).
        variance: Of the velocity, (n, 3).
        wheels_variance: The same by the wheels alone, without slip compensation and gyro, (n, 3).
        covariance: Of x, y and yaw of `/odom`, (n + 1, 3, 3).
    """

    duration_s: float
    step_s: Array
    way_m: Array
    length_m: Array
    turned_rad: Array
    velocity: Array
    variance: Array
    wheels_variance: Array
    covariance: Array

    @property
    def moves(self) -> NDArray[np.bool_]:
        """Whether the wheels turned, (n,)."""
        longest_s = np.maximum(self.length_m / REST_M_S, self.turned_rad / REST_RAD_S)
        moves: NDArray[np.bool_] = longest_s > self.step_s
        return moves

    @property
    def words(self) -> str:
        """How long it was."""
        return f"{self.duration_s:.0f} s, {self.length_m.sum():.2f} m, {self.turned_rad.sum():.2f} rad"


def robot_localization_text(log: LogReader, config: Config, on_message: Callable[[], None]) -> str:
    """Return a parameter file of `ekf_node`, and a commented one of the controller of the wheels.

    Nothing is fitted: each number is a setting, follows from settings by a stated formula, or is a mean over
    the drive. Its comment has source and interval.

    Args:
        log: The log of a drive with an estimate.
        config: Its configuration.
        on_message: Called after each message, to show progress.

    Raises:
        LogError: The log is damaged, has no estimate, or the rover did not move in it.
    """
    driven = _read(log, config, on_message)
    day = date_of(log.wall_offset_ns + log.start_ns).isoformat()
    ros2 = config.ros2 or Ros2Settings()
    lines = [
        f"# For ekf_node of robot_localization, from the log {log.path.name} of {day} ({driven.words}).",
        "# Settings are those of the configuration in the log. Nothing was fitted here.",
        "# The process noise is for drives of this length, speed and ground: longer ones need more.",
        f"# Ground: {config.ground.words}.",
        *_gyro_lines(config),
        "ekf_filter_node:",
        "  ros__parameters:",
        f"    frequency: {config.loop.rate_hz!s}  # Hz; setting loop.rate_hz",
        "    two_d_mode: true  # z, roll and pitch are not measured",
        f"    publish_tf: true  # needs ros2.publish_tf = false; in the log: {str(ros2.publish_tf).lower()}",
        # In quotes: ROS reads a bare on, no or nan as another type, and refuses it.
        f"    map_frame: '{ros2.map_frame}'  # setting ros2.map_frame",
        f"    odom_frame: '{ros2.odom_frame}'  # setting ros2.odom_frame",
        f"    base_link_frame: '{ros2.base_frame}'  # setting ros2.base_frame",
        f"    world_frame: '{ros2.odom_frame}'",
        f"    odom0: '/{'/'.join(filter(None, (ros2.namespace, 'odom')))}'",
        "    # The velocities: the pose of /odom is their sum, its errors are alike from message to message.",
        "    # vy too: without rollers or steering it is 0, with the variance of a slip to the side.",
        f"    odom0_config: [{', '.join(str(state in FUSED).lower() for state in STATES)}]",
        "    odom0_differential: false",
        "    odom0_relative: false",
        *_matrix("process_noise_covariance", "per second", _process_noise(driven)),
        *_matrix("initial_estimate_covariance", "at the start", _initial(driven)),
        "",
        *(f"#{line}" for line in _controller_lines(driven, config)),
    ]
    return "\n".join(lines) + "\n"


def _read(log: LogReader, config: Config, on_message: Callable[[], None]) -> Driven:
    odom, wheels = (OdometryRecorder(config.filter, config.ground) for _ in range(2))
    rows: list[tuple[float, ...]] = []
    for message in log.stored_messages():
        if message.topic == ESTIMATE:
            cycle = log.parse(message, ESTIMATE_SHAPE)
            record = odom.record(0, cycle)
            by_wheels = wheels.record(0, _by_wheels(cycle))
            if record is not None and by_wheels is not None:
                velocity = (record["velocity_x_m_s"], record["velocity_y_m_s"], record["yaw_rate_rad_s"])
                pose = cycle["odometry"]
                place = (record["time_ns"] / 1e9, pose["x_m"], pose["y_m"], pose["yaw_rad"])
                way = (record["x_m"], record["y_m"])
                variances = (*record["velocity_variance"], *by_wheels["velocity_variance"])
                if math.isfinite(sum((*place, *way))):
                    rows.append((*place, *velocity, *variances, *record["covariance"], *way))
        on_message()
    table = np.array(rows).reshape(-1, 21)
    steps = np.diff(table[:, :4], axis=0)
    turned = np.abs((steps[:, 3] + np.pi) % (2.0 * np.pi) - np.pi)
    driven = Driven(
        duration_s=float(steps[:, 0].sum()),
        step_s=steps[:, 0],
        way_m=np.diff(table[:, 19:], axis=0),
        length_m=np.hypot(steps[:, 1], steps[:, 2]),
        turned_rad=turned,
        velocity=table[1:, 4:7],
        variance=table[1:, 7:10],
        wheels_variance=table[1:, 10:13],
        covariance=table[:, (13, 14, 15, 14, 16, 17, 15, 17, 18)].reshape(-1, 3, 3),
    )
    if not driven.moves[1:].any():
        raise LogError(
            f"log {log.path} has no estimate of a rover that moves, which the variances need: give the log "
            f"of a drive, or make the estimate with `rover-hil replay {log.path} --out FOLDER`"
        )
    return driven


def _by_wheels(cycle: EstimateRecord) -> EstimateRecord:
    """Return a cycle as if nothing but the wheels measured the motion."""
    pose = cycle["estimate"].copy()
    pose["yaw_source"] = YawSource.WHEELS
    bare = cycle.copy()
    bare["estimate"] = pose
    bare["slip"] = bare["drift"] = bare["ground"] = None
    return bare


def _gyro_lines(config: Config) -> Iterator[str]:
    name = config.roles.gyro
    if name is None:
        yield "# Yaw: by the wheels; roles.gyro names no gyro."
        return
    device = config.devices[name]
    constants = [
        f"devices.{name}.{key} = {getattr(device, key):g}"
        for key in ("gyro_scale", "gyro_bias_deg_s")
        if isinstance(device, InertialSettings)
        and getattr(device, key) != InertialSettings.model_fields[key].default
    ]
    response = None if config.slip is None else config.slip.gyro_response
    if response is not None:
        constants.append(f"delay identified on {response.identified_on}")
    yield f"# Yaw: by the gyro '{name}'; {', '.join(constants) or 'it is not calibrated'}."


def _setting(config: Config, key: str) -> str:
    """Return how a key of [filter] came to its value."""
    is_default = FilterSettings.model_fields[key].default == getattr(config.filter, key)
    return f"filter.{key} = {getattr(config.filter, key):g}{' (default)' if is_default else ''}"


def slip_variance_m2(distance_m: float, sd: float, correlation_m: float) -> float:
    """Return the variance of the position by a slip that is a Gauss-Markov process over the travel.

    That is its integral over the distance x (Gelb 1974, section 3.8): (sd x)^2 where x is short against the
    correlation distance D, 2 sd^2 D x where it is long.
    """
    ways = distance_m / correlation_m
    return 2.0 * (sd * correlation_m) ** 2 * (ways + math.expm1(-ways))


def _ground_words(config: Config) -> str:
    ground, prior = config.ground, config.ground.prior()
    learned = f", from {ground.source} {ground.learned_on}".rstrip() if ground.source else ""
    low, high = (100.0 * (prior.mean + sign * 1.96 * prior.sd) for sign in (-1.0, 1.0))
    return f"slip {ground.slip}, {low:.1f} to {high:.1f} % (95 %) over {prior.distance_m:g} m{learned}"


def _process_noise(driven: Driven) -> Mapping[str, Entry]:
    yaw = max(float(_unexplained(driven, 0.0)[:, 2, 2].max()), NOTHING)
    of_position = np.linalg.eigvalsh(_unexplained(driven, yaw)[:, :2, :2]).max(axis=0)
    narrowest, widest = (max(float(rate), NOTHING) for rate in of_position)
    grows = "with that of the velocity nowhere below the variance of /odom in the second half of the drive"
    place = Entry(widest, f"m2/s; {grows}; its most certain direction needs {narrowest:.2e}")
    turns = Entry(yaw, f"rad2/s; {grows}; {NO_INTERVAL}")
    return {"x": place, "y": place, "yaw": turns, **_velocity_noise(driven)}


def _unexplained(driven: Driven, yaw_rad2_s: float) -> Array:
    """Return what the covariance of `/odom` has grown by, and that of the filter has not, per second passed.

    The filter has no process noise of x and y here: it would add its own rate, and change nothing else.

    Args:
        driven: The drive.
        yaw_rad2_s: Process noise of the yaw.

    Returns:
        Of x, y and yaw at the messages of the second half, (m, 3, 3).
    """
    filtered, missing = np.diag(_first_variance(driven)), []
    for step_s, (x_m, y_m), variance, covariance in zip(
        driven.step_s, driven.way_m, driven.variance, driven.covariance[1:], strict=True
    ):
        moved = np.array([[1.0, 0.0, -y_m], [0.0, 1.0, x_m], [0.0, 0.0, 1.0]])
        # The variance is the same along the travel and across it: it need not be rotated.
        filtered = moved @ filtered @ moved.T + np.diag(variance) * step_s**2
        filtered[2, 2] += yaw_rad2_s * step_s
        missing.append(covariance - filtered)
    passed_s = np.cumsum(driven.step_s)
    late = 2.0 * passed_s >= driven.duration_s
    rates: Array = np.array(missing)[late] / passed_s[late, None, None]
    return rates


def _velocity_noise(driven: Driven) -> Mapping[str, Entry]:
    """Return the noise with which a message gets its weight in the long run."""
    wanted = WEIGHING * driven.variance / driven.step_s[:, None]
    changes = np.diff(driven.velocity, axis=0) ** 2 / driven.step_s[1:, None]
    entries = {}
    for place, state in enumerate(FUSED):
        unit = "rad2/s3" if state == "vyaw" else "m2/s3"
        low, middle, high = np.percentile(wanted[driven.moves, place], (5.0, 50.0, 95.0))
        changed = changes[driven.moves[1:], place].mean()
        source = (
            f"{unit}; gives a message the weight {MESSAGE_WEIGHT:g}; median of the drive, 5 to 95 %: "
            f"{low:.2e} to {high:.2e}; mean squared change of the velocity: {changed:.2e}"
        )
        entries[state] = Entry(float(middle), source)
    return entries


def _first_variance(driven: Driven) -> Array:
    """Return the variances of x, y and yaw at the start, x and y in their least certain direction."""
    first = driven.covariance[0]
    widest = np.linalg.eigvalsh(first[:2, :2])[1]
    return np.maximum((widest, widest, first[2, 2]), NOTHING)


def _mean(what: str, values: Array) -> Entry:
    low, high = np.percentile(values, (5.0, 95.0))
    return Entry(float(values.mean()), f"{what} in the drive, 5 to 95 %: {low:.2e} to {high:.2e}")


def _initial(driven: Driven) -> Mapping[str, Entry]:
    first = "variance of the first estimate in the log"
    speed = f"{first}; ekf_node replaces it by that of its first message"
    x, y, yaw = (Entry(float(value), first) for value in _first_variance(driven))
    speeds = (Entry(float(value), speed) for value in driven.variance[0])
    return {"x": x, "y": y, "yaw": yaw, **dict(zip(FUSED, speeds, strict=True))}


def _matrix(name: str, when: str, entries: Mapping[str, Entry]) -> Iterator[str]:
    yield f"    # Variances {when}; {NOTHING:g}: not estimated on a plane."
    yield f"    {name}: ["
    for row, state in enumerate(STATES):
        entry = entries.get(state)
        if entry is not None:
            yield f"      # {state}: {entry.source}"
        value = NOTHING if entry is None else entry.value
        cells = [_number(value) if column == row else "0.0" for column in range(len(STATES))]
        yield f"      {', '.join(cells)}{',' if row + 1 < len(STATES) else ''}"
    yield "    ]"


def _number(value: float) -> str:
    """Return a float that YAML 1.1 and ROS read as one: with a point, and a sign in the exponent."""
    return f"{value:.4e}"


def _controller_lines(driven: Driven, config: Config) -> Iterator[str]:
    """Yield parameters of a controller that publishes odometry of the wheels alone."""
    controller = wheel_controller(config.rover)
    pose, twist = _wheel_pose(driven, config), _wheel_twist(driven)
    yield "# Odometry of the wheels alone, instead of /odom of rover-hil: remove the first # of each line."
    if controller.note:
        yield f"# {controller.note}"
    yield from _noise_of_wheels(controller.name, driven, pose, twist)
    yield f"{controller.name}:"
    yield "  ros__parameters:"
    if controller.name != LISTED:
        yield "    enable_odom_tf: false  # ekf_node sends this transform"
    for name, value, source in controller.parameters:
        yield f"    {name}: {value!r}  # {source}; {NO_INTERVAL}, `rover-hil calibrate wheels` finds one"
    shown: tuple[str, ...] = ()
    for names, entries in zip(controller.covariances, (pose, twist), strict=True):
        for depth, name in enumerate(names[:-1]):
            if shown[: depth + 1] != names[: depth + 1]:
                yield f"    {'  ' * depth}{name}:"
        shown, pad = names, "    " + "  " * (len(names) - 1)
        yield from (f"{pad}# {source}" for source in dict.fromkeys(entry.source for entry in entries))
        x, y, yaw = (_number(entry.value) for entry in entries)
        unmeasured = ", ".join([_number(NOT_MEASURED)] * 3)
        yield f"{pad}{names[-1]}: [{x}, {y}, {unmeasured}, {yaw}]"


def _noise_of_wheels(
    name: str, driven: Driven, pose: Sequence[Entry], twist: Sequence[Entry]
) -> Iterator[str]:
    """Yield what the first part needs with this odometry: that of /odom has a gyro and slip compensation."""
    topic = "the topic of your publisher" if name == LISTED else f"'/{name}/odom'"
    place, _, yaw = (_number(each.value / driven.duration_s) for each in pose)
    step_s = float(driven.step_s[driven.moves].mean())
    speed, _, turn = (_number(WEIGHING * each.value / step_s) for each in twist)
    yield f"# In the first part set odom0: {topic}, and process_noise_covariance to"
    yield f"# x and y {place}, yaw {yaw}, vx and vy {speed}, vyaw {turn}:"
    yield "# the covariances below, per second of this drive, and so that a message has the weight as above."


def _wheel_twist(driven: Driven) -> Sequence[Entry]:
    variances = driven.wheels_variance[driven.moves].T
    what = "mean variance by [filter] and [ground], without slip compensation and gyro,"
    return [
        _mean(f"{name}: {what}", values)
        for name, values in zip(("vx, m2/s2", "vy, m2/s2", "vyaw, rad2/s2"), variances, strict=True)
    ]


def _wheel_pose(driven: Driven, config: Config) -> Sequence[Entry]:
    """Return the variances of x, y and yaw at the end of the drive by the wheels alone."""
    noise, prior = config.filter, config.ground.prior()
    distance_m, turned_rad = float(driven.length_m.sum()), float(driven.turned_rad.sum())
    yaw_rad2 = (
        noise.wheel_yaw_noise_rad_sqrt_rad**2 * turned_rad + noise.wheel_yaw_noise_rad_sqrt_m**2 * distance_m
    )
    place_m2 = (
        slip_variance_m2(distance_m, prior.sd, prior.distance_m)
        + slip_variance_m2(distance_m, prior.local_sd, noise.slip_distance_m)
        + noise.unsure_position_noise_m_sqrt_m**2 * distance_m
        + yaw_rad2 * (0.5 * distance_m) ** 2
    )
    place = Entry(
        place_m2,
        f"x, y, m2: at the end of this drive, 0 at its start: do not fuse it; {_ground_words(config)}; "
        f"{_setting(config, 'unsure_position_noise_m_sqrt_m')}",
    )
    keys = ("wheel_yaw_noise_rad_sqrt_rad", "wheel_yaw_noise_rad_sqrt_m")
    settings = ", ".join(_setting(config, key) for key in keys)
    return place, place, Entry(yaw_rad2, f"yaw, rad2: likewise; {settings}; {NO_INTERVAL}")
