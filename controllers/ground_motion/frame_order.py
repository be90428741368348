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
        self._newest_share: float | None = None
        self._is_left_out = False
        self.begin()

    def begin(self) -> None:
        """Begin a pair, perhaps with a frame that was left out."""
        self._along_m = self._wheel_m = 0.0
        self._went_back = self._began_ahead = self._is_held = False
        self._is_mixed, self._is_left_out = self._is_left_out, False
        self._before_share = self._newest_share

    def judge(self, along_m: float, wheel_m: float, sd_m: float) -> Order:
        """Return what to do with a frame.

        Args:
            along_m: Motion of the ground since the pair began, along that of the wheels.
            wheel_m: Travel of the wheels since then.
            sd_m: Standard deviation of the motion.
        """
        order = self._judge(along_m, wheel_m, sd_m)
        self._is_left_out = order is Order.UNDECIDED
        return order

    def _judge(self, along_m: float, wheel_m: float, sd_m: float) -> Order:
        numbers = self._numbers
        step_m, rolled_m = along_m - self._along_m, wheel_m - self._wheel_m
        self._along_m, self._wheel_m = along_m, wheel_m
        if rolled_m <= 0.0:
            return Order.RIGHT
        slack_m = numbers.deviations * sd_m + numbers.least_share * rolled_m
        went_back, self._went_back = self._went_back, step_m < -slack_m
        self._newest_share = None if self._went_back else along_m / wheel_m
        if self._went_back:
            if went_back or (self._share is not None and self._share < 0.0):
                return Order.RIGHT
            self._is_mixed = True
            self._began_ahead |= along_m < -slack_m
            return Order.UNDECIDED
        if self._began_ahead or self._is_mixed:
            otherwise = Order.WRONG if self._began_ahead else Order.UNDECIDED
            return Order.RIGHT if self._is_alike(along_m, wheel_m, slack_m) else otherwise
        return self._by_travel(along_m, wheel_m, slack_m)

    def use(self, along_m: float, wheel_m: float) -> None:
        """Take the motion of a pair that is used."""
        if wheel_m > 0.0:
            self._share = along_m / wheel_m

    def _is_alike(self, along_m: float, wheel_m: float, slack_m: float) -> bool:
        """Return whether the share is that of the last pair that was used, or of the one before this.

        Two pairs in a row, without a step back between them, are alike where all their frames are in order;
        two that begin with a later frame where each ends with a later one, too.
        """
        before_m = [share * wheel_m for share in (self._share, self._before_share) if share is not None]
        return any(abs(along_m - each) < self._numbers.alike * abs(each) + slack_m for each in before_m)

    def _by_travel(self, along_m: float, wheel_m: float, slack_m: float) -> Order:
        """Compare the share of the wheels' travel with that of the pair before."""
        if self._share is None:
            return Order.RIGHT
        numbers, expected_m = self._numbers, self._share * wheel_m
        if self._is_held or along_m < (1.0 + numbers.jump) * expected_m + slack_m:
            return Order.RIGHT
        self._is_held = True
        return Order.UNDECIDED
