"""How a page shows each kind of answer."""

from rover_hil.gap.verdict import Answer

GRADES = {
    Answer.NO_GAP: "good",
    Answer.NAMED: "good",
    Answer.NAMED_SET: "attention",
    Answer.PARTLY_NAMED: "attention",
    Answer.UNNAMED: "attention",
    Answer.NOT_IDENTIFIABLE: "attention",
    Answer.BAD_DATA: "bad",
}
TAGS = {
    Answer.NO_GAP: "no gap",
    Answer.NAMED: "named",
    Answer.NAMED_SET: "named, with alternatives",
    Answer.PARTLY_NAMED: "partly named",
    Answer.UNNAMED: "unexplained gap",
    Answer.NOT_IDENTIFIABLE: "not identifiable",
    Answer.BAD_DATA: "bad data",
}
