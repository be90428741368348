"""A motor axis as nature makes it: circuit, inertia, friction; exact between steps of a tenth of a sample."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLE_S = 0.02
SUBSTEPS = 10


@dataclass(frozen=True, kw_only=True)
class TrueAxis:
    """Constants in SI units; `gain` and `lag` follow from the first four."""

    torque_constant: float = 0.05
    resistance: float = 0.6
    viscous: float = 0.0166667
    inertia: float = 0.0052083
    dry: float = 0.0
    """Torque against the motion, N m."""
    late: float = 0.0
    """Seconds that the voltage comes late."""
    sag: float = 0.0
    """Share of the voltage lost per volt."""
    zero: float = 0.0
    """Speed shown at rest, rad/s."""
    cogging: float = 0.0
    """Out of every catalogue: torque that follows four times the angle, N m."""
    fan: float = 0.0
    """Out of every catalogue: torque with the square of the speed, N m s^2."""

    @property
    def damping(self) -> float:
        """Torque per speed, back-EMF and bearing together."""
        return self.torque_constant**2 / self.resistance + self.viscous


@dataclass(frozen=True, kw_only=True)
class Drive:
    """How it is driven and measured."""

    runs: int = 12
    samples: int = 300
    noise: float = 0.2
    kind: str = "white"
    correlation: float = 0.95
    quantum: float = 0.0


def some_axis(rng: np.random.Generator, **hidden: float) -> TrueAxis:
    """Draw constants within a few per cent of what the data sheet says, and add what is hidden."""
    nominal = TrueAxis()
    return TrueAxis(
        torque_constant=nominal.torque_constant * (1.0 + 0.03 * float(np.clip(rng.standard_normal(), -2, 2))),
        inertia=nominal.inertia * (1.0 + 0.05 * float(np.clip(rng.standard_normal(), -2, 2))),
        **hidden,
    )


def voltages(drive: Drive, rng: np.random.Generator) -> list[Array]:
    """Return steps up and down of random height and length, one series per run."""
    series = []
    for _ in range(drive.runs):
        held: list[float] = []
        while len(held) < drive.samples:
            held += [float(rng.uniform(-6.0, 6.0))] * int(rng.integers(20, 70))
        series.append(np.array(held[: drive.samples]))
    return series


def run_axis(axis: TrueAxis, voltage: Array) -> Array:
    """Return the true speed at each sample, rad/s; the voltage is held in between."""
    step = SAMPLE_S / SUBSTEPS
    damping = axis.damping
    decay = math.exp(-damping / axis.inertia * step)
    held = (axis.torque_constant / axis.resistance * voltage * (1.0 - axis.sag * np.abs(voltage))).tolist()
    speed, angle = 0.0, 0.0
    seen = np.zeros(voltage.size)
    for index in range(1, voltage.size):
        for part in range(SUBSTEPS):
            now = (index - 1) * SAMPLE_S + part * step
            place = math.floor((now - axis.late) / SAMPLE_S + 1e-9)
            push = held[place] if place >= 0 else 0.0
            push += axis.cogging * math.sin(4.0 * angle) - axis.fan * speed * abs(speed)
            speed = _step(axis.dry, damping, decay, speed, push)
            angle += speed * step
        seen[index] = speed
    return seen + axis.zero


def _step(dry: float, damping: float, decay: float, speed: float, push: float) -> float:
    if speed == 0.0 and abs(push) <= dry:
        return 0.0
    sense = math.copysign(1.0, speed if speed != 0.0 else push)
    final = (push - sense * dry) / damping
    after = final + (speed - final) * decay
    return 0.0 if dry > 0.0 and after * sense < 0.0 else after


def measure_axis(axis: TrueAxis, drive: Drive, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Return (voltage, measured speed) of each run."""
    measured = []
    for voltage in voltages(drive, rng):
        speed = run_axis(axis, voltage) + drive.noise * errors(drive, voltage.size, rng)
        if drive.quantum > 0.0:
            speed = np.round(speed / drive.quantum) * drive.quantum
        measured.append((voltage, speed))
    return measured


def errors(drive: Drive, count: int, rng: np.random.Generator) -> Array:
    """Return errors of unit size: white, correlated from sample to sample, or with heavy tails."""
    if drive.kind == "heavy":
        return rng.standard_t(3, count) / math.sqrt(3.0)
    fresh = rng.standard_normal(count)
    if drive.kind != "correlated":
        return fresh
    series = np.empty(count)
    series[0] = fresh[0]
    for index in range(1, count):
        part = math.sqrt(1.0 - drive.correlation**2) * fresh[index]
        series[index] = drive.correlation * series[index - 1] + part
    return series


def table(measured: Sequence[tuple[Array, Array]]) -> str:
    """Return the runs as a CSV table."""
    lines = ["run,load [kg],voltage [V],speed [rad/s]"]
    for number, (voltage, speed) in enumerate(measured, start=1):
        lines += [f"run{number},1,{u:.6g},{w:.6g}" for u, w in zip(voltage, speed, strict=True)]
    return "\n".join(lines) + "\n"
