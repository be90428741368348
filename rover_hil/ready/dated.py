"""A result with a date, as a finding of the doctor."""

import datetime as dt

from rover_hil.doctor.finding import Finding, ok, warning

CHECK = "calibration"
OLDEST_DAYS = 365


def dated(
    device: str, date: str, today: dt.date, *, fresh: str, old: str, cause: str, command: str
) -> Finding:
    """Return what the age of a result means.

    Args:
        device: What it is of.
        date: Its date as written; one that is none, or lies ahead, counts as too old.
        today: Today.
        fresh: What it is, where it is young enough.
        old: The same where it is not.
        cause: What an old result does.
        command: What makes a new one.
    """
    try:
        age_days = (today - dt.date.fromisoformat(date)).days
    except ValueError:
        age_days = -1
    if 0 <= age_days <= OLDEST_DAYS:
        return ok(CHECK, device, fresh)
    fix = f"`{command}`; check the host's date with `date`"
    return warning(CHECK, device, f"{old}, today is {today}", f"{cause}; or one of the dates is wrong", fix)
