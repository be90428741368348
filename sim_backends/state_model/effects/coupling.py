"""Couplings between two bodies that the base model takes for one."""

from types import SimpleNamespace

import numpy as np

from sim_backends.models.interface import Array, parameter
from sim_backends.models.ranges import require_positive
from sim_backends.state_model.effects.cards import card, state, strength
from sim_backends.state_model.port_effect import PortEffect

EDGE = 0.05
"""Share of the natural play over which contact begins, so that the motion depends smoothly on the play."""
LOAD_SHARES = (0.3, 0.45, 0.6)


def two_body_backlash(
    port: str,
    *,
    inertia: str,
    load: str,
    ratio: float,
    size: float,
    impact_s: float,
    name: str = "backlash",
) -> PortEffect:
    """Return play between a driven body and its load, which flies freely while the play is crossed.

    Signal: the total torque on the driven body, without what the flying load takes; play >= 0,
    load_share 0.1 to 0.9.

    The base model takes both for one body. Contact is rigid and does not bounce. At the start the driven body
    touches the forward side, and the load is half of the play behind the middle.

    Args:
        port: Total force or torque on the driven body; friction there acts on this body alone.
        inertia: Base parameter: inertia of both bodies, in the unit of the port per unit of acceleration.
        load: Channel that measures the position of the load.
        ratio: Motion of the driven body per unit of this channel.
        size: Natural size of the play, in the unit of the driven body's position.
        impact_s: Duration of an impact, s: well below the time between samples.
        name: Of the card.
    """
    require_positive(f"effect {name}", size=size, impact_s=impact_s)
    edge = EDGE * size

    def relative(value: Array, x: SimpleNamespace, v: SimpleNamespace, own: Array) -> Array:
        """Return the acceleration of the driven body relative to the load."""
        twist, rate = own
        free = value / (state(x, inertia) * (1.0 - v.load_share))
        push = free + rate / impact_s
        front = np.clip(1.0 + twist / edge, 0.0, 1.0)
        back = np.clip(1.0 - (twist + v.play) / edge, 0.0, 1.0)
        held: Array = free - front * np.maximum(push, 0.0) - back * np.minimum(push, 0.0)
        return held

    def memory_rate(value: Array, x: SimpleNamespace, v: SimpleNamespace, own: Array) -> Array:
        twist, rate = own
        overlap = np.maximum(twist, 0.0) + np.minimum(twist + v.play, 0.0)
        return np.stack(np.broadcast_arrays(rate - overlap / impact_s, relative(value, x, v, own)))

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, own: Array | None) -> Array:
        if own is None:
            return value
        changed: Array = value + state(x, inertia) * v.load_share * relative(value, x, v, own)
        return changed

    def behind(value: Array, _: SimpleNamespace, v: SimpleNamespace, own: Array | None) -> Array:
        twist = 0.0 if own is None else own[0]
        changed: Array = value - (twist + 0.5 * v.play) / ratio
        return changed

    return PortEffect(
        port=port,
        build=card(
            name,
            "Driven body and load are coupled with play and move apart at each reversal of the force.",
            port,
            lambda units: (
                strength(
                    "play", units[load] if units[load] in ("rad", "m") else f"{units[load]} x {ratio:g}", size
                ),
                parameter("load_share", "1", 0.45, 0.15, 0.1, 0.9),
            ),
            ("shows only after the force reverses", f"{load} and the driven body move apart"),
            "reverse the force, with a sensor on both sides",
            "Nordin and Gutman 2002: controlling mechanical systems with backlash",
            {"load_share": LOAD_SHARES},
        ),
        change=change,
        memory_rate=memory_rate,
        memories=2,
        states=(inertia,),
        elsewhere={load: behind},
    )
