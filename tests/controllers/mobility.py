"""What the wheels of imagined rovers let them do."""

from dataclasses import dataclass


@dataclass
class Wheels:
    moves_sideways: bool = True
    turns_on_spot: bool = True
    turn_radius_m: float = 0.0
    crab_limit_rad: float = 0.0


OMNI = Wheels()
SKID = Wheels(moves_sideways=False)
