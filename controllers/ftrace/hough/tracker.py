"""FTrace of the paper: edges, Hough candidates, and a fuzzy choice of the best one."""

from itertools import combinations

import cv2
import numpy as np

from controllers.ftrace.frame import Frame, Reading
from controllers.ftrace.hough.fuzzy import Candidate, confidence
from controllers.ftrace.parameters import FTraceParameters
from controllers.ground_motion.ground_patch import RESOLUTION_M, Floats
from controllers.ground_motion.ground_view import GroundView
from drivers.samples import Image

Line = tuple[float, float, float]
"""Slope dy/ds, place y at the contact (m), share of the length in view covered by edges."""


class HoughTracker:
    """Straight lines in the rectified ground, from frame to frame.

    Args:
        view: The ground in the frames.
        parameters: Tuned numbers.
    """

    def __init__(self, view: GroundView, parameters: FTraceParameters) -> None:
        ground = view.ground
        self._ground = ground
        self._parameters, self._fuzzy = parameters.hough, parameters.fuzzy
        self._inner: Image = np.asarray(
            cv2.erode(ground.visible.astype(np.uint8), np.ones((7, 7), np.uint8), borderValue=0), np.uint8
        )
        self._last: Candidate | None = None
        self._travelled_m = 0.0
        self._rows = (np.arange(ground.shape[0]) + 0.5) * RESOLUTION_M

    def track(self, frame: Frame) -> Reading:
        """Return the trace in the next frame."""
        self._travelled_m += abs(frame.travel_m)
        best, match = None, 0.0
        if frame.usable:
            best, match = self._select(self._candidates(self._edges(frame.ground.patch)))
        numbers = self._parameters
        is_start = self._travelled_m <= numbers.start_m
        accepted = numbers.accepted_at_start if is_start else numbers.accepted
        found = best is not None and match > accepted
        if found:
            self._last = best
        shown = self._last
        s = self._rows[:: len(self._rows) // 15]
        theta = None if shown is None else shown.theta_rad
        offset = 0.0 if shown is None else shown.offset_m
        return Reading(
            found=found,
            theta_rad=theta,
            theta_sd_rad=None,
            by_motion=False,
            offset_m=offset,
            confidence=match if found else 0.0,
            path_m=np.stack([s, offset - s * np.tan(theta or 0.0)], axis=1),
        )

    def lose(self) -> None:
        """Forget the last trace: the whole view is searched again, and continuity does not count."""
        self._last = None

    def _edges(self, patch: Image) -> Image:
        """Return edge pixels (255) in view, near the last trace if there is one."""
        smooth = cv2.GaussianBlur(patch, (5, 5), 1.2)
        gradient = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
        weak, strong = np.percentile(gradient[self._inner > 0], self._parameters.edge_percentiles)
        edges = np.asarray(cv2.Canny(smooth, weak, strong, L2gradient=True), np.uint8)
        edges *= self._inner
        if self._last is not None:
            middle = self._last.offset_m - self._rows * np.tan(self._last.theta_rad)
            columns = (np.arange(patch.shape[1]) - self._ground.centre) * RESOLUTION_M
            reach = self._parameters.roi_widths * self._ground.rig.wheel_width_m
            edges[np.abs(columns[None, :] - middle[:, None]) > reach] = 0
        return edges

    def _candidates(self, edges: Image) -> list[Candidate]:
        """Return the strongest edge lines, as edges and as middles of pairs."""
        lines = self._lines(edges)
        width = self._ground.rig.wheel_width_m
        found = [
            Candidate(-float(np.arctan(slope)), place + side * width / 2, None, support)
            for slope, place, support in lines
            for side in (-1.0, 0.0, 1.0)
        ]
        far = self._rows[-1] / 2
        for one, other in combinations(lines, 2):
            if abs(np.arctan(one[0]) - np.arctan(other[0])) < self._parameters.parallel_rad:
                slope = (one[0] + other[0]) / 2
                apart = abs(one[1] - other[1] + far * (one[0] - other[0])) / np.sqrt(1 + slope**2)
                place = (one[1] + other[1]) / 2
                found.append(Candidate(-float(np.arctan(slope)), place, apart, min(1.0, one[2] + other[2])))
        return found

    def _lines(self, edges: Image) -> list[Line]:
        """Return Hough lines, each fitted again, robustly, to the edge pixels near it."""
        steepest = 1.2 * self._ground.rig.max_slip_rad
        rows, columns = (place.astype(np.float64) for place in np.nonzero(edges))
        lines: list[Line] = []
        numbers = self._parameters
        if len(rows) < numbers.least_votes:
            return lines
        # OpenCV measures the angle of the line's normal from the column axis: 0 is a line along the wheel.
        for low, high in ((0.0, steepest), (np.pi - steepest, np.pi)):
            voted = cv2.HoughLines(
                edges, 1.0, numbers.angle_step_rad, numbers.least_votes, min_theta=low, max_theta=high
            )
            for rho, angle in [] if voted is None else voted.reshape(-1, 2)[: numbers.most_lines // 2]:
                start = (-np.tan(angle), rho / np.cos(angle))
                line = self._fit(rows, columns, start)
                if line is not None and not any(self._is_same(line, known) for known in lines):
                    lines.append(line)
        return lines

    def _fit(self, rows: Floats, columns: Floats, start: tuple[float, float]) -> Line | None:
        slope, place = start
        near = np.zeros(len(rows), np.bool_)
        for _ in range(self._parameters.rounds):
            near = np.abs(columns - place - slope * rows) < self._parameters.near_pixels
            if near.sum() < self._parameters.least_votes // 2:
                return None
            slope, place = np.polyfit(rows[near], columns[near], 1)
        on_line = np.clip(np.round(place + slope * np.arange(len(self._rows))), 0, self._inner.shape[1] - 1)
        in_view = self._inner[np.arange(len(self._rows)), on_line.astype(np.intp)].sum()
        support = len(np.unique(rows[near])) / max(int(in_view), self._parameters.least_votes)
        at_contact = (place - 0.5 * slope - self._ground.centre) * RESOLUTION_M
        return float(slope), float(at_contact), float(min(support, 1.0))

    def _select(self, candidates: list[Candidate]) -> tuple[Candidate | None, float]:
        rig = self._ground.rig
        best, match = None, 0.0
        for candidate in candidates:
            value = confidence(candidate, rig.wheel_width_m, rig.max_slip_rad, self._last, self._fuzzy)
            if value > match:
                best, match = candidate, value
        return best, match

    def _is_same(self, one: Line, other: Line) -> bool:
        step = np.tan(self._parameters.angle_step_rad)
        return abs(one[0] - other[0]) < step and abs(one[1] - other[1]) < 2 * RESOLUTION_M
