"""The verdict that a sensible person expects, by the documents alone."""

HIDDEN, SHOWN = 0.7, 1.3
"""The default tolerance is the noise: below the first an effect is no gap, above the second it is one."""
FEWEST, FEW = 4, 6
"""Fewer series give BAD_DATA; fewer runs than the second may not prove a name."""


def expected(kind: str, runs: int, ratio: float, alike: tuple[str, ...] = ()) -> tuple[str, list[str], str]:
    """Return the expected verdict, all that are accepted, and the reason."""
    if runs < FEWEST:
        return "BAD_DATA", ["BAD_DATA", "NOT_IDENTIFIABLE"], "fewer than four runs"
    if kind == "none":
        return "NO_GAP", ["NO_GAP"], "nothing is hidden; the base parameters are within their priors"
    if ratio < HIDDEN:
        return "NO_GAP", ["NO_GAP"], "what remains after a fit is below the tolerance, the sensor noise"
    if ratio < SHOWN:
        free = ["NO_GAP", "NOT_IDENTIFIABLE", "UNNAMED", "PARTLY_NAMED"]
        named = [] if kind == "outside" else ["NAMED", "NAMED_SET"]
        return "NO_GAP", free + named, "what remains after a fit is about as large as the tolerance"
    if kind == "outside":
        return "UNNAMED", ["UNNAMED", "PARTLY_NAMED"], "the law is not in the list"
    if runs < FEW:
        weak = ["NAMED_SET", "NAMED", "NOT_IDENTIFIABLE", "UNNAMED"]
        return "NAMED_SET", weak, "fewer than six runs"
    if alike:
        return "NAMED_SET", ["NAMED_SET", "NAMED"], f"the runs do not separate it from {', '.join(alike)}"
    return "NAMED", ["NAMED", "NAMED_SET"], "listed, visible, and separate from every other listed effect"
