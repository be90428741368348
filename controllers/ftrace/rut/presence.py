"""Is that a trace? Evidence along one curve, weighed over frames."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from controllers.ftrace.rig_geometry import Floats
from controllers.ftrace.rut.rut import BLOCK_M, two_sided

LEAST_LENGTH_M = 0.20
"""A trace counts as present when at least this much of it is in view."""
START_STRENGTH, START_RATIO, START_FLOOR = 130.0, 2.5, 6.0
"""What is believed at once; against what lies beside where shadows of the rover are not told from ground."""
START_CLEARNESS = 1.7
"""How clear a trace must be that is in view when the drive begins: in all frames until it is believed."""
START_FRAMES = 2
START_MOVED_M, LIGHT_KNOWN_M = 0.01, 0.06
"""While the rover stands nothing is new; until it has moved this far, shadows look like ground."""
START_TWO_SIDED, START_ROUGHNESS = 90.0, 5.5
"""Strength on both sides that such a trace must have, and floor while shadows may be taken for tone."""
BEFORE_SHARE = 0.5
"""Share of the clearness before that is held against what looks alike: most of a shadow is taken out."""
FULL_SHARE = 0.5
"""What the farthest third of the view must answer, against the rest, where a trace fills the view."""
LOCK_MARGIN = 14.0
"""By this the strength must exceed that of curves beside, in all of the last frames, to be believed."""
LOCK_FRAMES = 5
LOCK_FAR_FRAMES = 2
"""As good as `LOCK_FRAMES` where frames are so far apart that each shows other ground."""
LASTING_STRENGTH = 46.0
"""Averaged strength that is believed even where there is as much beside, as among shadows."""
LOCK_FLOOR = 3.5
"""What the floor of a trace must show to be believed."""
MEAN_LOCK_FLOOR, MEAN_KEEP_FLOOR = 2.2, 0.5
"""The same on average, to be believed, and to stay so."""
KEEP_AGREEMENT = 3.7
BARE_AGREEMENT = 5.5
"""What keeps a trace, whatever lies beside it, where shadows of the rover are not mistaken for it."""
SURE_AGREEMENT = 6.5
AGAIN_AGREEMENT, AGAIN_FLOOR = 5.0, 1.8
"""What brings back a trace that was lost: it looks as it did, and somewhat like the floor of a rut."""
RANGE_BLOCKS = 5
SURROUND = 5.0
"""Strength that ground without any trace has about everywhere."""
SURE_M, MOST_SURE_M = 0.20, 0.45
"""Clearness summed over the way that is believed whatever it shows: a plain band of tone has no floor."""
CLEAR_RATIO, MOST_LOG_RATIO = 1.3, 1.0
"""However strong walls are, floor or tone must show as well: edges of shadows are strong."""
FLOOR_SHARE, USUAL_FLOOR, MOST_FLOOR = 0.3, 1.0, 5.0
"""Here a step in tone alike on both sides counts as well as what the floor does to texture."""
USUAL_LIKENESS, MOST_LIKENESS = 0.7, 0.9
MEMORY_M = 0.10
LOOK_GAIN = 0.1
KEPT_LENGTH_M = 0.13
"""What must be left of a trace that was there: blocks beside stones or old traces answer less."""
ENDS_M = 0.055
"""The end of the rut and the edge of the view reach into blocks that they do not fill."""
START_ERROR_M = 0.01
FULL_ANSWER = 0.75
"""A block that answers with this share of the usual strength counts as fully covered."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the cross-sections say along the best curve.

    Attributes:
        sums: Sums of the answers, one for each kernel, of variance about 1 where there is no rut.
        strength: Squared length of `sums`; about the number of kernels, 10, where there is no rut.
        around: Strength that curves beside it reach.
        floor: How much the ground differs from that beside it as the floor of a rut does, on the weaker side.
            Without a rut below 4, but for chance, old traces, and shadows not known yet.
        answers: Answers block by block: kernel, block.
    """

    sums: Floats
    strength: float
    around: float
    floor: float
    answers: Floats


class Before:
    """What is seen before the rover can have left a trace in view.

    That is none, as shadows of the rover. A part of its clearness is held against a trace that comes.
    """

    def __init__(self) -> None:
        self._count = 0
        self._clearness = 0.0
        self._sums = np.zeros(0)

    def learn(self, clearness: float, sums: Floats) -> None:
        """Take in how clear the best curve of a frame is, and its sums of answers."""
        self._count += 1
        self._clearness += (clearness - self._clearness) / self._count
        self._sums = sums if self._count == 1 else self._sums + (sums - self._sums) / self._count

    def share_in(self, sums: Floats) -> float:
        """Return how much of the clearness of these sums was there before, 0 or more."""
        if self._count == 0:
            return 0.0
        alike = np.clip(_likeness(sums, self._sums) / USUAL_LIKENESS, 0.0, 1.0)
        return float(max(self._clearness, 0.0) * alike)


class Presence:
    """Decides, frame by frame, whether the trace is there.

    A trace that was there is believed on less than one that appears. Until the rover has moved far enough to
    leave a trace that counts, only one is believed that is unmistakable or was there from the first frame on:
    a shadow's edge along the way looks like a trace.

    Args:
        start_m: Distance after which a trace that counts can be in view.
        is_light_known: Shadows of the rover are taken out of what is seen: a clear band is then a trace, also
            one that differs from the ground in tone only.
    """

    def __init__(self, start_m: float, *, is_light_known: bool) -> None:
        self._start_m = start_m
        self._is_light_known = is_light_known
        self._travelled_m = 0.0
        self._mean = np.zeros(0)
        self._margin = 0.0
        self._floor = 0.0
        self._usual = 0.0
        self._sure_m = 0.0
        self._before = Before()
        self._frames = self._whole_frames = 0
        self._margins: deque[float] = deque(maxlen=LOCK_FRAMES)
        self._look = np.zeros(0)
        self.locked = False

    @property
    def look(self) -> Floats:
        """Unit vector of what the trace shows, one weight for each kernel; empty while not known."""
        return self._look

    @property
    def strength(self) -> float:
        """Strength of the evidence, averaged over the last distance travelled."""
        return float(self._mean @ self._mean)

    def forget(self) -> None:
        """The trace is lost; what it looked like is kept."""
        self.locked = False

    def judge(self, evidence: Evidence, moved_m: float) -> bool:
        """Return whether the trace is there.

        Args:
            evidence: From this frame.
            moved_m: Distance since the frame before.
        """
        self._travelled_m += moved_m
        if self._mean.size == 0:
            self._mean = evidence.sums
        clearness = self._clearness(evidence)
        self._frames += 1
        self._whole_frames += clearness > START_CLEARNESS and _is_whole(evidence)
        if self._travelled_m < self._start_m - LEAST_LENGTH_M:
            self._before.learn(clearness, evidence.sums)
        clearer = clearness - BEFORE_SHARE * self._before.share_in(evidence.sums)
        self._sure_m = float(np.clip(self._sure_m + moved_m * clearer, 0.0, MOST_SURE_M))
        gain = max(1 - np.exp(-moved_m / MEMORY_M), 0.05)
        self._mean = self._mean + gain * (evidence.sums - self._mean)
        self._floor += gain * (evidence.floor - self._floor)
        margin = evidence.strength - evidence.around
        self._margin += gain * (margin - self._margin)
        self._margins.append(margin)
        agreement = self._agreement(evidence)
        if self.locked:
            present = self._keeps(agreement)
        else:
            present = self._locks(evidence, agreement, moved_m, clearer)
        # The first trace of a drive is as long as the way, which is known better than its far end.
        is_first = self._look.size == 0 and self._travelled_m >= self._start_m + START_ERROR_M
        least_m = KEPT_LENGTH_M if self.locked or is_first else LEAST_LENGTH_M
        present = present and self._length_m(evidence) >= least_m
        if present:
            self._learn(evidence, agreement)
        return present

    def _keeps(self, agreement: float) -> bool:
        if self._is_light_known and agreement > BARE_AGREEMENT:
            return True
        stands_out = self._margin > 0 or self._floor > AGAIN_FLOOR
        looks_alike = agreement > SURE_AGREEMENT or (agreement > KEEP_AGREEMENT and stands_out)
        is_band = self._is_light_known and self._sure_m > SURE_M
        return looks_alike and (self._floor > MEAN_KEEP_FLOOR or is_band)

    def _clearness(self, evidence: Evidence) -> float:
        """Return how clearly both sides stand out, look as before and differ from the ground.

        About a logarithm of odds for each metre, below 0 without a trace: summed, a test for change (CUSUM).
        """
        likeness = _likeness(evidence.sums, self._mean)
        strength = min(evidence.strength, float(two_sided(evidence.sums[None])[0]))
        ratio = max(strength, 1.0) / (CLEAR_RATIO * (evidence.around + SURROUND))
        right, left = np.split(evidence.sums, 2)
        tone = min(abs(right[0]), abs(left[0])) if right[0] * left[0] > 0 else 0.0
        floor = np.hypot(max(evidence.floor, 0.0), tone)
        floor = FLOOR_SHARE * (min(float(floor), MOST_FLOOR) - USUAL_FLOOR)
        strong = min(float(np.log(ratio)), MOST_LOG_RATIO)
        return strong + floor + min(likeness, MOST_LIKENESS) - USUAL_LIKENESS

    def _locks(self, evidence: Evidence, agreement: float, moved_m: float, clearer: float) -> bool:
        if _is_unmistakable(evidence) and (self._is_light_known or _is_alone(evidence)):
            return True
        if self._is_light_known and self._was_there_before(evidence):
            return True
        if agreement > AGAIN_AGREEMENT and min(evidence.floor, self._floor) > AGAIN_FLOOR:
            return True
        if self._travelled_m < self._start_m:
            return False
        if self._is_light_known and self._sure_m > SURE_M:
            return True
        if self._is_light_known and clearer < 0:
            return False
        if evidence.floor < LOCK_FLOOR or self._floor < MEAN_LOCK_FLOOR:
            return False
        full = len(self._margins) == LOCK_FRAMES
        far = len(self._margins) >= LOCK_FAR_FRAMES and moved_m > MEMORY_M
        if full and self.strength > LASTING_STRENGTH:
            return True
        return (full or far) and min(self._margins) > LOCK_MARGIN

    def _was_there_before(self, evidence: Evidence) -> bool:
        """Return whether the drive began with a trace in view, which fills it from the first frame on."""
        least_m = START_MOVED_M if evidence.floor > START_ROUGHNESS else LIGHT_KNOWN_M
        return self._whole_frames == self._frames >= START_FRAMES and self._travelled_m > least_m

    def _agreement(self, evidence: Evidence) -> float:
        """Return how well the best stretch of blocks looks like the trace before, in standard deviations."""
        count = evidence.answers.shape[1]
        if self._look.size == 0 or count < RANGE_BLOCKS:
            return 0.0
        total = np.r_[0.0, np.cumsum(self._look @ evidence.answers)]
        length = np.subtract.outer(np.arange(count + 1), np.arange(count + 1))
        sums = np.subtract.outer(total, total) / np.sqrt(np.maximum(length, 1))
        return float(sums[length >= RANGE_BLOCKS].max())

    def _length_m(self, evidence: Evidence) -> float:
        """Return the length of trace in view, from the blocks that answer like the strongest ones."""
        answer = evidence.sums @ evidence.answers / np.sqrt(max(evidence.strength, 1e-6))
        usual = max(float(np.median(np.sort(answer)[-RANGE_BLOCKS:])), self._usual / 2, 1.0)
        if self.locked:
            self._usual += LOOK_GAIN * (usual - self._usual)
        return float(BLOCK_M * np.clip(answer / (FULL_ANSWER * usual), 0, 1).sum()) - ENDS_M

    def _learn(self, evidence: Evidence, agreement: float) -> None:
        now = evidence.sums / np.sqrt(evidence.strength)
        if not self.locked and agreement < SURE_AGREEMENT:
            self._look = now
        look = self._look + LOOK_GAIN * (now - self._look)
        self._look = look / max(float(np.linalg.norm(look)), 1e-6)
        self._before = Before()
        self.locked = True


def fills_view(answers: Floats) -> bool:
    """Return whether the farthest third of the view answers like the rest.

    A trace left before the drive began does; the shadow of a wheel, or a trace begun in view, ends in it.

    Args:
        answers: Along one curve: kernel, block, the nearest first.
    """
    third = answers.shape[1] // 3
    if third == 0:
        return False
    near, far = answers[:, :-third].mean(axis=1), answers[:, -third:].mean(axis=1)
    look = answers.mean(axis=1)
    return float(look @ far) > FULL_SHARE * float(look @ near) > 0


def _is_whole(evidence: Evidence) -> bool:
    """Return whether what is seen fills the view, on both sides."""
    return fills_view(evidence.answers) and float(two_sided(evidence.sums[None])[0]) > START_TWO_SIDED


def _is_unmistakable(evidence: Evidence) -> bool:
    is_strong = evidence.strength > START_STRENGTH and evidence.floor > START_FLOOR
    return is_strong and fills_view(evidence.answers)


def _is_alone(evidence: Evidence) -> bool:
    return evidence.strength > START_RATIO * (evidence.around + SURROUND)


def _likeness(sums: Floats, others: Floats) -> float:
    """Return the cosine of the angle between two vectors of sums."""
    lengths = float(np.linalg.norm(sums) * np.linalg.norm(others))
    return float(sums @ others) / max(lengths, 1e-6)
