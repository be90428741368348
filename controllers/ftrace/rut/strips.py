"""Evidence of the wheel's own trace, strip by strip of the ground along the path travelled.

Each strip of ground is seen in many frames while it moves through the view. The median of its cross-sections
over these views is kept, so that each strip counts once, and a shadow that passes over it, or under which it
passes, does not count. The mean of n neighbouring strips is compared with two normal distributions: of bare
ground, and of traces of all kinds. The ratio of their densities is summed over all stretches of ground in
view that may carry the trace, each with its probability before the measurement. A stretch from the wheel to
the end of the view, or to the place at which the drive began, is usual; each other end is as improbable as a
change of the ground within one strip.
"""

from dataclasses import dataclass, replace

import numpy as np

from controllers.ftrace.parameters import StripParameters
from controllers.ground_motion.ground_patch import Floats, Mask

KERNELS = 5
"""Number of kernels on each side: tone, wall, roughness, rough walls, rough floor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """The most likely stretch of trace in view.

    Attributes:
        log_odds: Logarithm of the odds of a trace against bare ground.
        length_m: Length of the stretch, 0 without one.
        fills_view: The stretch reaches the far end of the view.
        is_followed: Its strips were seen in several frames, on a known path.
        reading: Index of the curve that shows it best.
        hidden: Side of its edge that lies in the front wheel's imprint: 0 right, 1 left; None without one.
        sums: Mean answers of its strips, one for each kernel.
    """

    log_odds: float
    length_m: float
    fills_view: bool
    is_followed: bool
    reading: int
    hidden: int | None
    sums: Floats


NO_STRETCH = Stretch(
    log_odds=-np.inf,
    length_m=0.0,
    fills_view=False,
    is_followed=False,
    reading=0,
    hidden=None,
    sums=np.zeros(2 * KERNELS),
)
"""Where too little ground is in view."""


class TraceStrips:
    """Collects the views of each strip of ground.

    Args:
        s_m: Places of the blocks of the view behind the contact, evenly spaced.
        may_overlap: Whether a front wheel may have left an imprint that hides an edge of the trace.
        parameters: Tuned numbers.
    """

    def __init__(self, s_m: Floats, may_overlap: bool, parameters: StripParameters) -> None:
        self._parameters = parameters
        self._may_overlap = may_overlap
        self._s_m = s_m
        self._block_m = float(s_m[1] - s_m[0])
        self._slots = len(s_m) + 2
        self._views: Floats = np.zeros((0,))
        self._counts = np.zeros(self._slots, np.intp)
        self._names = np.full(self._slots, np.iinfo(np.int64).min)
        self._travelled_m = 0.0
        self._unseen_m = 0.0
        mirror = np.eye(KERNELS) / np.sqrt(2.0)
        self._to_even_odd: Floats = np.block([[mirror, mirror], [mirror, -mirror]])
        self._mean: Floats = np.asarray(parameters.trace_mean, np.float64)
        self._bare: Floats = np.tile(np.asarray(parameters.bare_sd, np.float64) ** 2, 2)
        self._variance: Floats = np.asarray(parameters.trace_sd, np.float64) ** 2
        # A side is even plus or minus odd part, over root 2.
        to_sides = self._to_even_odd.T
        self._one_side = to_sides @ self._mean, to_sides**2 @ self._variance

    def update(self, answers: Floats, valid: Mask, moved_m: float) -> None:
        """Take the next frame.

        Args:
            answers: Answers along the path: curve, block, kernel. The curves are different readings of the
                same ground, as of a trace alone and of one that overlaps with another.
            valid: Blocks in view, on a known path.
            moved_m: Distance along the path since the last frame.
        """
        numbers = self._parameters
        if self._views.size == 0:
            shape = (self._slots, numbers.views, len(answers), answers.shape[-1])
            self._views = np.full(shape, np.inf)
        self._travelled_m += moved_m
        self._unseen_m += moved_m
        names, place, share = self._strips(valid)
        slots = names % self._slots
        fresh = self._names[slots] != names
        self._views[slots[fresh]] = np.inf
        self._counts[slots[fresh]] = 0
        self._names[slots] = names
        is_new_view = self._unseen_m >= numbers.view_m
        take = fresh | is_new_view
        self._unseen_m = 0.0 if is_new_view else self._unseen_m
        names, place, share, slots = names[take], place[take], share[take][:, None], slots[take]
        seen = (1 - share) * answers[:, place] + share * answers[:, place + 1]
        self._views[slots, self._counts[slots] % numbers.views] = seen.transpose(1, 0, 2)
        self._counts[slots] += 1

    def stretch(self, valid: Mask, known: Mask) -> Stretch:
        """Return the most likely stretch of trace in the strips of ground.

        Args:
            valid: Blocks in view.
            known: Blocks at which the path is known.
        """
        names, _, _ = self._strips(valid & known)
        slots = names % self._slots
        seen = (self._names[slots] == names) & (self._counts[slots] > 0)
        names, slots = names[seen], slots[seen]
        if len(slots) < self._parameters.least_strips:
            return NO_STRETCH
        found = self._most_likely(self._medians(slots), int((names >= 0).sum()))
        fills_view = found.fills_view and bool(known[valid].all())
        return replace(found, fills_view=fills_view, is_followed=True)

    def stretch_at_once(self, answers: Floats, valid: Mask) -> Stretch:
        """Return the most likely stretch of trace in a single frame.

        Args:
            answers: Answers along a curve that was searched: curve, block, kernel.
            valid: Blocks in view.
        """
        if valid.sum() < self._parameters.least_strips:
            return NO_STRETCH
        laid = int((self._s_m[valid] < self._travelled_m).sum())
        found = self._most_likely(answers[:, valid], laid)
        return replace(found, log_odds=found.log_odds - self._parameters.search_cost)

    def _most_likely(self, strips: Floats, laid: int) -> Stretch:
        """Return the most likely stretch of strips (curve, strip, kernel); the first `laid` are new."""
        numbers = self._parameters
        seen = strips.shape[1]
        total = np.pad(np.cumsum(strips, axis=1), ((0, 0), (1, 0), (0, 0)))
        first, last = np.triu_indices(seen + 1, numbers.least_strips)
        count = (last - first)[:, None]
        mean = (total[:, last] - total[:, first]) / count
        is_usual_end = (last == seen) | (np.abs(last - laid) <= 1)
        changes = (first > 0).astype(np.float64) + ~is_usual_end
        whole = self._log_ratio(mean, count.astype(np.float64))
        ratio = np.asarray(np.logaddexp.reduce(whole)) + changes * numbers.log_change
        ratio[1:] -= numbers.other_reading
        greatest = float(ratio.max())
        which, best = np.unravel_index(int(ratio.argmax()), ratio.shape)
        shape = int(whole[:, which, best].argmax())
        return Stretch(
            log_odds=greatest + float(np.log(np.exp(ratio - greatest).sum())),
            length_m=float(count[best, 0]) * self._block_m,
            fills_view=int(last[best]) >= seen - 1,
            is_followed=False,
            reading=int(which),
            hidden=None if shape == 0 else shape - 1,
            sums=np.asarray(mean[which, best]),
        )

    def _log_ratio(self, mean: Floats, count: Floats) -> Floats:
        """Return the logarithm of the density of means of strips with a trace over that without one.

        The first axis is of the shapes of a trace: both edges visible, the right one hidden, the left one.
        Where the rover drifts, one edge of the rear wheel's imprint lies on the floor of the front wheel's:
        there the ground answers as if bare, and the other edge as that of any trace. Without a trace, the
        ground is bare, or an edge runs on one side of the path, as of a shadow.
        """
        numbers = self._parameters
        noise = self._bare + numbers.strip_sd**2 / (numbers.independent * count)
        parts = mean @ self._to_even_odd.T
        one_side = np.repeat([0.0, numbers.edge_sd**2], KERNELS)
        bare = _log_density(mean, noise)
        edges = [_log_density(mean, noise + side) + numbers.log_edge for side in (one_side, one_side[::-1])]
        shapes = [_log_density(parts - self._mean, noise + self._variance)]
        if self._may_overlap:
            side_mean, side_variance = self._one_side
            visible = np.repeat([0.0, 1.0], KERNELS)
            shapes += [
                _log_density(mean - side_mean * seen, noise + side_variance * seen) + numbers.log_hidden
                for seen in (visible, visible[::-1])
            ]
        return np.stack(shapes) - np.logaddexp(bare, np.logaddexp(*edges))

    def _medians(self, slots: Floats) -> Floats:
        """Return the median of the views of each strip: curve, strip, kernel."""
        views = np.sort(self._views[slots], axis=1)
        count = np.minimum(self._counts[slots], self._parameters.views)
        rows = np.arange(len(slots))
        middle = (views[rows, (count - 1) // 2] + views[rows, count // 2]) / 2
        return np.asarray(middle.transpose(1, 0, 2))

    def _strips(self, valid: Mask) -> tuple[Floats, Floats, Floats]:
        """Return the strips in view, the nearest first: number, block before, share of the next block."""
        nearest = int(np.floor((self._travelled_m - self._s_m[0]) / self._block_m - 0.5))
        names = nearest - np.arange(len(self._s_m))
        position = (self._travelled_m - (names + 0.5) * self._block_m - self._s_m[0]) / self._block_m
        place = np.floor(position).astype(np.intp)
        inside = (place >= 0) & (place < len(self._s_m) - 1)
        names, position, place = names[inside], position[inside], place[inside]
        seen = valid[place] & valid[place + 1]
        return names[seen], place[seen], (position - place)[seen]


def _log_density(values: Floats, variance: Floats) -> Floats:
    """Return the logarithm of the normal density over the last axis, without its constant."""
    return np.asarray(-0.5 * (values**2 / variance + np.log(variance) * np.ones_like(values)).sum(axis=-1))
