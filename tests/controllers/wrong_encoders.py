"""Encoders that count wrongly, for tests and benchmarks."""

from dataclasses import replace

from drivers.samples import Sample, WheelSample


class WrongEncoders:
    """Positions that go on with a factor: -1 for reversed, 0 for stuck.

    Args:
        factor: Of the angle turned since the first falsified sample.
        wheels: Which wheels; None for all.
    """

    def __init__(self, factor: float, wheels: tuple[int, ...] | None = None) -> None:
        self._factor = factor
        self._wheels = wheels
        self._begin_rad: dict[int, float] = {}

    def __call__(self, sample: Sample) -> Sample:
        """Return the falsified sample."""
        if not isinstance(sample, WheelSample) or sample.position_rad is None:
            return sample
        if self._wheels is not None and sample.wheel not in self._wheels:
            return sample
        begin_rad = self._begin_rad.setdefault(sample.wheel, sample.position_rad)
        return replace(sample, position_rad=begin_rad + self._factor * (sample.position_rad - begin_rad))
