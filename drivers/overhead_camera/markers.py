"""Detection of square markers in an image."""

from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import Image

Corners: TypeAlias = NDArray[np.float64]


class Marker(NamedTuple):
    """A marker in the image; corners in pixels, shape (4, 2), clockwise from the printed upper left."""

    marker_id: int
    corners_px: Corners


class MarkerFinder:
    """Finds the markers of one dictionary.

    Args:
        dictionary: Name of one of OpenCV's predefined dictionaries.

    Attributes:
        marker_count: How many markers the dictionary has.
    """

    def __init__(self, dictionary: str) -> None:
        cv2.setNumThreads(1)  # more threads would take the control loop's processor from it
        self._dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
        self.marker_count = len(self._dictionary.bytesList)
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self._detector = cv2.aruco.ArucoDetector(self._dictionary, parameters)

    def find(self, image: Image) -> list[Marker]:
        """Return the markers in an image, grey or BGR."""
        corners, ids, _ = self._detector.detectMarkers(image)
        if not corners:  # `ids` is then None
            return []
        return [
            Marker(int(marker_id), np.asarray(quad, np.float64).reshape(4, 2))
            for marker_id, quad in zip(np.ravel(ids), corners, strict=True)
        ]

    def draw(self, marker_id: int, cell_px: int) -> Image:
        """Return an ideal image of a marker, its black border at the edge of the image."""
        side_px = (self._dictionary.markerSize + 2) * cell_px
        return np.asarray(cv2.aruco.generateImageMarker(self._dictionary, marker_id, side_px), np.uint8)


def centre_of(corners_px: Corners) -> tuple[float, float]:
    """Return the image of a marker's centre: the crossing of its diagonals, which perspective preserves."""
    first, second, third, fourth = corners_px
    along, across = third - first, fourth - second
    share, _ = np.linalg.solve(np.column_stack((along, -across)), second - first)
    x_px, y_px = first + share * along
    return float(x_px), float(y_px)
