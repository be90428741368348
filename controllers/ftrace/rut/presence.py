"""Presence of the trace: evidence along one curve, accumulated over frames."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from controllers.ftrace.parameters import PresenceParameters, SectionParameters
from controllers.ftrace.rig_geometry import Floats
from controllers.ftrace.rut.rut import two_sided


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence of the cross-sections along the best curve.

    Attributes:
        sums: Sums of the answers, one for each kernel, of variance about 1 where there is no rut.
        strength: Squared length of `sums`; about the number of kernels, 10, where there is no rut.
        neighbours: Strength of the neighbouring curves.
        floor: Difference of the ground from its surroundings like that of a rut's floor, on the weaker side.
            Without a rut below 4, except by chance, on old traces, and in shadows not estimated yet.
        answers: Answers block by block: kernel, block, the nearest first.
    """

    sums: Floats
    strength: float
    neighbours: float
    floor: float
    answers: Floats


class Background:
    """The view before the rover can have left a trace in it, like shadows of the rover.

    A part of its clearness is subtracted from that of a trace that looks alike.

    Args:
        usual_likeness: Likeness from which on a trace looks fully alike.
    """

    def __init__(self, usual_likeness: float) -> None:
        self._usual_likeness = usual_likeness
        self._count = 0
        self._clearness = 0.0
        self._sums = np.zeros(0)

    def learn(self, clearness: float, sums: Floats) -> None:
        """Take the clearness of a frame's best curve, and its sums of answers."""
        self._count += 1
        self._clearness += (clearness - self._clearness) / self._count
        self._sums = sums if self._count == 1 else self._sums + (sums - self._sums) / self._count

    def clearness_of(self, sums: Floats) -> float:
        """Return the clearness before of a view with these sums, 0 or more."""
        if self._count == 0:
            return 0.0
        alike = np.clip(_likeness(sums, self._sums) / self._usual_likeness, 0.0, 1.0)
        return float(max(self._clearness, 0.0) * alike)


class Presence:
    """Decides, frame by frame, whether the trace is present.

    A trace that was present needs less evidence than one that appears. Until the rover has moved far enough
    to leave a trace that counts, only an unmistakable trace is accepted, or one that was in view from the
    first frame on: the edge of a shadow along the direction of travel resembles a trace.

    Args:
        start_m: Distance after which a trace that counts can be in view.
        parameters: Tuned numbers.
        sections: Tuned numbers of the cross-sections.
    """

    def __init__(self, start_m: float, parameters: PresenceParameters, sections: SectionParameters) -> None:
        self._start_m = start_m
        self._parameters, self._sections = parameters, sections
        self._travelled_m = 0.0
        self._mean = np.zeros(0)
        self._margin = 0.0
        self._floor = 0.0
        self._usual = 0.0
        self._sure_m = 0.0
        self._background = Background(parameters.usual_likeness)
        self._frames = self._whole_frames = 0
        self._margins: deque[float] = deque(maxlen=parameters.lock_frames)
        self._signature = np.zeros(0)
        self.locked = False

    @property
    def signature(self) -> Floats:
        """Mean answers of the trace as a unit vector, one weight for each kernel; empty while unknown."""
        return self._signature

    @property
    def strength(self) -> float:
        """Strength of the evidence, averaged over the last distance travelled."""
        return float(self._mean @ self._mean)

    def forget(self) -> None:
        """Set the trace to absent; its signature is kept."""
        self.locked = False

    def update(self, evidence: Evidence, moved_m: float) -> bool:
        """Take the evidence of the next frame; return whether the trace is present.

        Args:
            evidence: From this frame.
            moved_m: Distance since the frame before.
        """
        numbers = self._parameters
        self._travelled_m += moved_m
        if self._mean.size == 0:
            self._mean = evidence.sums
        clearness = self._clearness(evidence)
        self._frames += 1
        self._whole_frames += clearness > numbers.start_clearness and self._is_whole(evidence)
        if self._travelled_m < self._start_m - numbers.least_length_m:
            self._background.learn(clearness, evidence.sums)
        clearer = clearness - numbers.background_share * self._background.clearness_of(evidence.sums)
        self._sure_m = float(np.clip(self._sure_m + moved_m * clearer, 0.0, numbers.most_sure_m))
        gain = max(1 - np.exp(-moved_m / numbers.memory_m), numbers.least_gain)
        self._mean = self._mean + gain * (evidence.sums - self._mean)
        self._floor += gain * (evidence.floor - self._floor)
        margin = evidence.strength - evidence.neighbours
        self._margin += gain * (margin - self._margin)
        self._margins.append(margin)
        agreement = self._agreement(evidence)
        if self.locked:
            present = self._keeps(agreement)
        else:
            present = self._locks(evidence, agreement, moved_m, clearer)
        # The first trace is as long as the distance travelled, which is known better than its far end.
        is_first = self._signature.size == 0 and self._travelled_m >= self._start_m + numbers.start_error_m
        least_m = numbers.kept_length_m if self.locked or is_first else numbers.least_length_m
        present = present and self._length_m(evidence) >= least_m
        if present:
            self._learn(evidence, agreement)
        return present

    def _keeps(self, agreement: float) -> bool:
        numbers = self._parameters
        if agreement > numbers.bare_agreement:
            return True
        is_distinct = self._margin > 0 or self._floor > numbers.again_floor
        agrees = agreement > numbers.sure_agreement or (agreement > numbers.keep_agreement and is_distinct)
        return agrees and (self._floor > numbers.mean_keep_floor or self._sure_m > numbers.sure_m)

    def _clearness(self, evidence: Evidence) -> float:
        """Return the clearness of both sides: strength over the neighbours, floor or tone, and likeness.

        It is about a logarithm of odds per metre, below 0 without a trace. Its sum is a CUSUM test.
        """
        numbers = self._parameters
        likeness = _likeness(evidence.sums, self._mean)
        strength = min(evidence.strength, self._two_sided(evidence))
        ratio = max(strength, 1.0) / (numbers.clear_ratio * (evidence.neighbours + numbers.surround))
        right, left = np.split(evidence.sums, 2)
        tone = min(abs(right[0]), abs(left[0])) if right[0] * left[0] > 0 else 0.0
        floor = np.hypot(max(evidence.floor, 0.0), tone)
        floor = numbers.floor_share * (min(float(floor), numbers.most_floor) - numbers.usual_floor)
        strong = min(float(np.log(ratio)), numbers.most_log_ratio)
        return strong + floor + min(likeness, numbers.most_likeness) - numbers.usual_likeness

    def _locks(self, evidence: Evidence, agreement: float, moved_m: float, clearer: float) -> bool:
        numbers = self._parameters
        if self._is_unmistakable(evidence) or self._was_there_before(evidence):
            return True
        if agreement > numbers.again_agreement and min(evidence.floor, self._floor) > numbers.again_floor:
            return True
        if self._travelled_m < self._start_m:
            return False
        if self._sure_m > numbers.sure_m:
            return True
        if clearer < 0 or evidence.floor < numbers.lock_floor or self._floor < numbers.mean_lock_floor:
            return False
        full = len(self._margins) == numbers.lock_frames
        far = len(self._margins) >= numbers.lock_far_frames and moved_m > numbers.memory_m
        if full and self.strength > numbers.lasting_strength:
            return True
        return (full or far) and min(self._margins) > numbers.lock_margin

    def _was_there_before(self, evidence: Evidence) -> bool:
        """Return True where a trace has filled the view since the first frame."""
        numbers = self._parameters
        is_rough = evidence.floor > numbers.start_roughness
        least_m = numbers.start_moved_m if is_rough else numbers.light_known_m
        return self._whole_frames == self._frames >= numbers.start_frames and self._travelled_m > least_m

    def _agreement(self, evidence: Evidence) -> float:
        """Return the agreement of the best stretch of blocks with the signature, in standard deviations."""
        count = evidence.answers.shape[1]
        if self._signature.size == 0 or count < self._parameters.range_blocks:
            return 0.0
        total = np.r_[0.0, np.cumsum(self._signature @ evidence.answers)]
        length = np.subtract.outer(np.arange(count + 1), np.arange(count + 1))
        sums = np.subtract.outer(total, total) / np.sqrt(np.maximum(length, 1))
        return float(sums[length >= self._parameters.range_blocks].max())

    def _length_m(self, evidence: Evidence) -> float:
        """Return the length of the trace in view, from the blocks that answer like the strongest ones."""
        numbers = self._parameters
        answer = evidence.sums @ evidence.answers / np.sqrt(max(evidence.strength, 1e-6))
        usual = max(float(np.median(np.sort(answer)[-numbers.range_blocks :])), self._usual / 2, 1.0)
        if self.locked:
            self._usual += numbers.signature_gain * (usual - self._usual)
        covered = np.clip(answer / (numbers.full_answer * usual), 0, 1)
        return float(self._sections.block_m * covered.sum()) - numbers.ends_m

    def _learn(self, evidence: Evidence, agreement: float) -> None:
        now = evidence.sums / np.sqrt(evidence.strength)
        if not self.locked and agreement < self._parameters.sure_agreement:
            self._signature = now
        signature = self._signature + self._parameters.signature_gain * (now - self._signature)
        self._signature = signature / max(float(np.linalg.norm(signature)), 1e-6)
        self._background = Background(self._parameters.usual_likeness)
        self.locked = True

    def _fills_view(self, answers: Floats) -> bool:
        """Return whether the farthest third of the view answers like the rest.

        A trace left before the drive does; the shadow of a wheel, or a trace begun in view, ends in it.
        """
        third = answers.shape[1] // 3
        if third == 0:
            return False
        near, far = answers[:, :-third].mean(axis=1), answers[:, -third:].mean(axis=1)
        mean = answers.mean(axis=1)
        return float(mean @ far) > self._parameters.full_share * float(mean @ near) > 0

    def _is_whole(self, evidence: Evidence) -> bool:
        """Return True for a trace that fills the view on both sides."""
        is_two_sided = self._two_sided(evidence) > self._parameters.start_two_sided
        return is_two_sided and self._fills_view(evidence.answers)

    def _is_unmistakable(self, evidence: Evidence) -> bool:
        numbers = self._parameters
        is_strong = evidence.strength > numbers.start_strength and evidence.floor > numbers.start_floor
        return is_strong and self._fills_view(evidence.answers)

    def _two_sided(self, evidence: Evidence) -> float:
        return float(two_sided(evidence.sums[None], self._sections.one_sided_share)[0])


def _likeness(sums: Floats, others: Floats) -> float:
    """Return the cosine of the angle between two vectors of sums."""
    lengths = float(np.linalg.norm(sums) * np.linalg.norm(others))
    return float(sums @ others) / max(lengths, 1e-6)
