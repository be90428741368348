"""An effect at a named port: how it changes the signal there."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import SimpleNamespace
from typing import TypeAlias

from sim_backends.models.interface import Array, EffectCard

Change: TypeAlias = Callable[[Array, SimpleNamespace, SimpleNamespace, Array | None], Array]
"""Signal, machine, parameters of the effect, its own state -> changed signal.

The machine holds states, inputs, base parameters and conditions. For an input or a channel it is empty.
"""
MemoryRate: TypeAlias = Callable[[Array, SimpleNamespace, SimpleNamespace, Array], Array]
"""The same arguments -> rate of the effect's own state."""


class Action(Enum):
    """What an effect does with the signal at its port."""

    CHANGE = "change"
    DELAY = "delay"
    LAG = "lag"
    PLAY = "play"
    RELEASE = "release"


@dataclass(frozen=True, slots=True, kw_only=True)
class PortEffect:
    """An effect, and the port where it acts.

    Attributes:
        port: Name of a port, an input or a channel; of a parameter for `Action.RELEASE`.
        build: Makes the card; its argument maps states, inputs, ports and channels to their units.
        action: `CHANGE` calls `change`; `DELAY` and `LAG` shift or smooth an input or a channel by the
            effect's first parameter, in seconds; `PLAY` lets it follow only when it has crossed the first
            parameter to either side; `RELEASE` adds the first parameter to a base parameter.
        change: Of the signal. At the nominal parameters it must return the signal as it is.
        memory_rate: Rate of own states that begin at 0; None for an effect without.
        memories: Number of own states; with more than one they are stacked on the first axis.
        states: States and base parameters that `change` reads.
        elsewhere: Further ports, inputs or channels, and how the effect changes the signal there.
    """

    port: str
    build: Callable[[Mapping[str, str]], EffectCard]
    action: Action = Action.CHANGE
    change: Change | None = None
    memory_rate: MemoryRate | None = None
    memories: int = 1
    states: tuple[str, ...] = ()
    elsewhere: Mapping[str, Change] = field(default_factory=dict)
