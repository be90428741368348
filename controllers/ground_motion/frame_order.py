"""Whether frames come in the order in which they were taken, by the motion of the ground in them.

Two frames that have changed places show ground that goes back for one frame while the wheels roll on, beside
steps of about twice the travel. A rover that slides back does so for more than one frame. Where all frames
have changed places in pairs, every second one is used: between two of them the ground has moved as far as it
should have by their times, where the speed is steady.
"""

from enum import Enum, auto

from controllers.ground_motion.parameters import FrameOrderParameters

OUT_OF_ORDER = "frames are out of order, or the rover jerks: the ground goes back or ahead for one frame"


class Order(Enum):
    """What to do with a frame.

    Attributes:
        RIGHT: Use it.
        UNDECIDED: Leave it out; the pair stays open, and the next frames decide.
        WRONG: The frame at which the pair began is from a later time, and this one is perhaps not: the pair
            is not valid, begin another.
    """

    RIGHT = auto()
    UNDECIDED = auto()
    WRONG = auto()


class FrameOrder:
    """Follows the ground from frame to frame of an open pair, and the share of the wheels' travel.

    Args:
        parameters: Tuned numbers.
    """

    def __init__(self, parameters: FrameOrderParameters) -> None:
        self._numbers = parameters
        self._share: float | None = None
        self._ahead_share: float | None = None
        self.begin()

    def begin(self) -> None:
        """Begin a pair."""
        self._along_m = self._wheel_m = 0.0
        self._went_back = self._is_mixed = self._began_ahead = self._is_held = False

    def judge(self, along_m: float, wheel_m: float, sd_m: float) -> Order:
        """Return what to do with a frame.

        Args:
            along_m: Motion of the ground since the pair began, along that of the wheels.
            wheel_m: Travel of the wheels since then.
            sd_m: Standard deviation of the motion.
        """
        numbers = self._numbers
        step_m, rolled_m = along_m - self._along_m, wheel_m - self._wheel_m
        self._along_m, self._wheel_m = along_m, wheel_m
        if rolled_m <= 0.0:
            return Order.RIGHT
        slack_m = numbers.deviations * sd_m + numbers.least_share * rolled_m
        went_back, self._went_back = self._went_back, step_m < -slack_m
        if self._went_back:
            if went_back or (self._share is not None and self._share < 0.0):
                return Order.RIGHT
            self._is_mixed = True
            self._began_ahead |= along_m < -slack_m
            return Order.UNDECIDED
        if self._began_ahead:
            return self._by_pair_before(along_m, wheel_m, slack_m)
        return self._by_travel(along_m, wheel_m, slack_m)

    def use(self, along_m: float, wheel_m: float) -> None:
        """Take the motion of a pair that is used."""
        if wheel_m > 0.0:
            self._share = along_m / wheel_m

    def _by_pair_before(self, along_m: float, wheel_m: float, slack_m: float) -> Order:
        """Compare the share of the wheels' travel with that of the pair before, even of one that was wrong.

        Two pairs in a row that begin with a later frame are alike only where each ends with a later one, too.
        """
        before = [share for share in (self._share, self._ahead_share) if share is not None]
        self._ahead_share = along_m / wheel_m
        is_right = any(self._is_alike(along_m, share * wheel_m, slack_m) for share in before)
        return Order.RIGHT if is_right else Order.WRONG

    def _is_alike(self, along_m: float, expected_m: float, slack_m: float) -> bool:
        return abs(along_m - expected_m) < self._numbers.alike * abs(expected_m) + slack_m

    def _by_travel(self, along_m: float, wheel_m: float, slack_m: float) -> Order:
        """Compare the share of the wheels' travel with that of the pair before."""
        if self._share is None:
            return Order.RIGHT
        numbers, expected_m = self._numbers, self._share * wheel_m
        if self._is_mixed:
            is_alike = self._is_alike(along_m, expected_m, slack_m)
            return Order.RIGHT if is_alike else Order.UNDECIDED
        if self._is_held or along_m < (1.0 + numbers.jump) * expected_m + slack_m:
            return Order.RIGHT
        self._is_held = True
        return Order.UNDECIDED
