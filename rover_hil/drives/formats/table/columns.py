"""Which column of a table holds what: the TOML file of `import table`."""

import math
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from controllers.motion.rover_geometry import RoverSettings
from controllers.motion.settings import LimitSettings
from drivers.settings import PathText, Settings, read_toml
from drivers.units import STANDARD_GRAVITY_M_S2
from rover_hil.config import Config, load_config, validated
from rover_hil.drives.files.csv_layout import MOST_HEADER_LINES
from rover_hil.drives.formats.fixes import FixNoise, MarkerPlace
from rover_hil.drives.presets import columns_file, presets

TURN_RAD = 2.0 * math.pi
ASSUMED_ROVER = {
    "kinematics": "wheels",
    "wheels": [{"x_m": 0.0, "y_m": y_m, "radius_m": 0.1} for y_m in (0.2, -0.2)],
}
ASSUMED_LIMITS = {"wheel_speed_rad_s": 100, "wheel_acceleration_rad_s2": 500}
"""Of a rover whose motion is measured, not its wheels: angles of wheels only carry it."""
ASSUMED_TEXT = "{ x_m = 0.0, y_m = 0.2, radius_m = 0.1 }, { x_m = 0.0, y_m = -0.2, radius_m = 0.1 }"
ColumnName = Annotated[str, Field(min_length=1, max_length=255)] | Annotated[int, Field(ge=1, le=10_000)]
"""Name in the header, or number from 1."""
Positive = Annotated[float, Field(gt=0)]
SI_PER_UNIT = {
    "ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "days": 86400.0,
    "rad": 1.0, "deg": math.pi / 180.0, "rev": TURN_RAD,
    "rad/s": 1.0, "deg/s": math.pi / 180.0, "rev/s": TURN_RAD, "rpm": TURN_RAD / 60.0,
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1.0 / 3.6,
    "m/s2": 1.0, "g": STANDARD_GRAVITY_M_S2, "A": 1.0, "mA": 1e-3,
}  # fmt: skip
"""Size of each unit in SI units; ticks have none of their own."""
LENGTHS = frozenset({"m", "cm", "mm", "m/s", "cm/s", "mm/s", "km/h"})
"""Units at the rim of a wheel: its radius makes angles of them."""


class Column(Settings):
    """One column.

    Attributes:
        column: Its name, or its number from 1.
        sign: -1 where the column counts the other way round.
    """

    column: ColumnName
    sign: Literal[1, -1] = 1


class TimeColumn(Column):
    """Time; only its differences matter.

    Attributes:
        unit: Of numbers; dates and times of day are in s.
    """

    unit: Literal["s", "ms", "us", "ns", "min", "days"] = "s"


class AngleColumn(Column):
    """An angle: steering, heading or yaw, counter-clockwise.

    Attributes:
        ticks_per_turn: Size of the unit "ticks".
        zero: Its value straight ahead, in its unit.
    """

    unit: Literal["rad", "deg", "rev", "ticks"] = "rad"
    ticks_per_turn: Positive | None = None
    zero: float = 0.0

    @model_validator(mode="after")
    def _check_ticks(self) -> Self:
        _check_ticks(self.unit, self.ticks_per_turn)
        return self


class SteeringColumn(AngleColumn):
    """The steering angle of a wheel, or what turns it.

    Attributes:
        ratio: By how much it turns per turn of the wheel, e.g. 15 for the steering wheel of a car.
        wrap: The column starts again after this much, in its unit, e.g. 360 deg. In the first row it is
            within half of that from `zero`.
    """

    ratio: Positive = 1.0
    wrap: Positive | None = None


class TurnColumn(Column):
    """How far a wheel has turned, or turns from row to row.

    Attributes:
        unit: Lengths are at the rim of the wheel.
        ticks_per_turn: Size of the unit "ticks": of the encoder, per turn of its own shaft.
        gear_ratio: Turns of the encoder per turn of the wheel.
        wrap: The column starts again after this much, in its unit, e.g. 65536 ticks.
    """

    unit: Literal["rad", "deg", "rev", "ticks", "m", "cm", "mm"]
    ticks_per_turn: Positive | None = None
    gear_ratio: Positive = 1.0
    wrap: Positive | None = None

    @model_validator(mode="after")
    def _check_ticks(self) -> Self:
        _check_ticks(self.unit, self.ticks_per_turn)
        return self


class BodySpeedColumn(Column):
    """A speed of the rover."""

    unit: Literal["m/s", "cm/s", "mm/s", "km/h"] = "m/s"


class SpeedColumn(Column):
    """The speed of a wheel; lengths are at its rim, all others at the motor, before the gear."""

    unit: Literal["rad/s", "deg/s", "rev/s", "rpm", "m/s", "cm/s", "mm/s", "km/h"]
    gear_ratio: Positive = 1.0


class CurrentColumn(Column):
    """The current of a motor."""

    unit: Literal["A", "mA"] = "A"


class LengthColumn(Column):
    """A length."""

    unit: Literal["m", "cm", "mm"] = "m"


class RateColumn(Column):
    """An angular rate."""

    unit: Literal["rad/s", "deg/s"] = "rad/s"


class AccelerationColumn(Column):
    """An acceleration."""

    unit: Literal["m/s2", "g"] = "m/s2"


class WheelColumns(Settings):
    """One wheel. It has a position, a step or a speed, unless [rover] says measured = false.

    Attributes:
        position: How far it has turned since the start.
        step: Instead of it: how far it has turned since the row before.
        speed: Used where there is neither of them.
        current: Of its motor.
        steering: Its measured steering angle.
    """

    position: TurnColumn | None = None
    step: TurnColumn | None = None
    speed: SpeedColumn | None = None
    current: CurrentColumn | None = None
    steering: SteeringColumn | None = None

    @model_validator(mode="after")
    def _check_motion(self) -> Self:
        if self.position is not None and self.step is not None:
            raise ValueError("give position or step, not both")
        if self.step is not None and self.step.wrap is not None:
            raise ValueError("a step does not wrap: remove wrap")
        return self


class IncrementColumns(Settings):
    """Motion of the rover since the row before, as odometry gives it.

    Attributes:
        distance: Ahead.
        turn: Counter-clockwise, in rad or deg.
        turn_by_gyro: Whether the turn is that of a gyro: where the distance shows a rest it is its bias.
    """

    distance: LengthColumn
    turn: AngleColumn
    turn_by_gyro: bool = False


class BodyColumns(Settings):
    """Speed and yaw rate of the rover, as a controller or a radar gives them.

    Attributes:
        speed: Ahead.
        speed_y: To the left; default: 0.
        yaw_rate: Counter-clockwise.
    """

    speed: BodySpeedColumn
    speed_y: BodySpeedColumn | None = None
    yaw_rate: RateColumn


class SteeredWheelColumns(Settings):
    """One driven and steered wheel of a tricycle, whose other wheels have no encoder.

    Attributes:
        wheelbase_m: From the axle of the other wheels to this one; negative where it is behind them.
        radius_m: Radius of the wheel.
        step: How far it has turned since the row before.
        steering: Its angle; or
        steering_step: how far it was steered since the row before, from straight ahead at the first row.
    """

    wheelbase_m: float
    radius_m: Positive
    step: TurnColumn
    steering: SteeringColumn | None = None
    steering_step: SteeringColumn | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.steering is None) == (self.steering_step is None):
            raise ValueError("give either steering or steering_step")
        if self.wheelbase_m == 0.0:
            raise ValueError("wheelbase_m is 0: give the distance between the axles")
        return self


class ImuColumns(Settings):
    """An inertial sensor, x ahead and z up.

    Attributes:
        yaw_rate: Counter-clockwise.
        heading: Yaw against the earth, counter-clockwise from east; of a compass, which counts clockwise from
            north, with sign = -1 and zero = 90 deg.
        heading_reference: What it is measured against.
        acceleration_x, acceleration_y, acceleration_z: Specific force; axes that are left out are those of
            standstill on level ground.
        file: Another table, beside the one of the drive and with the same clock, or that file once more;
            default: the rows of the drive.
        time: In that table; default: as for the drive.
    """

    file: PathText | None = None
    time: TimeColumn | None = None
    yaw_rate: RateColumn | None = None
    heading: AngleColumn | None = None
    heading_reference: Literal["magnetic", "true"] = "magnetic"
    acceleration_x: AccelerationColumn | None = None
    acceleration_y: AccelerationColumn | None = None
    acceleration_z: AccelerationColumn | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not any(isinstance(value, Column) for name, value in self if name != "time"):
            raise ValueError("it has no column: add yaw_rate, heading or an acceleration")
        if self.time is not None and self.file is None:
            raise ValueError("give file with time: the table that the time is in")
        return self


class DegreesColumn(Column):
    """A latitude or longitude on the ellipsoid WGS 84; north and east positive."""

    unit: Literal["deg", "1e-7 deg"] = "deg"


class PlaceColumns(Settings):
    """Places or poses in any fixed frame.

    Attributes:
        marker: What they are of; default: the origin of the rover.
        file: Another table, beside the one of the drive and with the same clock; default: the one of the
            drive.
        time: In that table; default: as for the drive.
        x, y: The place; or
        latitude, longitude: the place of a satellite receiver, from which x counts to the east and y to the
            north of its first row.
        yaw: Counter-clockwise from x.
    """

    marker: MarkerPlace = MarkerPlace()
    file: PathText | None = None
    time: TimeColumn | None = None
    x: LengthColumn | None = None
    y: LengthColumn | None = None
    latitude: DegreesColumn | None = None
    longitude: DegreesColumn | None = None
    yaw: AngleColumn | None = None

    @model_validator(mode="after")
    def _check_place(self) -> Self:
        places = (self.x, self.y), (self.latitude, self.longitude)
        given = [place for place in places if any(place)]
        if len(given) != 1 or not all(given[0]):
            raise ValueError("give x and y, or latitude and longitude")
        return self


class TruthColumns(PlaceColumns):
    """The ground truth, with or without yaw."""

    @model_validator(mode="after")
    def _check_marker(self) -> Self:
        if self.yaw is None and (self.marker.x_m, self.marker.y_m) != (0.0, 0.0):
            raise ValueError(
                "marker: without a yaw the place of the marker cannot be removed: name the column of the "
                "yaw, or delete x_m and y_m of the marker: the ground truth is then that of the marker"
            )
        return self


class FixColumns(PlaceColumns, FixNoise):
    """Poses or places that correct the estimate, as those of a satellite receiver.

    Attributes:
        sigma: Standard deviation of x and of y, instead of `sigma_m`.
    """

    sigma: LengthColumn | None = None


class Columns(Settings):
    """What of a table becomes a log.

    Attributes:
        rover: A configuration whose wheels and limits are those of the rover: a TOML file, beside this one or
            from the current folder, or a shipped one. Or the section [rover] itself. Without it, where the
            motion is not that of wheels, `ASSUMED_ROVER` stands for it.
        limits: With a section [rover]: how fast its wheels may turn.
        rate_hz: With a section [rover]: cycles of the estimate per second.
        delimiter: Between cells; default: the one of tab, semicolon, comma and spaces that makes numbers.
        header_lines: Lines above the numbers, the last holds the names, or the last but one, where the last
            holds units; default: all above the first row of numbers.
        time: Time of each row.
        wheel: In the rover's order.
        increments: Instead of the wheels.
        body: Instead of the wheels.
        tricycle: Instead of the wheels.
        imu: Inertial sensor.
        fixes: Poses or places that correct the estimate.
        truth: True pose.
    """

    rover: str | RoverSettings | None = None
    limits: LimitSettings | None = None
    rate_hz: Annotated[float, Field(ge=1, le=1000)] = 50.0
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    header_lines: Annotated[int, Field(ge=0, le=MOST_HEADER_LINES)] | None = None
    time: TimeColumn
    wheel: Annotated[tuple[WheelColumns, ...], Field(max_length=32)] = ()
    increments: IncrementColumns | None = None
    body: BodyColumns | None = None
    tricycle: SteeredWheelColumns | None = None
    imu: ImuColumns | None = None
    fixes: FixColumns | None = None
    truth: TruthColumns | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if sum(map(bool, (self.wheel, self.increments, self.body, self.tricycle))) != 1:
            raise ValueError(
                "give the motion once: [[wheel]] for each wheel, [increments], [body] or [tricycle]"
            )
        if self.increments is not None and self.increments.turn_by_gyro and self.imu is not None:
            raise ValueError("[imu] gives a gyro, and increments.turn_by_gyro another one: leave one out")
        if self.rover is None and self.wheel:
            raise ValueError(
                "[[wheel]] needs the rover: name its configuration (rover = 'my_rover.toml'), or add "
                f"rover = {{ kinematics = 'wheels', wheels = [{ASSUMED_TEXT}] }} with its own numbers, and "
                "limits = { wheel_speed_rad_s = 100, wheel_acceleration_rad_s2 = 500 }"
            )
        if (self.rover is None or isinstance(self.rover, str)) != (self.limits is None):
            raise ValueError("give [limits] with a section [rover], and only then")
        return self


def _check_ticks(unit: str, ticks_per_turn: float | None) -> None:
    if (unit == "ticks") != (ticks_per_turn is not None):
        raise ValueError('give ticks_per_turn if, and only if, the unit is "ticks"')


def read_columns(path: Path) -> Columns:
    """Return the content of a file of columns, or of a known data set by its name.

    Raises:
        ConfigError: It cannot be read, or holds mistakes; one line per mistake.
    """
    fix = f"correct the path, or name a known data set: {', '.join(presets())}"
    return validated(Columns, read_toml(columns_file(path), f"file of columns {path}", fix), str(path))


def rover_of(columns: Columns, path: Path) -> Config:
    """Return the configuration of the rover that a file of columns names or holds.

    Its devices are not those of the drive.

    Args:
        columns: Content of the file.
        path: Of the file.

    Raises:
        ConfigError: There is no such configuration, or it holds mistakes.
    """
    if isinstance(columns.rover, str):
        beside = path.parent / columns.rover
        return load_config(str(beside) if beside.is_file() else columns.rover)
    table = {
        "schema": "rover-hil-config/1",
        "loop": {"rate_hz": columns.rate_hz},
        "rover": ASSUMED_ROVER if columns.rover is None else columns.rover.model_dump(),
        "limits": ASSUMED_LIMITS if columns.limits is None else columns.limits.model_dump(),
        "roles": {"wheels": "wheels"},
        "devices": {"wheels": {"type": "can_wheels", "interface": "virtual", "channel": "table",
                               "mapping": "generic_wheel"}},
    }  # fmt: skip
    return validated(Config, table, str(path))


def turn_unit(column: TurnColumn, radius_m: float) -> float:
    """Return the size of the unit of a column in rad of the wheel."""
    if column.ticks_per_turn is not None:
        return TURN_RAD / (column.ticks_per_turn * column.gear_ratio)
    return SI_PER_UNIT[column.unit] / (radius_m if column.unit in LENGTHS else column.gear_ratio)


def angle_unit(column: AngleColumn) -> float:
    """Return the size of the unit of a column in rad."""
    return SI_PER_UNIT[column.unit] if column.ticks_per_turn is None else TURN_RAD / column.ticks_per_turn
