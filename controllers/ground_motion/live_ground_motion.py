"""The motion over the ground in the frames of a running rover."""

from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion, Rates, WheelPrior
from controllers.ground_motion.pair_sum import PairSum
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from controllers.ground_motion.settings import GroundMotionSettings
from drivers.camera.settings import CameraSettings
from drivers.clock import seconds
from drivers.errors import ConfigError
from drivers.samples import FrameSample


class LiveGroundMotion:
    """Feeds the estimator of the motion over the ground; never raises on a frame.

    Args:
        settings: Calibration of the camera and what is not known about it.
        camera: The camera of the rig.
        rotates_about_origin: As of `GroundMotionEstimator`.

    Attributes:
        pairs: The motion that is measured, for others that need it in these frames.

    Raises:
        ConfigError: The camera does not see the ground, or its frames have another size.
    """

    def __init__(
        self, settings: GroundMotionSettings, camera: CameraSettings, *, rotates_about_origin: bool
    ) -> None:
        rig = settings.rig
        conflict = rig.size_conflict(camera.width, camera.height)
        if conflict:
            raise ConfigError(conflict)
        geometry = rig.geometry()
        self.pairs = PairSum(
            GroundView(GroundPatch(geometry)), settings.tolerance, rotates_about_origin=rotates_about_origin
        )
        self._shape = (rig.image.height, rig.image.width)
        self._before_ns: int | None = None
        self._rates_rad_s: Rates | None = None
        x_m, y_m = geometry.point_m
        self._point_m = (float(x_m), float(y_m))

    @property
    def point_m(self) -> tuple[float, float]:
        """The point of the vehicle whose motion is measured, forward and left."""
        return self._point_m

    @property
    def from_ns(self) -> int | None:
        """Time of the frame at which the next pair begins; None before the first."""
        return self.pairs.estimator.from_ns

    def measure(self, frame: FrameSample, t_ns: int, prior: WheelPrior) -> GroundMotion | None:
        """Return the motion since the frame before; None for the first frame and one of another size."""
        before_ns = self._before_ns
        if frame.image.shape[:2] != self._shape or (before_ns is not None and t_ns <= before_ns):
            return None
        dt_s = 0.0 if before_ns is None else seconds(t_ns - before_ns)
        angles, deviations = turned(prior.rates_rad_s, self._rates_rad_s, dt_s, DEFAULTS.turn)
        has_gyro = prior.rates_rad_s is not None and self._rates_rad_s is not None
        self._before_ns, self._rates_rad_s = t_ns, prior.rates_rad_s
        return self.pairs.measure(
            t_ns,
            self.pairs.view.look(frame.image),
            MotionPrior(
                forward_m=prior.forward_m,
                left_m=prior.left_m,
                turn_rad=angles,
                turn_sd_rad=deviations,
                has_gyro=has_gyro,
            ),
        )
