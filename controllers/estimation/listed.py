"""The measurements that correct the pose filter at once, in each cycle.

Fixes and frames, which come late, are led back to their exposure first: `pose_fixes` and `ground_travel`.
"""

from controllers.estimation.filter.reader import Reader
from controllers.estimation.headings.heading import HeadingReader

LISTED: tuple[Reader, ...] = (HeadingReader(),)
