"""The measurements that correct the pose filter at once, in each cycle.

Fixes and frames, which come late, are led back to their exposure first: `pose_fixes` and `ground_travel`.
"""

from controllers.estimation.measurements.heading import HeadingReader
from controllers.estimation.measurements.reader import Reader

LISTED: tuple[Reader, ...] = (HeadingReader(),)
