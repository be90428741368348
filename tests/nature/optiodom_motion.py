"""Recordings of the three OptiOdom robots on straight lines, circles, squares and on the spot: ground truth.

    python -m tests.nature.optiodom_motion FOLDER --robot diff --kind square --runs 6 --lost 0.05 --seed 1

The files are those of the published data sets. The robot drives by its nominal numbers; the motion follows
from the true ones. Scrub of castors and rollers takes a share of each rotation, more of narrow ones:
`lost` on the spot, lost x^2 / (1 + x^2) where the wheels of the body's edge roll by x of what the body does.
Straight lines lose nothing, so that one set of numbers does not fit all kinds of motion. It knows nothing
of any estimator.
"""

import argparse
import gzip
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S = 0.01
LAG_S = 0.15
PAUSE_S = 3.0
SPEED_M_S, RATE_RAD_S = 0.15, 0.4
STRAIGHT_M, SIDE_M, CIRCLE_M = 2.0, 1.0, 0.7
STEERING_STEP_RAD = math.pi / 400.0
OMNI_RAD = np.radians((-60.0, 60.0, 180.0))
KINDS = ("straight", "circle", "spot", "square")
RAW_CLOCK_S = 3673.4
STANDS_M_S = 1e-4


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """Numbers of a robot: radii of its wheels, size (track, arm or wheelbase), zero of the steering.

    With a steering zero of z the wheel stands at the reading plus z.
    """

    radii_m: tuple[float, ...]
    size_m: float
    steering_zero_rad: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What is published of a robot.

    Attributes:
        ticks_per_turn: Of a wheel; negative where the readings have the opposite sign.
        row_s: Time between two rows.
        edge_m: Half of the width of the wheels, for the scrub.
        raw: From the readings of a row to those in the robot's own file.
    """

    nominal: Geometry
    ticks_per_turn: float
    row_s: float
    edge_m: float
    metadata: tuple[tuple[str, ...], ...]
    raw: Callable[[Array], Array] = field(default=lambda readings: readings)


ROBOTS = {
    "diff": Kind(
        nominal=Geometry(radii_m=(0.042, 0.042), size_m=0.2),
        ticks_per_turn=64 * 43.7,
        row_s=0.05,
        edge_m=0.1,
        metadata=(("ngear", "43.7"), ("encRes", "64"), ("Li", "0.2"), ("Di", "0.084", "0.084")),
        raw=lambda readings: readings[:, ::-1],
    ),
    "omni3": Kind(
        nominal=Geometry(radii_m=(0.051, 0.051, 0.051), size_m=0.195),
        ticks_per_turn=-12 * 1024,
        row_s=0.04,
        edge_m=0.195,
        metadata=(
            ("ngear", "12"),
            ("encRes", "1024"),
            ("Li", "0.195"),
            ("Di", "0.102", "0.102", "0.102"),
        ),
        raw=lambda readings: -readings,
    ),
    "tricyc": Kind(
        nominal=Geometry(radii_m=(0.0325,), size_m=0.15),
        ticks_per_turn=1600,
        row_s=0.05,
        edge_m=0.1,
        metadata=(("ngear", "1"), ("encRes", "1600"), ("Li", "0.15"), ("Di", "0.065")),
    ),
}


@dataclass(frozen=True, kw_only=True)
class TrueRobot:
    """A robot as it is.

    Attributes:
        marker: Place and yaw of the marker on the robot: x, y in m, yaw in rad.
        lost: Share of a rotation on the spot that scrub takes.
        wheel_noise_m_sqrt_m: Standard deviation of what each wheel rolls wrongly in one metre.
        position_noise_m: Noise of the position of the ground truth.
        yaw_noise_rad: Noise of its yaw.
    """

    name: str
    geometry: Geometry
    marker: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lost: float = 0.0
    wheel_noise_m_sqrt_m: float = 0.0005
    position_noise_m: float = 0.00045
    yaw_noise_rad: float = 0.004

    @property
    def kind(self) -> Kind:
        """Return what is published of it."""
        return ROBOTS[self.name]


@dataclass(frozen=True)
class Recording:
    """Rows of a recording: times; x, y, yaw of the marker; readings of the wheels; pose of the robot."""

    t_s: Array
    marker: Array
    readings: Array
    pose: Array


Command = tuple[float, float, float, float]
"""Seconds, speed forward and to the left in m/s, yaw rate in rad/s; all zero: the robot stands."""


def commands(kind: str, *, is_left: bool, direction: float = 0.0) -> list[Command]:
    """Return the commands of a kind of motion; the course is in a direction of the body (omni3), in rad."""
    side = 1.0 if is_left else -1.0
    pause = (PAUSE_S, 0.0, 0.0, 0.0)
    x, y = SPEED_M_S * math.cos(direction), SPEED_M_S * math.sin(direction)
    line = (STRAIGHT_M / SPEED_M_S, x, y, 0.0)
    if kind == "straight":
        return [pause, line, pause, (line[0], -x, -y, 0.0), pause, line, pause]
    if kind == "circle":
        rate = side * SPEED_M_S / CIRCLE_M
        return [pause, (2.0 * math.tau / abs(rate), x, y, rate), pause]
    if kind == "spot":
        return [pause, (3.0 * math.tau / RATE_RAD_S, 0.0, 0.0, side * RATE_RAD_S), pause]
    corner = (0.5 * math.pi / RATE_RAD_S, 0.0, 0.0, side * RATE_RAD_S)
    return [pause, *((SIDE_M / SPEED_M_S, x, y, 0.0), pause, corner, pause) * 8]


def wheels_for(name: str, geometry: Geometry, command: Sequence[float]) -> Array:
    """Return rim speeds for a velocity of the body; of the tricycle rim speed and steering reading."""
    forward, left, rate = command
    if name == "diff":
        half = 0.5 * geometry.size_m * rate
        return np.array((forward + half, forward - half))
    if name == "omni3":
        return -np.sin(OMNI_RAD) * forward + np.cos(OMNI_RAD) * left + geometry.size_m * rate
    across = geometry.size_m * rate
    if forward == 0.0:
        return np.array((abs(across), math.copysign(0.5 * math.pi, across)))
    return np.array((math.copysign(math.hypot(forward, across), forward), math.atan(across / forward)))


def body_of(name: str, geometry: Geometry, wheels: Array) -> Array:
    """Return the velocity of the body for rim speeds: forward, left, yaw rate; tricycle as before."""
    if name == "diff":
        right, left = wheels.tolist()
        return np.array((0.5 * (right + left), 0.0, (right - left) / geometry.size_m))
    if name == "omni3":
        # The mean of three rims 120 degrees apart is the rotation; their first harmonics are the rest.
        return np.array(
            (
                -2.0 / 3.0 * float(np.sin(OMNI_RAD) @ wheels),
                2.0 / 3.0 * float(np.cos(OMNI_RAD) @ wheels),
                float(wheels.mean()) / geometry.size_m,
            )
        )
    rim, steering = wheels[0], wheels[1] + geometry.steering_zero_rad
    return np.array((rim * math.cos(steering), 0.0, rim * math.sin(steering) / geometry.size_m))


def lost_share(robot: TrueRobot, twist: Array) -> float:
    """Return the share of the rotation that scrub takes."""
    edge, speed = abs(twist[2]) * robot.kind.edge_m, math.hypot(twist[0], twist[1])
    return robot.lost * edge**2 / (edge**2 + speed**2) if edge else 0.0


def arc(pose: Array, twist: Array, seconds: float) -> Array:
    """Return the pose after a constant velocity of the body."""
    forward, left, angle = twist * seconds
    shorter = math.sin(0.5 * angle) / (0.5 * angle) if abs(angle) > 1e-12 else 1.0
    course = complex(math.cos(pose[2] + 0.5 * angle), math.sin(pose[2] + 0.5 * angle))
    step = shorter * course * complex(forward, left)
    moved: Array = pose + np.array((step.real, step.imag, angle))
    return moved


def record(robot: TrueRobot, driven: Iterable[Command], rng: np.random.Generator) -> Recording:
    """Return the recording of commands, from a random pose."""
    kind, geometry = robot.kind, robot.geometry
    count = len(geometry.radii_m)
    ratios = np.array(geometry.radii_m) / kind.nominal.radii_m
    pose = np.array((*rng.uniform(-1.0, 1.0, 2), rng.uniform(-math.pi, math.pi)))
    wheels, rolled = np.zeros(count + (robot.name == "tricyc")), np.zeros(count)
    poses, angles, steering = [], [], []
    steps = [command for command in driven for _ in range(round(command[0] / STEP_S))]
    for number, command in enumerate(steps):
        if number % round(kind.row_s / STEP_S) == 0:
            poses.append(pose)
            angles.append(rolled / kind.nominal.radii_m)
            steering.append(wheels[count:])
        wanted = wheels_for(robot.name, kind.nominal, command[1:])
        if not any(command[1:]):
            wanted[count:] = _steering_at_rest(robot, wheels, steps[number:])
        wheels = wheels + STEP_S / LAG_S * (wanted - wheels)
        # A wheel of another radius rolls another way for the same reading.
        true = wheels.copy()
        true[:count] *= ratios
        noise = robot.wheel_noise_m_sqrt_m * np.sqrt(np.abs(true[:count]) / STEP_S)
        true[:count] += noise * rng.standard_normal(count)
        twist = body_of(robot.name, geometry, true)
        twist[2] *= 1.0 - lost_share(robot, twist)
        pose = arc(pose, twist, STEP_S)
        rolled = rolled + STEP_S * wheels[:count]
    return _measured(robot, np.array(poses), np.array(angles), np.array(steering), rng)


def _steering_at_rest(robot: TrueRobot, wheels: Array, ahead: Sequence[Command]) -> Array:
    """Return where the steering goes while the robot is to stand: once it does, to the next command."""
    count = len(robot.geometry.radii_m)
    following = next((command for command in ahead if any(command[1:])), None)
    if following is None or float(np.abs(wheels[:count]).max()) > STANDS_M_S:
        return wheels[count:]
    return wheels_for(robot.name, robot.kind.nominal, following[1:])[count:]


def _measured(
    robot: TrueRobot, poses: Array, angles: Array, steering: Array, rng: np.random.Generator
) -> Recording:
    kind, (x, y, yaw) = robot.kind, robot.marker
    counts = np.round(angles * kind.ticks_per_turn / math.tau)
    readings = np.diff(counts, axis=0, prepend=counts[:1])
    steered = STEERING_STEP_RAD * np.round(steering / STEERING_STEP_RAD)
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    marker = poses + np.column_stack((cos * x - sin * y, sin * x + cos * y, np.full(len(poses), yaw)))
    noise = np.array((robot.position_noise_m, robot.position_noise_m, robot.yaw_noise_rad))
    seen: Array = marker + noise * rng.standard_normal(marker.shape)
    seen[:, 2] = (seen[:, 2] + math.pi) % math.tau - math.pi
    t_s = kind.row_s * np.arange(len(poses), dtype=np.float64)
    return Recording(t_s, seen, np.hstack((readings, steered)), poses)


def write(folder: Path, stamp: str, robot: TrueRobot, recordings: Sequence[Recording]) -> None:
    """Write recordings as the published data sets have them."""
    folder.mkdir(parents=True, exist_ok=True)
    kind = robot.kind
    ends = [f"{recording.t_s[-1]:g}" for recording in recordings]
    rows: list[tuple[str, ...]] = [
        ("type", robot.name),
        *kind.metadata,
        ("Thi",),
        ("N", str(len(recordings))),
        ("L",),
        *(
            ("gt_ti", *("0" for _ in ends)),
            ("gt_tf", *ends),
            ("odo_ti", *("0" for _ in ends)),
            ("odo_tf", *ends),
        ),
    ]
    width = max(len(row) for row in rows)
    text = "".join(",".join((*row, *[""] * (width - len(row)))) + "\n" for row in rows)
    (folder / f"{stamp}_metadata.csv.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    for number, recording in enumerate(recordings, start=1):
        name = f"{stamp}_run-{number:02}"
        whole = np.column_stack((recording.t_s, recording.marker, recording.readings))
        raw = np.column_stack((recording.t_s + RAW_CLOCK_S, kind.raw(recording.readings)))
        for suffix, table, begin in (("", whole, ""), ("_odo", raw, "\ufeff")):
            lines = "".join(",".join(f"{value:.15g}" for value in row) + "\n" for row in table)
            path = folder / f"{name}{suffix}.csv.gz"
            path.write_bytes(gzip.compress((begin + lines).encode(), mtime=0))


def draw(name: str, lost: float, rng: np.random.Generator) -> TrueRobot:
    """Return a robot whose numbers differ from the nominal ones as those of built robots do."""
    nominal = ROBOTS[name].nominal
    radii = tuple(float(radius * (1.0 + 0.01 * rng.standard_normal())) for radius in nominal.radii_m)
    size = float(nominal.size_m * (1.0 + 0.02 * rng.standard_normal()))
    zero = float(0.01 * rng.standard_normal()) if name == "tricyc" else 0.0
    x, y = rng.uniform(-0.05, 0.05, 2).tolist()
    return TrueRobot(
        name=name,
        geometry=Geometry(radii_m=radii, size_m=size, steering_zero_rad=zero),
        marker=(x, y, float(rng.uniform(-math.pi, math.pi))),
        lost=lost,
    )


def main() -> None:
    """Write recordings of one robot and their ground truth."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", choices=ROBOTS, required=True)
    parser.add_argument("--kind", choices=KINDS, action="append", help="default: all")
    parser.add_argument("--runs", type=int, default=6, help="recordings of each kind")
    parser.add_argument("--lost", type=float, default=0.0, help="share of a rotation on the spot")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng([options.seed, list(ROBOTS).index(options.robot)])
    robot = draw(options.robot, options.lost, rng)
    for kind in options.kind or KINDS:
        recordings = []
        for run in range(options.runs):
            direction = run // 2 * math.pi / 3.0 if robot.name == "omni3" else 0.0
            driven = commands(kind, is_left=run % 2 == 0, direction=direction)
            recordings.append(record(robot, driven, rng))
        write(
            options.folder / robot.name / kind / f"{options.seed:012}",
            f"{options.seed:012}",
            robot,
            recordings,
        )
    (options.folder / f"{robot.name}.json").write_text(json.dumps(asdict(robot), indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
