"""The measurements that correct the pose filter at once, in each cycle.

Positions and frames, which come late, are led back to their exposure first: `positions` and `ground`.
"""

from controllers.estimation.filter.reader import Reader
from controllers.estimation.headings.heading import HeadingReader

LISTED: tuple[Reader, ...] = (HeadingReader(),)
