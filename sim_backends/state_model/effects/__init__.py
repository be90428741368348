"""Standard effects, each attached to a port of a model in one line.

from rover_hil.gap import effects
port_effects = (effects.coulomb_friction("torque", velocity="rate", size=0.1, slow=0.01), ...)
"""

from sim_backends.state_model.effects.coupling import two_body_backlash
from sim_backends.state_model.effects.forces import (
    asymmetric_friction,
    cogging,
    coulomb_friction,
    cubic_stiffness,
    end_stop,
    presliding,
    quadratic_drag,
    stribeck_friction,
    viscous_friction,
)
from sim_backends.state_model.effects.scatter import scattering
from sim_backends.state_model.effects.signals import (
    backlash,
    dead_zone,
    delay,
    gain_error,
    lag,
    offset,
    overflow,
    play,
    quantisation,
    saturation,
    supply_sag,
    wrong_parameter,
)
from sim_backends.state_model.effects.terms import product, term, threshold

__all__ = [
    "asymmetric_friction",
    "backlash",
    "cogging",
    "coulomb_friction",
    "cubic_stiffness",
    "dead_zone",
    "delay",
    "end_stop",
    "gain_error",
    "lag",
    "offset",
    "overflow",
    "play",
    "presliding",
    "product",
    "quadratic_drag",
    "quantisation",
    "saturation",
    "scattering",
    "stribeck_friction",
    "supply_sag",
    "term",
    "threshold",
    "two_body_backlash",
    "viscous_friction",
    "wrong_parameter",
]
