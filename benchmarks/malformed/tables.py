"""Malformed CSV tables: small honest ones of every format that is read, changed in cells, lines and bytes."""

import gzip
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

CELLS = (
    "", "nan", "inf", "-inf", "1e308", "-1e308", "1e-308", "-0", "0", "1", "9" * 400,
    "9" * 200_000, "x", "true", "\x00", "1_000", "0x10", "１", '"', '"a""b"', "'",
    "a,b;c\td", "=1+1", "\x1b[2J", "é", "1e5", "-5",
    "1;2", "1,5", "../../../dev/zero",
)  # fmt: skip
ROWS = 60


@dataclass(frozen=True)
class Table:
    """A format: an honest table, and the commands that read it as `{file}`; `{honest}` is the folder of all.

    Attributes:
        inside: Name of the file in a folder that the commands get as `{folder}`; else any name.
    """

    name: str
    text: str
    commands: Sequence[tuple[str, ...]]
    separator: str = ","
    header_lines: int = 1
    inside: str = ""


def honest_tables() -> list[Table]:
    """Return the formats."""
    times = [0.05 * row for row in range(ROWS)]
    scomp = [
        "t_s,position1_rad,position2_rad,position3_rad,position4_rad,heading_deg,yaw_rate_deg_s,pitch_deg,roll_deg,beta_ftrace_deg",
        *(
            f"{t:.3f},{2 * t:.4f},{2 * t:.4f},{2 * t:.4f},{2 * t:.4f},{90 + t:.2f},1.0,2.0,5.0,1.5"
            for t in times
        ),
    ]
    truth = ["t_s,x_m,y_m,yaw_rad", *(f"{t:.3f},{0.2 * t:.4f},{0.01 * t:.4f},{0.01 * t:.5f}" for t in times)]
    record = [
        "time;;;;;;;;;;;;;;;;",
        "ms;m/s;rad/s;rad/s;rad/s;ticks;ticks;ticks;rad/s;rad/s;rad/s;A;A;A;pix;pix;deg",
        "t;xsetspeed;m1setvel;m2setvel;m3setvel;m1pos;m2pos;m3pos;m1vel;m2vel;m3vel;m1cur;m2cur;m3cur;"
        "xpos;ypos;ang",
        *(
            f"{31 * row};0.2;-4;0;4;{-600 * row};0;{600 * row};-4;0;4;0.5;0.1;0.5;{100 + 3 * row};200;1.0"
            for row in range(ROWS)
        ),
    ]
    averages_names = (
        "X axis speed, mm/s;Y axis speed, mm/s;Rotational speed, deg/s;Motor 1 velocity, rpm;"
        "Motor 2 velocity, rpm;Motor 3 velocity, rpm;Motor 1 current, A;Motor 2 current, A;"
        "Motor 3 current, A;Delta X, mm;Delta Y, mm;Delta angle, deg"
    )
    averages = [averages_names, *("200;0;0;-600;0;600;0.5;0.1;0.5;90;1;0" for _ in range(ROWS))]
    slope = [
        "run,slope_deg,roll_deg,mass_kg,slip,slip_angle_deg,sinkage_up_mm,torque_up_Nm",
        *(f"r{row},{5 * row},0,23.8,0.1,{row % 7},20,2" for row in range(4)),
    ]
    paths = ["run,t_s,x_mm,y_mm"]
    paths += [f"r{row // 20},{row % 20},{20 * (row % 20)},{row % 20}" for row in range(ROWS)]
    wheel = [
        "beta_deg,Vry_cmd_mm_s,V_mm_s,r_omega_mm_s,Fx_tractive_N,Fy_lateral_N,Fz_load_N,sinkage_mm",
        *(f"{5 * (row % 3)},{10 + row},10,{12 + row},5,-3,60,6" for row in range(4)),
    ]
    machine = ["run,time [s],encoder [rad],voltage [V]"]
    machine += [f"a{row // 20},{0.04 * (row % 20):.2f},{0.1 * (row % 20):.3f},1.0" for row in range(ROWS)]
    telemetry = ["frame,t,wheel_speed_mps,gyro_roll_dps,gyro_pitch_dps,gyro_yaw_dps"]
    telemetry += [f"{row},{0.2 * row:.2f},0.1,0,0,1" for row in range(4)]
    plates = ["test,diameter_m,sinkage_m,load_n"]
    plates += [f"p{1 + row // 20},0.1,{0.001 * (row % 20 + 1)},{5 * (row % 20 + 1)}" for row in range(ROWS)]
    trials = ["cell,slip_angle_deg,speed_m_s,rim_speed_m_s,load_n,drawbar_n,side_n,sinkage_m"]
    trials += [f"c{row // 3},{10 * (row // 3)},0.01,0.0{12 + row},60,5,-3,0.006" for row in range(9)]
    lines_of = {"scomp": scomp, "truth": truth, "record": record, "averages": averages, "slope": slope}
    lines_of |= {"paths": paths, "wheel": wheel, "machine": machine, "telemetry": telemetry}
    lines_of |= {"plates": plates, "trials": trials}
    text = {name: "\n".join(lines) + "\n" for name, lines in lines_of.items()}
    return [
        Table(
            "scomp",
            text["scomp"],
            (
                ("scomp", "{file}", "--out", "{out}.csv"),
                ("identify", "scomp", "{file}", "--truth", "{honest}/truth.csv", "--out", "{out}.toml"),
                ("gap", "four-wheel-drive", "{file}", "--out", "{out}"),
            ),
        ),
        Table(
            "truth",
            text["truth"],
            (("identify", "scomp", "{honest}/scomp.csv", "--truth", "{file}", "--out", "{out}.toml"),),
        ),
        Table(
            "record",
            text["record"],
            (
                ("import", "robotino", "{file}", "--out", "{out}.mcap"),
                ("identify", "motor", "{file}"),
                ("identify", "slip", "{file}"),
            ),
            separator=";",
            header_lines=3,
        ),
        Table(
            "averages",
            text["averages"],
            (("identify", "motor", "{file}"), ("identify", "slip", "{file}")),
            separator=";",
        ),
        Table("slope", text["slope"], (("gap", "side-slope", "{file}", "--out", "{out}"),)),
        Table(
            "paths", text["paths"], (("gap", "side-slope", "{folder}", "--out", "{out}"),), inside="paths.csv"
        ),
        Table("wheel", text["wheel"], (("gap", "single-wheel", "{file}", "--out", "{out}"),)),
        Table("machine", text["machine"], (("gap", "check", "{honest}/my_machine.py:make", "{file}"),)),
        Table(
            "telemetry",
            text["telemetry"],
            (
                (
                    "ftrace",
                    "{honest}/frames",
                    "--rig",
                    "{honest}/rig.json",
                    "--telemetry",
                    "{file}",
                    "--out",
                    "{out}.csv",
                ),
            ),
        ),
        Table(
            "plates",
            text["plates"],
            (("terrain", "fit", "{folder}", "--plates-only"),),
            inside="plates.csv",
        ),
        Table("trials", text["trials"], (("terrain", "fit", "{folder}"),), inside="wheel.csv"),
    ]


def named_tables(table: Table) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield each hand-made change of a table with the suffix of its file."""
    lines = table.text.splitlines()
    header, rows = lines[: table.header_lines], lines[table.header_lines :]
    data = table.text.encode()
    yield "empty.csv", lambda: b""
    yield "header_only.csv", lambda: "\n".join(header).encode()
    yield "one_row.csv", lambda: "\n".join([*header, rows[0]]).encode()
    yield "not_text.csv", lambda: b"\xff\xfe" + data
    yield "zeros.csv", lambda: bytes(100_000)
    yield "nul_inside.csv", lambda: data.replace(b"1", b"\x00", 1)
    yield "carriage_returns.csv", lambda: data.replace(b"\n", b"\r")
    yield "utf16.csv", lambda: table.text.encode("utf-16")
    yield "open_quote.csv", lambda: data + b'"' + b"x" * 500_000
    yield "bomb.csv.gz", lambda: gzip.compress(data) + gzip.compress(bytes(2**20)) * 3000
    yield "cut.csv.gz", lambda: gzip.compress(data)[:-20]
    yield "not_packed.csv.gz", lambda: data
    yield "rows_twice.csv", lambda: "\n".join([*header, *rows, *rows]).encode()
    yield "rows_reversed.csv", lambda: "\n".join([*header, *reversed(rows)]).encode()
    yield "rows_same.csv", lambda: "\n".join([*header, *(rows[:1] * len(rows))]).encode()
    yield "columns_twice.csv", lambda: "\n".join(line + table.separator + line for line in lines).encode()
    separators = table.separator.encode()
    yield "20_million_cells.csv", lambda: "\n".join(header).encode() + b"\n" + separators * 20_000_000
    yield "20_million_lines.csv", lambda: "\n".join(header).encode() + b"\n" + b"1\n" * 20_000_000
    yield "million_names.csv", lambda: separators.join(b"n%d" % n for n in range(10**6)) + b"\n" + data
    yield "long_name.csv", lambda: b"n" * 100_000 + separators + data


def many_groups(table: Table) -> bytes:
    """Return a table of 100 000 rows whose first cell differs in each."""
    lines = table.text.splitlines()
    row = table.separator.join(lines[-1].split(table.separator)[1:])
    body = "\n".join(f"{number}{table.separator}{row}" for number in range(100_000))
    return ("\n".join(lines[: table.header_lines]) + "\n" + body).encode()


def random_table(table: Table, generator: random.Random) -> bytes:
    """Return a table with random damage of one kind."""
    kind = generator.choice(("cells", "cells", "column", "bytes", "cut", "drop_column"))
    if kind == "bytes":
        data = bytearray(table.text.encode())
        for _ in range(generator.choice((1, 5, 50))):
            data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)
        return bytes(data)
    if kind == "cut":
        return table.text.encode()[: generator.randrange(len(table.text))]
    rows = [line.split(table.separator) for line in table.text.splitlines()]
    column = generator.randrange(len(rows[-1]))
    if kind == "drop_column":
        rows = [row[:column] + row[column + 1 :] for row in rows]
    elif kind == "column":
        cell = generator.choice(CELLS)
        for row in rows[table.header_lines :]:
            row[min(column, len(row) - 1)] = cell
    else:
        for _ in range(generator.choice((1, 3, 30))):
            row = generator.choice(rows)
            row[generator.randrange(len(row))] = generator.choice(CELLS)
    return "\n".join(table.separator.join(row) for row in rows).encode()


def write_honest(folder: Path) -> None:
    """Write what commands need besides the malformed table."""
    for table in honest_tables():
        (folder / (table.inside or f"{table.name}.csv")).write_text(table.text)
    (folder / "summary.csv").write_text((folder / "slope.csv").read_text())
    (folder / "my_machine.py").write_text(MACHINE)


MACHINE = """
from rover_hil.gap import Channel, Parameter, Port, StateModel, effects

def derivative(x, u, p, port):
    return {"angle": x.speed, "speed": port("torque", p.gain * u.voltage - 0.02 * x.speed) / 0.005}

def make():
    return StateModel(
        name="axis",
        states={"angle": "rad", "speed": "rad/s"},
        inputs={"voltage": "V"},
        is_held=True,
        derivative=derivative,
        start=lambda p, u: {"angle": 0.0 * u.voltage, "speed": 0.0 * u.voltage},
        output=lambda x, u, p, port: {"encoder": x.angle},
        channels=(Channel(name="encoder", unit="rad", sigma=0.005),),
        parameters=(
            Parameter(name="gain", unit="N m/V", nominal=0.085, prior_sd=0.003, lower=0.04, upper=0.2),
        ),
        ports=(Port(name="torque", unit="N m", force_sd=0.01),),
        port_effects=(effects.coulomb_friction("torque", velocity="speed", size=0.01, slow=0.1),),
    )
"""
