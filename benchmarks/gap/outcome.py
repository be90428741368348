"""What the battery of hidden effects keeps of each case, one line of JSON each."""

import hashlib
from dataclasses import asdict
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from benchmarks.gap.cases import Case
from benchmarks.gap.peers import ask_peers
from rover_hil.gap.findings import Analysis
from tests.nature.side_slope import Nature

FROZEN = (
    "rover_hil/gap/**/*.py",
    "sim_backends/models/side_slope/*.py",
    "benchmarks/gap/cases.py",
    "tests/nature/side_slope.py",
)
HARM = 1.02
"""Error after the correction, over that before, that is worse."""
ROOT = Path(__file__).parents[2]


class Number(BaseModel):
    """A parameter of an effect."""

    value: float
    low: float
    high: float


class Channel(BaseModel):
    """A channel on the locked runs."""

    before: float
    after: float
    floor: float
    closure: float | None
    is_worse: bool


class Outcome(BaseModel):
    """A case, what was said, and by whom."""

    model_config = ConfigDict(frozen=True)

    code: str
    number: int
    kind: str
    names: tuple[str, ...]
    snr: float
    noise: str
    nature: dict[str, float]
    verdict: str
    p_gap: float | None
    p_left: float | None
    explained: float
    confidence_set: tuple[tuple[str, ...], ...]
    effects: dict[str, dict[str, Number]]
    channels: dict[str, Channel]
    closure: float | None
    peers: dict[str, tuple[str, ...]]
    seconds: float

    @property
    def is_named(self) -> bool:
        """Return whether effects were named."""
        return self.verdict in ("NAMED", "NAMED_SET", "PARTLY_NAMED")

    @property
    def holds_truth(self) -> bool:
        """Return whether one member of the set has all that is hidden."""
        return any(set(self.names) <= set(one) for one in self.confidence_set)

    @property
    def is_exact(self) -> bool:
        """Return whether the set says what is hidden and nothing else."""
        return [set(one) for one in self.confidence_set] == [set(self.names)]

    @property
    def is_wrong(self) -> bool:
        """Return whether a single name was given with confidence that is not hidden."""
        return self.verdict == "NAMED" and not set(self.confidence_set[0]) <= set(self.names)


def keep(case: Case, nature: Nature, analysis: Analysis) -> Outcome:
    """Return what is kept of an analysis."""
    verdict, machine = analysis.verdict, analysis.machine
    holdout = None if machine is None else machine.holdout
    return Outcome(
        code=code_hash(),
        number=case.seed,
        kind=case.kind,
        names=case.names,
        snr=case.snr,
        noise=case.noise,
        nature=asdict(nature),
        verdict=str(verdict.verdict),
        p_gap=verdict.p_gap,
        p_left=None if machine is None else machine.p_remaining,
        explained=0.0 if machine is None else machine.share,
        confidence_set=tuple(tuple(one) for one in verdict.confidence_set),
        effects={
            effect.name: {
                name: Number(value=one.value, low=one.ci95[0], high=one.ci95[1])
                for name, one in effect.parameters.items()
            }
            for effect in verdict.effects
        },
        channels={}
        if holdout is None
        else {
            name: Channel(
                before=one.before,
                after=one.after,
                floor=one.noise_floor,
                closure=one.closure,
                is_worse=one.after > HARM * max(one.before, one.noise_floor),
            )
            for name, one in holdout.channels.items()
        },
        closure=None if holdout is None else holdout.closure,
        peers=ask_peers(machine) if machine is not None else {},
        seconds=verdict.seconds,
    )


def code_hash() -> str:
    """Return a hash of everything the outcome depends on."""
    digest = hashlib.sha256()
    for pattern in FROZEN:
        for path in sorted(ROOT.glob(pattern)):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def read_outcomes(path: Path) -> list[Outcome]:
    """Return the outcomes of a results file; a last line that was cut off is left out."""
    if not path.exists():
        return []
    lines = path.read_text("utf-8").splitlines(keepends=True)
    return [Outcome.model_validate_json(line) for line in lines if line.endswith("\n")]
