"""`rover-hil calibrate mounting` on logs of a sensor whose mounting, scale and bias are known."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drivers.mounting import Mounting
from drivers.samples import AccelerationSample, HeadingReference, HeadingSample, RateSample
from rover_hil.config import Config, load_config, read_config_text
from rover_hil.recording.writer import LogWriter
from tests.rover_hil.command import Command, assert_one_sentence

START_NS = 1_000_000_000
STEP_S = 0.02
REST_S, TURN_S = 3.0, 10.0
BIAS_DEG_S = np.array([0.4, -0.2, 0.3])
SCALE = 1.03
TURNS = (2.0, -2.0, 1.5)


def write_turns(
    path: Path,
    config: Config,
    tilt_deg: tuple[float, float],
    *,
    turns: tuple[float, ...] = TURNS,
    slope_deg: float = 0.0,
    has_compass: bool = False,
    has_accelerations: bool = True,
    in_rover: bool = False,
) -> None:
    """Write the log of a sensor turned by pitch and roll on a rover that turns between rests."""
    pitch_deg, roll_deg = tilt_deg
    to_sensor = Rotation.from_euler("YX", [pitch_deg, roll_deg], degrees=True).inv()
    rng = np.random.default_rng(5)
    rates = [np.zeros(round(REST_S / STEP_S))]
    for turn in turns:
        rates += [np.full(round(TURN_S / STEP_S), math.tau * turn / TURN_S), np.zeros(round(REST_S / STEP_S))]
    yaw_rates = np.concatenate(rates)
    yaws = np.cumsum(yaw_rates) * STEP_S
    bias = np.radians(BIAS_DEG_S)
    gravity = 9.80665 * np.array([math.sin(math.radians(slope_deg)), 0.0, math.cos(math.radians(slope_deg))])
    with LogWriter(path, START_NS, config.model_dump_json(by_alias=True).encode(), {}, "real") as log:
        for step, (rate, yaw) in enumerate(zip(yaw_rates.tolist(), yaws.tolist(), strict=True)):
            t_ns = START_NS + round(1e9 * STEP_S * step)
            reading = to_sensor.apply([0.0, 0.0, rate]) / SCALE + bias + rng.normal(0.0, 0.002, 3)
            # The slope stays where it is while the rover turns on it.
            force = to_sensor.apply(Rotation.from_euler("Z", -yaw).apply(gravity)) + rng.normal(0.0, 0.05, 3)
            # The driver has turned the readings into the rover's axes where it knows the mounting.
            x, y, z = (to_sensor.inv().apply(reading) if in_rover else reading).tolist()
            sample = RateSample(
                device="imu", t_ns=t_ns, rate_z_rad_s=z,
                rate_x_rad_s=x, rate_y_rad_s=y,
            )  # fmt: skip
            ax, ay, az = force.tolist()
            samples = [sample, AccelerationSample(device="imu", t_ns=t_ns, x_m_s2=ax, y_m_s2=ay, z_m_s2=az)]
            if has_compass and step % 10 == 0:
                heading = math.remainder(yaw + 1.0 + rng.normal(0.0, 0.01), math.tau)
                samples.append(
                    HeadingSample(
                        device="compass", t_ns=t_ns, heading_rad=heading, reference=HeadingReference.MAGNETIC
                    )
                )
            log.samples(t_ns, samples if has_accelerations else samples[:1])


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config("robotino")


def calibrate(command: Command, *options: str) -> int:
    return command("calibrate", "mounting", "turns.mcap", "--out", "mounting.toml", *options)


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize(
    ("tilt_deg", "axis"),
    [((0.0, 0.0), "z"), ((2.0, -3.0), "z"), ((1.0, 179.0), "-z"), ((-88.0, 0.0), "x"), ((0.0, -90.0), "-y")],
)
def test_mounting_scale_and_bias_are_found(
    command: Command, config: Config, tilt_deg: tuple[float, float], axis: str
) -> None:
    write_turns(Path("turns.mcap"), config, tilt_deg)
    assert calibrate(command, "--made", "2,-2,1.5") == 0, command.out + command.error
    assert f"axis that points up: {axis}\n" in command.out
    values = tomllib.loads(Path("mounting.toml").read_text("utf-8"))["devices"]["imu"]
    assert values["gyro_scale"] == pytest.approx(SCALE, abs=0.001)
    mounting = Mounting(
        roll_rad=math.radians(values["mounting_roll_deg"]),
        pitch_rad=math.radians(values["mounting_pitch_deg"]),
        gyro_scale=values["gyro_scale"],
        gyro_bias_rad_s=math.radians(values["gyro_bias_deg_s"]),
    )
    # With these values the driver gives the true yaw rate about the true axis.
    to_sensor = Rotation.from_euler("YX", tilt_deg, degrees=True).inv()
    for rate in (0.0, 0.7):
        reading = to_sensor.apply([0.0, 0.0, rate]) / SCALE + np.radians(BIAS_DEG_S)
        x, y, z = reading.tolist()
        assert mounting.correct_rate(mounting.vector_to_rover((x, y, z)))[2] == pytest.approx(rate, abs=0.002)
    up = mounting.vector_to_rover(tuple(to_sensor.apply([0.0, 0.0, 1.0]).tolist()))
    assert math.degrees(math.acos(min(1.0, up[2]))) < 0.1
    assert Path("mounting.html").read_text("utf-8").count("<section") >= 3


@pytest.mark.usefixtures("unrendered")
def test_a_slope_does_not_tilt_the_mounting(command: Command, config: Config) -> None:
    write_turns(Path("turns.mcap"), config, (0.0, 0.0), slope_deg=6.0)
    assert calibrate(command, "--made", "2,-2,1.5", "--json") == 0
    values = json.loads(command.out)
    assert values["mounting_pitch_deg"] == pytest.approx(0.0, abs=0.1)
    assert values["mounting_roll_deg"] == pytest.approx(0.0, abs=0.1)


@pytest.mark.usefixtures("unrendered")
def test_a_compass_in_the_log_counts_the_turns(command: Command, config: Config) -> None:
    write_turns(Path("turns.mcap"), config, (0.0, 0.0), has_compass=True)
    assert calibrate(command) == 0, command.error
    assert "compass 'compass'" in command.out
    assert "+2.00, -2.00, +1.50" in command.out
    values = tomllib.loads(Path("mounting.toml").read_text("utf-8"))["devices"]["imu"]
    assert values["gyro_scale"] == pytest.approx(SCALE, abs=0.002)


@pytest.mark.usefixtures("unrendered")
def test_without_accelerations_a_wrong_sense_is_no_sensor_upside_down(
    command: Command, config: Config
) -> None:
    write_turns(Path("turns.mcap"), config, (0.0, 0.0), has_accelerations=False)
    assert calibrate(command, "--made", "2,-2,1.5") == 0, command.error
    values = tomllib.loads(Path("mounting.toml").read_text("utf-8"))["devices"]["imu"]
    assert values["mounting_roll_deg"] == pytest.approx(0.0, abs=0.3)
    assert values["gyro_bias_deg_s"] == pytest.approx(SCALE * BIAS_DEG_S[2], abs=0.02)
    assert calibrate(command, "--made=-2,2,-1.5", "--force") == 1
    assert "not written: the sensor is mounted in another way than the configuration says" in command.out
    # The configuration says that it is upside down, and it is.
    imu = config.devices["imu"].model_copy(update={"mounting_roll_deg": 180.0})
    turned = config.model_copy(update={"devices": {**config.devices, "imu": imu}})
    Path("turns.mcap").unlink()
    write_turns(Path("turns.mcap"), turned, (0.0, 180.0), has_accelerations=False, in_rover=True)
    assert calibrate(command, "--made", "2,-2,1.5", "--force") == 0, command.out
    values = tomllib.loads(Path("mounting.toml").read_text("utf-8"))["devices"]["imu"]
    assert abs(values["mounting_roll_deg"]) == pytest.approx(180.0, abs=0.3)


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize(
    ("made", "words"),
    [
        ("-2,2,-1.5", "counter-clockwise is positive"),
        ("2,-2,2.5", "contradict each other"),
        ("4,-4,3", "were all turns counted"),
    ],
)
def test_wrong_counts_are_not_written(command: Command, config: Config, made: str, words: str) -> None:
    write_turns(Path("turns.mcap"), config, (0.0, 0.0))
    assert calibrate(command, f"--made={made}") == 1
    assert "not written: " in command.out
    assert words in command.out
    assert not Path("mounting.toml").exists()
    assert Path("mounting.html").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), ("--made", "3,-3,3")),
        (("--made", "2,-2"), ("2 turns", "holds 3")),
        (("--made", "two"), ("--made two",)),
        (("--made", "2,-2,0"), ("--made",)),
        (("--device", "board", "--made", "2,-2,1.5"), ("'board'", "imu")),
        (("--virtual",), ("is a log",)),
    ],
)
def test_bad_input_is_one_sentence(
    command: Command, config: Config, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    write_turns(Path("turns.mcap"), config, (0.0, 0.0))
    assert calibrate(command, *options) == 2
    assert_one_sentence(command.error, *words)


def test_a_log_without_turns_is_one_sentence(command: Command, config: Config) -> None:
    write_turns(Path("turns.mcap"), config, (0.0, 0.0), turns=(0.2,))
    assert calibrate(command, "--made", "1") == 2
    assert_one_sentence(command.error, "no half turn")


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize("turns", [("--turns", "2"), ("--turns=2",)])
def test_the_old_spelling_works_and_tells_the_new_one(
    command: Command, config: Config, turns: tuple[str, ...]
) -> None:
    write_turns(Path("turns.mcap"), config, (0.0, 0.0))
    assert command("calibrate", "imu", "turns.mcap", *turns, "--made", "2,-2,1.5", "--out", "a.toml") == 0
    assert "`calibrate imu --turns` is now `calibrate mounting`" in command.error
    assert Path("a.toml").is_file()


@pytest.mark.usefixtures("unrendered")
def test_an_upside_down_sensor_is_found_entered_and_then_right(command: Command) -> None:
    text = read_config_text("robotino").replace("#:schema", "#")
    text = text.replace(
        'frames = ["rate"]', 'frames = ["rate"]\nmounting_roll_deg = 178.0\ngyro_scale = 0.97\n'
    )
    Path("rover.toml").write_text(text, "utf-8")
    options = ("calibrate", "mounting", "rover.toml", "--virtual", "--turns", "1")
    assert command(*options, "--out", "first.toml", "--enter") == 0, command.out + command.error
    assert "axis that points up: -z" in command.out
    found = load_config("rover.toml").devices["imu"]
    assert getattr(found, "mounting_roll_deg") % 360.0 == pytest.approx(178.0, abs=0.3)  # noqa: B009
    assert getattr(found, "gyro_scale") == pytest.approx(0.97, abs=0.002)  # noqa: B009
    assert command("check", "rover.toml") == 0
