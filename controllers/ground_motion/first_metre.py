"""Contradictions of ground and wheels in the first metre: camera turned, upside down, other focal length."""

from controllers.ground_motion.parameters import FirstMetreParameters

METRE_M = 1.0


class FirstMetre:
    """Compares the travel of the ground with that of the wheels. A wheel slips, it does not lag behind.

    Args:
        scale_sd: Standard deviation of the travel's factor.
        parameters: Tuned numbers.

    Attributes:
        contradiction: What contradicts the rig; "" where nothing does.
    """

    def __init__(self, scale_sd: float, parameters: FirstMetreParameters) -> None:
        self._numbers = parameters
        self._most = 1 + parameters.skid + parameters.scale_sds * scale_sd
        self._wheel_m = self._ground_m = self._against_m = self._along_m = self._across_m = 0.0
        self.contradiction = ""

    def update(self, wheel_m: float, ground_m: float, across_m: float) -> None:
        """Take the travel of a pair by the wheels, positive, and that of the ground along and across it."""
        numbers = self._numbers
        if self._wheel_m > METRE_M and not self.contradiction:
            return
        self._wheel_m += wheel_m
        self._ground_m += ground_m
        self._across_m += across_m
        self._against_m += wheel_m * (ground_m < -numbers.backwards * wheel_m)
        self._along_m += wheel_m * (ground_m > numbers.backwards * wheel_m)
        if self._wheel_m < numbers.least_travel_m:
            return
        ratio = self._ground_m / self._wheel_m
        self.contradiction = ""
        if self._against_m > numbers.least_travel_m and self._along_m < numbers.confirmed_travel_m:
            self.contradiction = "ground moves against the wheels: check that the camera is not upside down"
        elif abs(self._across_m) > max(numbers.across * self._wheel_m, abs(self._ground_m)):
            self.contradiction = "ground moves across the wheels' course: check that the camera is not turned"
        elif ratio > self._most:
            self.contradiction = (
                f"ground moves {ratio:.2f} times as far as the wheels: check focal length, height and pitch "
                "of the rig, and the wheels' radius"
            )
