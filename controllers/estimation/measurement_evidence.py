"""What the measurements of a cycle offer the stop rules as evidence."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.ground.travel import GroundPair


class MeasurementEvidence(NamedTuple):
    """What became of the measurements of a cycle.

    Attributes:
        innovations: Of each measurement.
        jumped_m: By how much the positions by each device have jumped, in the local frame; without those that
            agree with the estimate.
        ground_pairs: Motions over the ground that a camera has measured.
        unexpected_m: By how much the positions by each device differ from dead reckoning, in the local frame;
            only where the expected slip does not explain it.
    """

    innovations: tuple[Innovation, ...] = ()
    jumped_m: Mapping[str, complex] = MappingProxyType({})
    ground_pairs: tuple[GroundPair, ...] = ()
    unexpected_m: Mapping[str, complex] = MappingProxyType({})
