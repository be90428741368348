"""Every tuned number of the motion of the ground.

Lengths are in pixels of the rectified ground where matching limits them, and in shares of the view where its
size does: both hold for every height of the camera. Provenance, unless a line states another: unknown;
chosen by hand on development drives of the simulated rear scene (seeds below 1000).
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnParameters:
    """Uncertainty of the angles turned between two frames."""

    gyro_sd_rad: float = 0.001  # of an angle by the gyro
    gyro_rate_sd_rad_s: float = 0.004  # bias and noise of a small gyro, changes of the rate between samples
    free_tilt_sd_rad: float = 0.006  # of roll and pitch without a gyro
    free_turn_rate_sd_rad_s: float = 0.05  # of yaw without a gyro


@dataclass(frozen=True, slots=True, kw_only=True)
class StructureParameters:
    """Fine structure of the ground, independent of light.

    Chosen on the three drives of `trace_drives`, and on development drives of two renderers.
    """

    fine_pixels: int = 9  # differences of log grey over more than this are light
    near_pixels: int = 31  # side of the window in which the strength of the differences is measured
    grey_floor: float = 12.0  # grey levels added before the logarithm
    faintest: float = 0.01  # strength, in log grey, below which differences are noise
    clip: float = 2.5  # limit of the structure, in units of its strength: edges of shadows
    contrast: float = 40.0  # grey levels per unit in the pictures that are compared


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowParameters:
    """Points that are followed from picture to picture, and the motion that most of them share."""

    spacing_pixels: int = 14  # of the points
    coarse_spacing_pixels: int = 6  # where rays are flat: few windows have corners there
    view_points: int = 60  # three times those that must move alike: closer together where the view is small
    window_pixels: int = 15  # side of a point's window
    start_pixels: float = 6.0  # distance of two starts of the search; half of it is found from either
    most_starts: int = 6
    least_points: int = 14  # that follow the ground
    point_sd_pixels: float = 0.15  # of the motion of a point
    group_pixels: float = 0.3  # motions closer than this are alike
    other_pixels: float = 3.0  # motions farther apart are others
    pitch_pixels: float = 1.0  # spread of the points' motions by a change of pitch, of a step of the search
    most_pitch_steps: int = 6  # to either side
    rounds: int = 4  # of the robust fit
    cut: float = 3.0  # points with a greater residual have no weight; in robust standard deviations
    most_scale_pixels: float = 1.0  # greatest scatter of points that follow the ground
    inlier_weight: float = 0.2  # least weight of a point that moves with the ground
    covariance_factor: float = 1.75  # errors of points are alike; windows that overlap add to it
    overrun: float = 1.5  # greatest motion, over the wheels': beyond, points have lost the ground
    aside: float = 0.8  # greatest motion across the wheels', over theirs: slip angles of 39 deg


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidityParameters:
    """What a pair of frames must show to measure the motion.

    The number of the moving group was chosen on 14 drives of two renderers, and held on 8 others. The limits
    of the deviations were chosen on `tests/nature/sinking_drives`, seeds 1, 2 and 4.
    """

    least_moving: int = 18  # points that move in the picture, for any motion
    most_sd_pixels: float = 0.25  # of the mean motion: wrong groups scatter more, or have fewer points
    least_sd_pixels: float = 0.04  # allowed for any motion, and
    sd_share: float = 0.03  # of the motion more: passing shadows on ground that stands seem to move slowly
    still_pixels: float = 0.5  # a motion below this in the picture may be of specks and shadows
    least_still_share: float = 0.8  # of the points, for ground that does not move in the picture
    most_still_sd_pixels: float = 0.06  # of its mean motion
    creeping_pixels: float = 0.25  # a mean motion beyond this is not rest: passing shadows pull at points
    creeping_sd_pixels: float = 0.04  # of it
    clear_still_share: float = 0.5  # enough where passing shadows hide the others, and this group is sharp:
    clear_still_sd_pixels: float = 0.03  # windows on specks and ground scatter more
    most_ambiguous: float = 0.6  # points that another motion explains, over those of the motion: median of
    ambiguous_pairs: int = 5  # so many
    most_shared: float = 0.5  # of the points that move, with those that do not: two motions of one body
    baseline_pixels: float = 8.0  # frames to compare with are at least this far apart, where there are any
    coarse_baseline_pixels: float = 3.0  # where rays are flat: ground looks otherwise after some metres
    second_pixels: float = 5.0  # the same of a second one: specks pull at points that move less
    stored_pixels: float = 0.75  # least motion between two frames that are kept to compare with
    most_stored: int = 8  # of them
    most_left_out: int = 4  # frames in a row that are left out of a pair
    most_travel_share: float = 0.15  # of the view, between two frames: beyond, too little ground is shared


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatParameters:
    """Frames that are sent again, by their mean difference from the last new one."""

    same_grey: float = 0.02  # two frames that differ less are one; the noise of a camera gives more
    share: float = 0.3  # of the median of the differences before: a frame coded again differs less
    kept: int = 8  # differences
    least_own_noise: int = 2  # frames in a row with noise of their own that show that the ground stands
    most_in_a_row: int = 4  # of them, for which the pair waits
    most_undecided: int = 9  # more of them are of ground that stands


@dataclass(frozen=True, slots=True, kw_only=True)
class StandingParameters:
    """Proof that ground stands which does not move in the picture while the wheels roll."""

    frames: int = 12  # at least `least_rolled_pixels` of the wheels apart, over which the picture is averaged
    least_frames: int = 5  # for a mean that is not the picture itself
    least_rolled_pixels: float = 1.0  # by the wheels: below, both stand
    seen_pixels: float = 40.0  # of motion, before the ground is known to be visible
    lags: tuple[int, ...] = (1, 2, 4, 8)  # frames between two that are compared
    peak_sd: float = 8.0  # of a correlation of noise; the greatest of some thousand is 4 to 6


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatingGroundParameters:
    """Ground whose pattern repeats, by the correlation of a picture with itself.

    Random ground of two renderers rises to 0.27 at most, and tiles, ribs and furrows to 0.5 and more.
    """

    every: int = 10  # frames: a ground does not change its kind from one to the next
    most_lag_share: float = 0.3  # of the view; farther apart, too little is compared
    least_rise: float = 0.4  # of the correlation from its lowest value on


@dataclass(frozen=True, slots=True, kw_only=True)
class PatternParameters:
    """What is fixed in the picture while the ground moves: specks, the rover's shadow, its own parts."""

    length_pixels: float = 40.0  # motion over which it is learned
    least_strength: float = 0.8  # of the mean structure; that of ground moving through averages to less


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameOrderParameters:
    """Frames out of order, by the motion of the ground in them.

    Chosen on draws 0 to 9 of the case `swapped` of `tests/nature/ambiguous_ground`.
    """

    deviations: float = 4.0  # of the motion, for a step back
    least_share: float = 0.1  # of the wheels' travel, for a step back: smaller errors do not count
    jump: float = 0.5  # travel beyond the expected, over it, that may be of a frame out of order
    alike: float = 0.1  # difference from the expected travel, over it, after a frame out of order


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingPartsParameters:
    """Points that never move with the ground."""

    length_pixels: float = 40.0  # motion over which it is learned, as the pattern
    least_pixels: float = 1.0  # motion of a pair: points of ground that creeps fit everything
    least_seen: float = 0.8  # of the weight of that motion
    most_following: float = 0.1  # of the motion, for a point that is not of the ground
    most_share: float = 0.5  # of the points


@dataclass(frozen=True, slots=True, kw_only=True)
class RigWatchParameters:
    """Contradictions of ground and wheels that a wrong rig causes."""

    memory_m: float = 1.0  # travel of the wheels over which sums of the travels fade
    least_travel_m: float = 0.25  # of the wheels, for a ratio to their travel
    unfollowed_m: float = 0.5  # of the wheels, without any motion of the ground
    confirmed_travel_m: float = 1.0  # of the wheels, with the ground moving along: the camera is upright
    backwards: float = 0.3  # motion against the wheels', over theirs, that counts
    across: float = 0.7  # motion across the wheels', over theirs: no slope drags a rover aside so fast
    slack_m: float = 0.005  # camera and wheels are timed to some hundredths of a second, at 0.15 m/s
    # Ground travel beyond the wheels' that a rover reaches, downhill; or against it, at first: a rover that
    # slips much and is seen upside down seems to slide back slowly.
    skid: float = 0.05
    deviations: float = 3.0  # of the scale beyond that, and of the newest pair


@dataclass(frozen=True, slots=True, kw_only=True)
class MountingParameters:
    """Contradictions of near and far ground, of headings, and of the gyro that a wrong mounting causes."""

    deviations: float = 4.0  # of noise and tolerance
    scale_deviations: float = 2.0  # of the scale in rotations: one comparison in a drive, not one a pair
    aside_deviations: float = 3.0  # of the angle aside in rotations, likewise
    memory_m: float = 5.0  # travel over which sums fade
    least_travel_m: float = 0.4  # over which slopes are formed
    gyro_bias_rad_s: float = 0.002  # standard deviation about the pitch axis: 0.1 deg/s
    reversed_rad: float = 0.2  # of pitch: no camera is wrong by so much, but one that is upside down, and
    least_reversed_m: float = 0.1  # of travel show that
    least_effect: float = 0.1  # change of pitch per metre by a whole error: smaller ones show nothing
    least_turn_deg: float = 3.0  # of rotation, before that by the pictures is compared
    block_m: float = 0.25  # travel ahead over which an angle aside is formed: errors of pairs are alike
    least_blocks: float = 7.0  # four more than the fit has parameters: fewer show no scatter
    ahead: float = 0.1  # greatest motion of the wheels to the side, over that ahead, for such an angle
    least_yaw_deg: float = 1.5  # of the mounting, that counts
    unconfirmed_scale_sd: float = 0.1  # of the travel, before a rotation on the spot has confirmed it
    confirming_deg: float = 45.0  # of rotation on the spot
    on_the_spot: float = (
        0.2  # travel of the rover over that of the point below the camera, in such a rotation
    )
    gyro_scale_sd: float = 0.02
    centre_sd_m: float = 0.006  # of the point about which the rover rotates: its wheels do not slip alike


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundMotionParameters:
    """All groups."""

    turn: TurnParameters = TurnParameters()
    structure: StructureParameters = StructureParameters()
    flow: FlowParameters = FlowParameters()
    validity: ValidityParameters = ValidityParameters()
    repeating: RepeatingGroundParameters = RepeatingGroundParameters()
    pattern: PatternParameters = PatternParameters()
    repeats: RepeatParameters = RepeatParameters()
    order: FrameOrderParameters = FrameOrderParameters()
    standing: StandingParameters = StandingParameters()
    moving_parts: MovingPartsParameters = MovingPartsParameters()
    rig_watch: RigWatchParameters = RigWatchParameters()
    mounting: MountingParameters = MountingParameters()


DEFAULTS = GroundMotionParameters()
