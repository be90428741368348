"""Malformed configurations, rigs, calibrations, maps, mappings and pictures: honest ones, changed."""

import json
import math
import random
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from benchmarks.malformed.logs import bitmap_head, png_bomb
from benchmarks.malformed.values import DEEP_MARK, HUGE_MARK, change_somewhere, raw_json

RUN = ("run", "{config}", "--virtual", "--duration", "0.3", "--out", "{out}")
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
WHEELS = ("calibrate", "wheels", "--out", "{out}.toml")
MACHINE = ("gap", "{honest}/my_machine.py:make")
CHECK = ("check", "{config}")
CLIMB = ("terrain", "climb", "--slope-deg", "5")
FTRACE = ("ftrace", "{honest}/frames", "--rig", "{file}", "--out", "{out}.csv")
CALIBRATE = (
    "calibrate", "camera", "{honest}/frames", "--ground", "{honest}/frames/0.png", "--rover", "{file}",
    "--out", "{out}.json", "--columns", "8", "--rows", "6", "--square", "0.04", "--ground-x", "-1",
    "--ground-y", "0",
)  # fmt: skip


@dataclass(frozen=True)
class SettingsFile:
    """A format: an honest file, and the commands that read it as `{file}`.

    Attributes:
        config: Per key with dots what a shipped configuration must hold to name the file; the commands get it
            as `{config}`.
        beside: Files that must lie in the same folder.
    """

    name: str
    suffix: str
    text: str
    commands: Sequence[tuple[str, ...]]
    base_config: str = "robotino"
    config: Mapping[str, object] = field(default_factory=dict)
    beside: Mapping[str, str] = field(default_factory=dict)


def honest_settings() -> list[SettingsFile]:
    """Return the formats."""
    shipped = resources.files("rover_hil.config") / "shipped"
    soil = resources.files("sim_backends.terramechanics.soil") / "library"
    wheels = resources.files("drivers.can_wheels")
    mapping, dbc = ((wheels / f"generic_wheel.{kind}").read_text("utf-8") for kind in ("toml", "dbc"))
    rig = (shipped / "rigs" / "el-dorado.json").read_text("utf-8")
    floor = (resources.files("drivers.overhead_camera") / "simulated.toml").read_text("utf-8")
    site = resources.files("sim_backends.plants.robotino") / "sites" / "paper_like.toml"
    layout = (EXAMPLES / "differential.toml").read_text("utf-8").replace("docs/examples", str(EXAMPLES))
    imu = {"type": "witmotion", "port": "/dev/ttyUSB9", "baud_rate": 115200, "calibration": "{file}"}
    compass = {"type": "nmea_compass", "port": "/dev/ttyUSB9", "baud_rate": 4800, "calibration": "{file}"}
    overhead = {
        "type": "overhead_camera", "source": "live_folder", "path": "frames", "marker_id": 7,
        "marker_size_m": 0.12, "marker_height_m": 0.22, "calibration": "{file}",
    }  # fmt: skip
    wheels_of = {"devices.wheels.mapping": "{file}"}
    return [
        SettingsFile(
            "robotino",
            ".toml",
            (shipped / "configs" / "robotino.toml").read_text("utf-8"),
            (
                ("run", "{file}", "--virtual", "--duration", "0.3", "--out", "{out}"),
                ("replay", "{honest}/robotino.mcap", "--config", "{file}"),
                ("tune", "{file}", "--study", "s", "--trials", "1", "--minutes", "0.05", "--out", "{out}"),
                ("check", "{file}"),
                (*WHEELS, "{file}", "--line", "{honest}/robotino.mcap=2.0"),
                ("import", "robotino", "{honest}/record.csv", "--config", "{file}", "--out", "{out}.mcap"),
            ),
        ),
        SettingsFile(
            "el-dorado",
            ".toml",
            (shipped / "configs" / "el-dorado.toml").read_text("utf-8"),
            (
                ("run", "{file}", "--virtual", "--duration", "0.3", "--out", "{out}"),
                ("doctor", "{file}"),
                ("check", "{file}"),
                ("calibrate", "compass", "{file}", "--log", "{honest}/el-dorado.mcap", "--out", "{out}.toml"),
                ("replay", "{honest}/el-dorado.mcap", "--config", "{file}"),
            ),
        ),
        SettingsFile(
            "maps",
            ".toml",
            (shipped / "slip_maps" / "robotino.toml").read_text("utf-8"),
            (RUN, ("identify", "probe", "{honest}/robotino.mcap", "--maps", "{file}", "--out", "{out}.toml")),
            config={"slip.maps": "{file}", "slip.use": "surfaces"},
        ),
        SettingsFile(
            "parameters",
            ".toml",
            (shipped / "scomp_parameters" / "el-dorado.toml").read_text("utf-8"),
            (("scomp", "{honest}/scomp.csv", "--params", "{file}", "--out", "{out}.csv"), RUN),
            base_config="el-dorado",
            config={"scomp.parameters": "{file}"},
        ),
        SettingsFile(
            "rig",
            ".json",
            rig,
            (FTRACE, CALIBRATE, RUN, CHECK),
            base_config="el-dorado",
            config={"scomp.rig": "{file}"},
        ),
        SettingsFile(
            "mapping",
            ".toml",
            mapping,
            (RUN, CHECK, ("doctor", "{config}")),
            base_config="el-dorado",
            config=wheels_of,
            beside={"generic_wheel.dbc": dbc},
        ),
        SettingsFile(
            "dbc",
            ".dbc",
            dbc,
            (RUN, CHECK, ("init", "{out}.toml", "--dbc", "{file}")),
            base_config="el-dorado",
            config={"devices.wheels.mapping": "{folder}/mapping.toml"},
            beside={"mapping.toml": mapping.replace("generic_wheel.dbc", "{name}")},
        ),
        SettingsFile(
            "iron",
            ".toml",
            'source = "turned"\ndate = 2026-01-01\nhard_iron_counts = [1.0, 2.0, 3.0]\n'
            "soft_iron = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n",
            (RUN, CHECK),
            config={"devices.imu2": imu},
        ),
        SettingsFile(
            "deviation",
            ".toml",
            'source = "swung"\ndate = 2026-01-01\nheading_deg = [0.0, 90.0, 180.0, 270.0]\n'
            "deviation_deg = [1.0, 2.0, -1.0, 0.5]\n",
            (RUN, CHECK),
            config={"devices.compass2": compass},
        ),
        SettingsFile("floor", ".toml", floor, (RUN, CHECK), config={"devices.overhead": overhead}),
        SettingsFile(
            "site", ".toml", site.read_text("utf-8"), (RUN, CHECK), config={"simulation.site": "{file}"}
        ),
        SettingsFile(
            "soil",
            ".toml",
            (soil / "soils" / "toyoura.toml").read_text("utf-8"),
            ((*CLIMB, "--soil", "{file}"), ("terrain", "wheel", "--soil", "{file}", "--slip", "0.1")),
        ),
        SettingsFile(
            "wheel",
            ".toml",
            (soil / "wheels" / "wh31.toml").read_text("utf-8"),
            ((*CLIMB, "--wheel", "{file}"),),
        ),
        SettingsFile(
            "cmu_soil",
            ".toml",
            (soil / "any_angle" / "cmu_sand.toml").read_text("utf-8"),
            (("terrain", "fit", "{honest}", "--plates-only", "--soil", "{file}"),),
        ),
        SettingsFile(
            "model",
            ".toml",
            'schema = "rover-hil-model/1"\nbase = "robotino-drive"\n[provenance]\ndate = "2026-01-01"\n'
            'verdict = "named"\ndata_sha256 = "0"\nplan_sha256 = "0"\nseed = 0\n[effects.slope.slope_x]\n'
            'value = 0.1\nunit = "deg"\nsd = 0.1\nci95 = [0.0, 0.2]\n',
            (
                (*RUN, "--model", "{file}"),
                ("gap", "robotino-drive", "{honest}/robotino.mcap", "--model", "{file}", "--out", "{out}"),
                ("terrain", "traverse", "--roll-deg", "0", "--model", "{file}"),
            ),
        ),
        SettingsFile(
            "wheels",
            ".toml",
            layout,
            (
                ("run", "{file}", "--virtual", "--duration", "0.3", "--out", "{out}"),
                ("check", "{file}"),
                ("doctor", "{file}"),
                ("gap", "rover", "{file}", "{honest}/robotino.mcap", "--out", "{out}"),
            ),
        ),
        SettingsFile(
            "allowed",
            ".toml",
            'duration_s = [1.0, 2.0]\nforbidden = ["a*"]\n'
            "inputs.voltage = { low = -1.0, high = 1.0, period_s = [0.1, 1.0], shapes = ['step', 'sweep'] }\n"
            'channels.encoder = { low = -9.0, high = 9.0 }\n',
            # Of data that cannot be used: an analysis would take minutes.
            ((*MACHINE, "{honest}/truth.csv", "--allowed", "{file}", "--out", "{out}"),),
        ),
        SettingsFile(
            "unit",
            ".toml",
            'fmu = "../honest/axis.fmu"\nstep_s = 0.04\ninputs.voltage = {}\nsignals.speed = {}\n'
            'channels.encoder = { variable = "angle", sigma = 0.005, quantum = 0.0123 }\n'
            "parameters.damping = { prior_sd = 0.004, lower = 0.001, upper = 0.1 }\n"
            'run_parameters.first_angle = { prior_sd = 0.01, channel = "encoder" }\n'
            'effects.drag = { sentence = "Drag.", strength = { variable = "drag", size = 0.0005 } }\n',
            (("gap", "check", "{file}", "{honest}/machine.csv"),),
        ),
    ]  # fmt: skip


def config_text(kind: SettingsFile, path: Path) -> str:
    """Return a configuration that names a file of this kind."""
    from rover_hil.config.loader import read_config_text

    table = tomllib.loads(read_config_text(kind.base_config))
    for dotted, value in kind.config.items():
        *parents, last = dotted.split(".")
        holder = table
        for parent in parents:
            holder = holder.setdefault(parent, {})
        holder[last] = _filled(value, path)
    return toml_of(table)


def _filled(value: object, path: Path) -> object:
    if isinstance(value, dict):
        return {key: _filled(part, path) for key, part in value.items()}
    return value.format(file=path, folder=path.parent) if isinstance(value, str) else value


def toml_of(table: Mapping[str, object]) -> str:
    """Return TOML with one line per key of the outermost table."""
    return "".join(f"{json.dumps(key)} = {_toml(value)}\n" for key, value in table.items())


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if value == DEEP_MARK:
        return "[" * 20_000 + "]" * 20_000
    if value == HUGE_MARK:
        return "9" * 4000
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, bool | str | int | float):
        return json.dumps(value)
    return '"none"' if value is None else str(value)


def named_settings(kind: SettingsFile) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield each hand-made change of a file."""
    data = kind.text.encode()
    yield "empty", lambda: b""
    yield "not_text", lambda: b"\xff\xfe\x00" + data
    yield "2_mb", lambda: data + b"\n#" + b"x" * 2_000_000
    yield "utf16", lambda: kind.text.encode("utf-16")
    yield "long_line", lambda: b"k" * 900_000
    if kind.suffix == ".json":
        yield "deep", lambda: b"[" * 400_000 + b"]" * 400_000
        yield "deep_tables", lambda: b'{"a":' * 150_000 + b"1" + b"}" * 150_000
        yield "huge_number", lambda: b'{"b_m":' + b"9" * 5000 + b"}"
        yield "a_list", lambda: b"[]"
        return
    if kind.suffix == ".dbc":
        yield "huge_message", lambda: re.sub(rb": 8 ", b": 999999999 ", data)
        yield "huge_signal", lambda: data.replace(b"|16@", b"|999999999@")
        yield (
            "many_signals",
            lambda: (
                data
                + b"".join(
                    b'BO_ %d M%d: 8 X\n SG_ S : 0|8@1+ (1,0) [0|0] "" X\n\n' % (n, n)
                    for n in range(1000, 15_000)
                )
            ),
        )
        yield "huge_values", lambda: data.replace(b"(1,0)", b"(1e308,-1e308)")
        return
    yield "deep", lambda: b"a = " + b"[" * 400_000
    yield "deep_tables", lambda: b"a = " + b"{a = " * 100_000
    yield "dotted_header", lambda: b"[a" + b".a" * 200_000 + b"]\n" + b"b = 1\n" * 10
    yield "dotted_keys", lambda: b"a" + b' . "b"' * 100_000 + b" = 1\n"
    yield "huge_number", lambda: b"a = " + b"9" * 5000 + b"\n" + data
    yield "many_keys", lambda: b"".join(b"k%d = 1\n" % number for number in range(80_000)) + data
    yield "many_tables", lambda: data + b"".join(b"[t%d]\na=1\n" % number for number in range(50_000))


def random_settings(kind: SettingsFile, generator: random.Random) -> bytes:
    """Return a file with random damage of one kind."""
    if kind.suffix == ".dbc" or generator.random() < 0.2:
        data = bytearray(kind.text.encode())
        for _ in range(generator.choice((1, 4, 20))):
            data[generator.randrange(len(data))] = generator.choice(b"0123456789.=[]{}\"'\n\x00 e-,")
        return bytes(data)
    value = json.loads(kind.text) if kind.suffix == ".json" else tomllib.loads(kind.text)
    for _ in range(generator.choice((1, 1, 1, 2, 5))):
        value = change_somewhere(value, generator)
    if kind.suffix == ".json":
        return raw_json(value)
    return toml_of(value).encode() if isinstance(value, dict) else b"= 1"


def malformed_pictures() -> Iterator[tuple[str, str, Callable[[], bytes]]]:
    """Yield name, name of the file and content of each picture or video."""
    yield "gigapixel_bitmap", "0.bmp", lambda: bitmap_head(32_000, 32_000) + bytes(1000)
    yield "picture_bomb", "0.png", lambda: png_bomb(30_000)
    yield "text", "0.png", lambda: b"no picture"
    yield "empty", "0.jpg", lambda: b""
    yield "huge_pgm", "0.pgm", lambda: b"P5 60000 60000 255\n" + bytes(1000)
    yield "huge_ppm_text", "0.ppm", lambda: b"P3 50000 50000 255\n1 2 3"
    yield "cut_jpeg", "0.jpg", lambda: b"\xff\xd8\xff\xe0\x00\x10JFIF" + bytes(500)
    yield (
        "tiff",
        "0.tif",
        lambda: b"II*\x00\x08\x00\x00\x00\xff\xff" + b"\x00\x01\x04\x00\x01\x00\x00\x00" * 5000,
    )
    yield "long_number", "9" * 200 + ".png", lambda: png_bomb(16)


def random_picture(generator: random.Random) -> bytes:
    """Return a sound picture with some bits flipped."""
    data = bytearray(png_bomb(64))
    for _ in range(generator.choice((1, 10))):
        data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)
    return bytes(data)
