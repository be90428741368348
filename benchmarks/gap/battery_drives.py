"""Hidden effects in motors and drives, named blind: `python -m benchmarks.gap.battery_drives [--first N]`.

Nature (tests/nature: motor.py, omni_drive.py, four_wheel_drive.py) makes the runs and knows nothing of the
models. Cases of the three models take turns; each draws its own base parameters within what the model says
of them, and adds white, autocorrelated (AR 0.95), heavy-tailed or quantised errors. Motors have dry friction
and delay; the model knows of them but where they are what is hidden. Prints one line per case, then the table
with 95 % bounds (Clopper-Pearson). Cases 0 to 89 served development.
"""

import argparse
import csv
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap.battery_table import share
from rover_hil.gap.data.load import load_model, read_runs
from rover_hil.gap.output.model_file import ExtendedModel, ModelFile, Number, Provenance
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Model
from tests.nature import four_wheel_drive, motor, omni_drive

Array = NDArray[np.float64]
NOISES = ("white", "ar", "heavy", "quantised")
NAMED = ("NAMED", "NAMED_SET", "PARTLY_NAMED")


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """What is hidden.

    Attributes:
        model: Compared with it.
        names: Effects that explain it.
        knobs: Of nature, per unit of strength.
        twins: Other effects that do the same to such runs: the honest answer is a set.
        kind: none, single, pair or outside.
        is_bare: The motor's friction and delay are hidden, too.
    """

    model: str
    names: tuple[str, ...] = ()
    knobs: Mapping[str, float]
    twins: tuple[str, ...] = ()
    kind: str = "single"
    is_bare: bool = False


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A case and what was said."""

    hidden: Hidden
    scale: float
    noise: str
    verdict: Verdict


def _one(model: str, name: str, twins: tuple[str, ...] = (), **knobs: float) -> Hidden:
    return Hidden(model=model, names=(name,), knobs=knobs, twins=twins)


def _two(model: str, names: tuple[str, str], **knobs: float) -> Hidden:
    return Hidden(model=model, names=names, knobs=knobs, kind="pair")


def _other(model: str, **knobs: float) -> Hidden:
    return Hidden(model=model, knobs=knobs, kind="outside")


MOTOR, OMNI, FOUR = "robotino-motor", "robotino-drive", "four-wheel-drive"
HIDDEN: Mapping[str, tuple[Hidden, ...]] = {
    MOTOR: (
        replace(_two(MOTOR, ("coulomb_friction", "loop_delay")), is_bare=True),
        _one(MOTOR, "viscous_friction", viscous_nm_s=8e-5),
        _one(MOTOR, "asymmetric_friction", forward_nm=0.004),
        _one(MOTOR, "current_offset", offset_a=0.05),
        _two(MOTOR, ("asymmetric_friction", "viscous_friction"), forward_nm=0.004, viscous_nm_s=8e-5),
        _one(MOTOR, "dead_zone", lost_v=0.6),
        _other(MOTOR, drag_nm_s2=2e-6),
        _one(MOTOR, "stribeck_friction", breakaway_nm=0.008),
    ),
    OMNI: (
        _one(OMNI, "camera_scale", twins=("wheel_radius",), scale=0.05),
        _one(OMNI, "camera_scale", twins=("wheel_radius",), scale=-0.05, turns=1.0),
        _one(OMNI, "wheel_radius", twins=("camera_scale",), radius=0.05, turns=1.0),
        _one(OMNI, "base_radius", twins=("turn_scrub",), base=0.15, turns=1.0),
        _one(OMNI, "marker_yaw", marker_deg=8.0),
        _one(OMNI, "latency", camera_age_s=0.15),
        _one(OMNI, "encoder_dropouts", twins=("uneven_wheel",), lost_ticks=0.05),
        _one(OMNI, "wheel_slip", slip_per_pull=0.2),
        _two(OMNI, ("latency", "marker_yaw"), camera_age_s=0.15, marker_deg=8.0),
        _other(OMNI, creep_m_s=0.01),
    ),
    FOUR: (
        _one(FOUR, "hard_iron", wave_1=4.0),
        _one(FOUR, "soft_iron", wave_2=3.0),
        _one(FOUR, "compass_lag", compass_lag_s=0.8),
        _one(FOUR, "wheel_radius", twins=("wheel_slip",), radius_share=-0.05),
        _one(FOUR, "gyro_bias", gyro_offset=0.4),
        _one(FOUR, "gyro_scale", gyro_scale=0.1),
        _one(FOUR, "latency", encoder_age_s=0.2),
        _two(FOUR, ("hard_iron", "gyro_bias"), wave_1=4.0, gyro_offset=0.4),
        _two(FOUR, ("slope_slip", "side_drift"), sand=0.1),
        _other(FOUR, gyro_drift=0.6),
    ),
}
FRICTION_NM, DELAY_S, CYCLE_S = 0.0085, 0.1, 0.0306
SCALES = (1.0, 1.5, 2.0)


def cases(count: int) -> list[tuple[Hidden, float, str, int]]:
    """Return the first `count` cases; a third of them hide nothing."""
    drawn = []
    for seed in range(count):
        model = (MOTOR, OMNI, FOUR)[seed % 3]
        turn = seed // 3
        noise = NOISES[turn // 3 % 4]
        if turn % 3 == 0:
            drawn.append((Hidden(model=model, knobs={}, kind="none"), 1.0, noise, seed))
        else:
            place = turn - turn // 3 - 1
            several = HIDDEN[model]
            scale = SCALES[(place // len(several) + turn) % 3]
            drawn.append((several[place % len(several)], scale, noise, seed))
    return drawn


def errors(kind: str, size: float, count: int, rng: np.random.Generator) -> Array:
    """Return errors of standard deviation `size`; none for the quantised kind."""
    white: Array = rng.standard_normal(count)
    match kind:
        case "white":
            return size * white
        case "ar":
            walk = np.zeros(count)
            for index in range(count):
                walk[index] = 0.95 * walk[max(index - 1, 0)] + math.sqrt(1.0 - 0.95**2) * white[index]
            return size * walk
        case "heavy":
            return size * rng.standard_t(3.0, count) / math.sqrt(3.0)
    return np.zeros(count)


def disturbed(values: Array, kind: str, size: float, rng: np.random.Generator) -> Array:
    """Return values with errors of a kind, or cut to steps of 3 `size`."""
    if kind == "quantised":
        return np.round(values / (3.0 * size)) * 3.0 * size
    return values + errors(kind, size, values.shape[0], rng)


def make_motor(folder: Path, knobs: Mapping[str, float], kind: str, rng: np.random.Generator) -> None:
    """Write two records of three motors."""
    constant = 0.0508 * (1.0 + 0.01 * rng.standard_normal())
    true = motor.TrueMotor(
        resistance_ohm=5.6 + 0.25 * rng.standard_normal(),
        speed_constant_v_s=constant,
        torque_constant_nm_a=constant,
        inertia_kg_m2=8e-6 * math.exp(0.15 * rng.standard_normal()),
        coulomb_nm=FRICTION_NM,
        viscous_nm_s=0.0,
        delay_s=DELAY_S,
        supply_v=30.0,
        kp=135.0 * (1.0 + 0.05 * rng.standard_normal()),
    )
    true = replace(true, **knobs)
    for number in (1, 2):
        speeds = (12.0, 33.0, 55.0) if number == 1 else (20.0, 45.0)
        profile = motor.staircase(speeds, hold_s=1.2, rest_s=0.5)
        measured = motor.measure(true, profile, 3, rng, steps_per_cycle=2)
        columns = [disturbed(one, kind, 0.8, rng) for one in measured.speed_rad_s.T]
        measured = replace(measured, speed_rad_s=np.stack(columns, axis=1))
        motor.write_csv(folder / f"record{number}_without_integral.csv.gz", measured, (0, 1, 2))


def make_omni(folder: Path, knobs: Mapping[str, float], kind: str, rng: np.random.Generator) -> None:
    """Write sixteen drives in as many directions; with `turns` they also turn."""
    hidden = dict(knobs)
    turns = hidden.pop("turns", 0.0) > 0.0
    true = omni_drive.TrueRover(
        radius_m=0.04 * (1.0 + hidden.pop("radius", 0.0) + 0.003 * rng.standard_normal()),
        arm_m=0.125 * (1.0 + hidden.pop("base", 0.0) + 0.03 * rng.standard_normal()),
        mm_per_px=1.84 * (1.0 + hidden.pop("scale", 0.0) + 0.004 * rng.standard_normal()),
        marker_deg=hidden.pop("marker_deg", 0.0) + 1.0 * rng.standard_normal(),
        camera_age_s=hidden.pop("camera_age_s", 0.0) + 0.05,
    )
    losing = int(rng.integers(3))
    true = replace(true, losing_wheel=losing, **hidden)
    for index in range(16):
        rate = 0.4 * (-1.0) ** index if turns else 0.0
        table = omni_drive.record(
            true,
            22.5 * index,
            0.1 if index % 3 else 0.2,
            rng,
            duration_s=10.0,
            turning=lambda t, rate=rate: rate * min(1.0, t),  # type: ignore[misc]
        )
        for column in (7, 8, 9):
            table[:, column] = disturbed(table[:, column], kind, 0.2, rng)
        omni_drive.write(folder / f"exp{index:02}.csv.gz", table)


def make_four(folder: Path, knobs: Mapping[str, float], kind: str, rng: np.random.Generator) -> None:
    """Write eight drives at as many headings, on rock unless `sand` says how soft it is."""
    hidden = dict(knobs)
    sand = hidden.pop("sand", 0.0)
    soil = four_wheel_drive.Soil(half_slip=0.002, half_drift=0.002, rolling=0.0, patchiness=0.0)
    if sand > 0.0:
        soil = replace(soil, half_slip=sand, half_drift=sand, patchiness=0.04)
    turn = rng.uniform(0.0, math.tau, 2)
    first, second = hidden.pop("wave_1", 0.0), hidden.pop("wave_2", 0.0)
    waves = (
        first * math.cos(turn[0]),
        first * math.sin(turn[0]),
        second * math.cos(turn[1]),
        second * math.sin(turn[1]),
    )
    true = four_wheel_drive.Rover(
        compass_bias=0.5 * rng.standard_normal(),
        compass_errors=waves,
        compass_lag_s=hidden.pop("compass_lag_s", 1e-6),
        gyro_bias_sd=0.02,
    )
    true = replace(true, **hidden)  # type: ignore[arg-type]
    for index in range(8):
        site = replace(four_wheel_drive.random_site(rng), way_m=3.0)
        drive = four_wheel_drive.drive(site, soil, true, rng, psi_rad=math.tau * index / 8)
        truth = dict(drive.truth)
        for name, size in (("x_m", 1e-3), ("y_m", 1e-3), ("yaw_rad", 1e-3)):
            truth[name] = disturbed(truth[name], kind, size, rng)
        log = dict(drive.log)
        for name, size in (("heading_deg", 0.3), ("yaw_rate_deg_s", 0.1)):
            log[name] = disturbed(log[name], kind, size, rng)
        _write(folder / f"drive{index}.csv", log)
        _write(folder / f"drive{index}_truth.csv", truth)


def _write(path: Path, columns: Mapping[str, Array]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


MAKERS: Mapping[str, Callable[[Path, Mapping[str, float], str, np.random.Generator], None]] = {
    MOTOR: make_motor,
    OMNI: make_omni,
    FOUR: make_four,
}


def model_of(hidden: Hidden, base: Model) -> Model:
    """Return the model; of a motor with friction and delay, as an earlier analysis would leave it."""
    if hidden.model != MOTOR or hidden.is_bare:
        return base
    known = {
        "coulomb_friction": {"torque": Number(value=FRICTION_NM, unit="N m", sd=4e-4)},
        "loop_delay": {"time": Number(value=DELAY_S - CYCLE_S / 2, unit="s", sd=0.01)},
    }
    source = Provenance(date="", verdict="NAMED", data_sha256="", plan_sha256="", seed=0)
    return ExtendedModel(base, ModelFile(base=MOTOR, provenance=source, parameters={}, effects=known))


def run(hidden: Hidden, scale: float, noise: str, seed: int) -> Outcome:
    """Make the data of a case and ask for its verdict."""
    rng = np.random.default_rng(70_000 + seed)
    knobs = {name: value if name == "turns" else scale * value for name, value in hidden.knobs.items()}
    with tempfile.TemporaryDirectory() as folder:
        MAKERS[hidden.model](Path(folder), knobs, noise, rng)
        base = load_model(hidden.model)
        runs = read_runs(base, Path(folder))
        model = model_of(hidden, base)
    verdict = analyse(model, runs, seed=seed).verdict
    # A base parameter far from nominal is the same cause as the effect that sets it free.
    effects = {card.releases: card.name for card in base.effects if card.releases}
    causes = [[effects.get(name, name) for name in names] for names in verdict.confidence_set]
    return Outcome(hidden=hidden, scale=scale, noise=noise, verdict=replace(verdict, confidence_set=causes))


def _is_named(one: Outcome) -> bool:
    return one.verdict.verdict in NAMED


def _holds(one: Outcome) -> bool:
    return any(set(one.hidden.names) <= set(names) for names in one.verdict.confidence_set)


def _is_exact(one: Outcome) -> bool:
    honest = {frozenset(one.hidden.names)} | {frozenset((twin,)) for twin in one.hidden.twins}
    return {frozenset(names) for names in one.verdict.confidence_set} == honest


def _is_wrong(one: Outcome) -> bool:
    sure = one.verdict.confidence_set
    known = {*one.hidden.names, *one.hidden.twins}
    return one.verdict.verdict == "NAMED" and len(sure) == 1 and not set(sure[0]) <= known


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the lines of the table."""
    none, single, pair, outside = (
        [one for one in outcomes if one.hidden.kind == kind] for kind in ("none", "single", "pair", "outside")
    )
    sizes = [len(one.verdict.confidence_set) for one in single if _is_named(one)]
    seconds = [one.verdict.seconds for one in outcomes]
    is_open = [one.verdict.verdict in ("UNNAMED", "PARTLY_NAMED") for one in outside]
    lines = [
        f"no effect, but named                 {share([_is_named(one) for one in none])}",
        f"no effect, and NO_GAP                {share([one.verdict.verdict == 'NO_GAP' for one in none])}",
        f"single: found at all                 {share([_is_named(one) for one in single])}",
        f"single: truth in the confidence set  {share([_holds(one) for one in single])}",
        f"single: exact (twins as a set)       {share([_is_exact(one) for one in single])}",
        f"single: mean size of the set         {np.mean(sizes) if sizes else np.nan:.2f}",
        f"wrong confident single name          {share([_is_wrong(one) for one in outcomes])}",
        f"pairs: both in the set               {share([_holds(one) for one in pair])}",
        f"outside: UNNAMED or PARTLY_NAMED     {share(is_open)}",
        f"seconds, median and greatest         {np.median(seconds):.1f}, {max(seconds):.1f}",
    ]
    for model in HIDDEN:
        mine = [one for one in single if one.hidden.model == model]
        lines.append(f"  {model:18} truth in the set   {share([_holds(one) for one in mine])}")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=90)
    parser.add_argument("--first", type=int, default=0)
    arguments = parser.parse_args()
    outcomes = []
    for hidden, scale, noise, seed in cases(arguments.first + arguments.cases)[arguments.first :]:
        outcome = run(hidden, scale, noise, seed)
        outcomes.append(outcome)
        verdict = outcome.verdict
        sets = " | ".join("+".join(names) for names in verdict.confidence_set)
        what = "+".join(hidden.names) or ("-" if hidden.kind == "none" else next(iter(hidden.knobs)))
        head = f"{seed:4} {hidden.model:16} {what:32} x{scale:<3} {noise:9}"
        print(f"{head} {verdict.verdict:16} {sets} ({verdict.seconds:.0f} s)", flush=True)
    print()
    print("\n".join(table(outcomes)))


if __name__ == "__main__":
    main()
