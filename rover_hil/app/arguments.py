"""The arguments of the program as typed: lists behind one option, and spellings of the version before."""

from collections.abc import Sequence

from drivers.errors import ConfigError
from rover_hil.console.output import tell

LISTS = ("--test", "--logs", "--held-out")
"""Options that take several values."""
RENAMED = {
    ("compass", "--motors"): "motors",
    ("imu", "--turns"): "mounting",
    ("camera", "--scale"): "scale",
}
"""Calibrations that an option hid; `--turns` has a value and stays."""
REMOVED = {
    ("identify", "probe"): "the yaw excitation needs no fitted map: give mass_kg and body_radius_m of your "
    "rover in [slip.excitation], and run `rover-hil calibrate imu`",
}


def understood(arguments: Sequence[str]) -> list[str]:
    """Return arguments as the commands of today take them; an old spelling is reported.

    Raises:
        ConfigError: They name a command that was removed.
    """
    typed = list(arguments)
    words = tuple(typed[:2])
    if words in REMOVED:
        raise ConfigError(f"`{' '.join(words)}` was removed, {REMOVED[words]}")
    if typed[:1] == ["calibrate"]:
        typed = _renamed_calibration(typed)
    elif typed[:1] == ["tune"] and "--logs" in typed:
        typed = _tuning_by_logs(typed)
    return spread(typed)


def spread(arguments: Sequence[str]) -> list[str]:
    """Return arguments with `--test A --test B` for `--test A B`, which the library does not parse."""
    repeated: list[str] = []
    option = ""
    for argument in arguments:
        if option and not argument.startswith("-") and repeated[-1] != option:
            repeated.append(option)
        if argument.startswith("-"):
            option = argument if argument in LISTS else ""
        repeated.append(argument)
    return repeated


def _renamed_calibration(arguments: list[str]) -> list[str]:
    for (old, option), new in RENAMED.items():
        options = {argument.partition("=")[0] for argument in arguments}
        if arguments[1:2] == [old] and option in options:
            _tell_new(f"calibrate {old} {option}", f"calibrate {new}")
            is_kept = option == "--turns"
            return ["calibrate", new, *(text for text in arguments[2:] if is_kept or text != option)]
    return arguments


def _tuning_by_logs(arguments: list[str]) -> list[str]:
    """Return `tune logs CONFIG LOG...` for `tune CONFIG --logs LOG...`."""
    _tell_new("tune CONFIG --logs LOG...", "tune logs CONFIG LOG...")
    logs: list[str] = []
    others: list[str] = []
    is_log = False
    for argument in arguments[1:]:
        if argument.startswith("-"):
            is_log = argument == "--logs"
        if argument != "--logs":
            (logs if is_log else others).append(argument)
    return ["tune", "logs", *others, *logs]


def _tell_new(old: str, new: str) -> None:
    tell(f"`{old}` is now `{new}`; the old spelling will go")
