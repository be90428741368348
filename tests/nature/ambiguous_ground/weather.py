"""Rain and shadows: changes of brightness on the ground."""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.nature.ambiguous_ground.camera import HEIGHT, WIDTH, Camera
from tests.nature.ambiguous_ground.motion import Motion
from tests.nature.ambiguous_ground.picture import Picture, soften, uniform


class Rain:
    """Drops wet spots on the ground, that stay there, splash, and draw streaks while they fall."""

    def __init__(
        self, rng: np.random.Generator, camera: Camera, motion: Motion, drops: int, streaks: int
    ) -> None:
        self._camera, self._motion, self._streaks, self._rng = camera, motion, streaks, rng
        n = len(motion.x)
        count = drops * n
        self._born = np.repeat(np.arange(n), drops)
        u, v = rng.uniform(0, WIDTH, count), rng.uniform(0, HEIGHT, count)
        self._seen = camera.on_plane(u, v)
        self._at = np.zeros((count, 2))
        self._fallen_frames = 0
        self._radius = rng.uniform(0.002, 0.007, count)
        self._darker = rng.uniform(0.15, 0.45, count)

    def _fall(self, frame: int) -> None:
        """Drops of the frames up to this one fall where the camera is then."""
        for i in range(self._fallen_frames, frame + 1):
            new = self._born == i
            c, s = np.cos(self._motion.psi[i]), np.sin(self._motion.psi[i])
            x, y = self._seen[new].T
            self._at[new] = np.stack(
                [self._motion.x[i] + c * x - s * y, self._motion.y[i] + s * x + c * y], axis=1
            )
        self._fallen_frames = max(self._fallen_frames, frame + 1)

    def __call__(self, picture: Picture, frame: int) -> Picture:
        self._fall(frame)
        fallen = self._born <= frame
        psi = self._motion.psi[frame]
        dx, dy = (self._at[fallen] - [self._motion.x[frame], self._motion.y[frame]]).T
        c, s = np.cos(psi), np.sin(psi)
        around = np.stack([c * dx + s * dy, -s * dx + c * dy, np.zeros(len(dx))], axis=1)
        pixels = self._camera.project(around)
        far = np.linalg.norm(around - np.array(self._camera.position), axis=1)
        sizes = self._radius[fallen] * self._camera.focal / far
        darker, new = self._darker[fallen], self._born[fallen] == frame
        inside = (pixels > -20).all(axis=1) & (pixels[:, 0] < WIDTH + 20) & (pixels[:, 1] < HEIGHT + 20)
        gain = np.ones((HEIGHT, WIDTH), dtype=np.float32)
        splash = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
        for k in np.flatnonzero(inside):
            at = (round(16 * pixels[k, 0]), round(16 * pixels[k, 1]))
            radius = max(round(16 * float(sizes[k])), 10)
            cv2.circle(gain, at, radius, (1.0 - float(darker[k]),), -1, cv2.LINE_8, 4)
            if new[k]:
                cv2.circle(splash, at, 2 * radius, (60.0,), 1, cv2.LINE_8, 4)
        for _ in range(self._streaks):
            x, y = self._rng.uniform(0, WIDTH), self._rng.uniform(-20, HEIGHT)
            end = (round(x + self._rng.normal(0.0, 2.0)), round(y + self._rng.uniform(8.0, 35.0)))
            cv2.line(splash, (round(x), round(y)), end, (uniform(self._rng, 30.0, 100.0),), 1)
        return picture * soften(gain, 0.6) + soften(splash, 0.7)


@dataclass(frozen=True)
class PassingShadow:
    """A band of shadow passes over ground that stands still in the picture.

    Attributes:
        along: distance of every pixel's ground in the direction in which the shadow moves, m.
        speed: how far the shadow moves in a frame, m.
        width: width of the band, m.
        softness: width of its edges, m.
        depth: share of the light that it takes.
    """

    along: Picture
    speed: float
    width: float
    softness: float
    depth: float

    def __call__(self, picture: Picture, frame: int) -> Picture:
        run = (self.along - np.float32(self.speed * frame)) / np.float32(self.softness)
        back = run + np.float32(self.width / self.softness)
        shade = 0.5 * (np.tanh(back) - np.tanh(run))
        return np.asarray(picture * (1.0 - np.float32(self.depth) * shade), dtype=np.float32)
