"""Names of the faults of VESC motor controllers.

Source: `mc_fault_code` in bldc `datatypes.h`, firmware 6.
"""

_NAMES = (
    "none",
    "over voltage",
    "under voltage",
    "gate driver",
    "absolute over current",
    "over temperature of the transistors",
    "over temperature of the motor",
    "over voltage of the gate driver",
    "under voltage of the gate driver",
    "under voltage of the processor",
    "restarted by its own watchdog",
    "encoder does not answer",
    "sine-cosine encoder below its amplitude",
    "sine-cosine encoder above its amplitude",
    "flash memory corrupt",
    "offset of current sensor 1",
    "offset of current sensor 2",
    "offset of current sensor 3",
    "unbalanced currents",
    "brake input",
    "resolver: loss of tracking",
    "resolver: degradation of signal",
    "resolver: loss of signal",
    "app configuration corrupt",
    "motor configuration corrupt",
    "encoder without magnet",
    "magnet of the encoder too strong",
    "phase filter",
    "encoder fault",
    "output of the low-voltage supply",
)


def fault_name(code: int) -> str:
    """Return the name of a fault; its number where it is not known."""
    return _NAMES[code] if code < len(_NAMES) else f"fault {code}"
