"""The wheels of a recorded drive as a CAN bus: a mapping, its DBC file, and frames with exact numbers."""

import struct
from collections.abc import Sequence
from pathlib import Path

from drivers.can.frame import CanFrame, pack_can_frame

QUANTITIES = {
    "Position": ("rad", 0x100),
    "Speed": ("rad/s", 0x140),
    "Current": ("A", 0x180),
    "Steering": ("rad", 0x1C0),
}
"""Unit, and number of the message of the first wheel."""
DOUBLE = struct.Struct("<d")


def write_mapping(
    folder: Path, wraps_rad: Sequence[float | None], quantities: tuple[str, ...], signs: tuple[int, ...]
) -> Path:
    """Write the mapping of a bus with a message for each quantity of each wheel, and its DBC file.

    Args:
        folder: Where to.
        wraps_rad: After which angle the position of each wheel wraps; None where it does not.
        quantities: Out of `QUANTITIES`.
        signs: -1 for a wheel that counts backwards, one per wheel, or none.
    """
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: Rover Host", ""]
    types = []
    for name in quantities:
        unit, first = QUANTITIES[name]
        for wheel in range(len(wraps_rad)):
            lines.append(f"BO_ {first + wheel} Wheel{wheel}_{name}: 8 Rover")
            lines.append(f' SG_ {name} : 0|64@1- (1,0) [0|0] "{unit}" Host')
            lines.append("")
            types.append(f"SIG_VALTYPE_ {first + wheel} {name} : 2;")
    (folder / "bag.dbc").write_text("\n".join([*lines, *types]) + "\n", "utf-8")
    mapping = ['dbc = "bag.dbc"']
    for wheel, wrap_rad in enumerate(wraps_rad):
        mapping += ["", "[[wheel]]", f"node = {wheel}"]
        mapping += [f"sign = {signs[wheel]}"] if signs else []
        for name in quantities:
            signal = f'message = "Wheel{wheel}_{name}", signal = "{name}", unit = "{QUANTITIES[name][0]}"'
            wrap = f", wrap = {wrap_rad!r}" if name == "Position" and wrap_rad is not None else ""
            mapping.append(f"{name.lower()} = {{ {signal}{wrap} }}")
    path = folder / "bag.toml"
    path.write_text("\n".join(mapping) + "\n", "utf-8")
    return path


def wheel_frame(quantity: str, wheel: int, value: float) -> bytes:
    """Return the frame with one number of one wheel."""
    return pack_can_frame(CanFrame(QUANTITIES[quantity][1] + wheel, DOUBLE.pack(value), False))
