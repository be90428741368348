"""Shares with their Wilson intervals, as all tables have them."""

from scipy.stats import binomtest


def interval_percent(count: int, total: int) -> tuple[float, float]:
    """Return the Wilson interval of `count` of `total` at 95 %, in percent."""
    interval = binomtest(count, total).proportion_ci(method="wilson")
    return 100.0 * float(interval.low), 100.0 * float(interval.high)


def share_text(count: int, total: int) -> str:
    """Return the share of `count` of `total` with its interval, such as `47 % (35 to 59)`."""
    low, high = interval_percent(count, total)
    return f"{100.0 * count / total:.0f} % ({low:.0f} to {high:.0f})"
