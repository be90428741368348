"""How a page shows each kind of answer."""

from rover_hil.gap.verdict import Answer

STYLES = {
    Answer.NO_GAP: ("good", "no gap"),
    Answer.NAMED: ("good", "named"),
    Answer.NAMED_SET: ("attention", "named, with alternatives"),
    Answer.PARTLY_NAMED: ("attention", "partly named"),
    Answer.UNNAMED: ("attention", "unexplained gap"),
    Answer.NOT_IDENTIFIABLE: ("attention", "not identifiable"),
    Answer.BAD_DATA: ("bad", "bad data"),
}
"""Grade, which is a colour, and tag."""
