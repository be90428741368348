"""Every tuned number of FTrace.

Provenance, unless a group or a line states another: unknown; chosen by hand on development drives of the
simulated rear scene (seeds below 1000). Units are in the names; other numbers are ratios. A result's
sensitivity to each number is printed by `python -m benchmarks.sensitivity ftrace`.
"""

from dataclasses import dataclass
from math import log, radians

from controllers.ground_motion.parameters import DEFAULTS as GROUND_MOTION
from controllers.ground_motion.parameters import GroundMotionParameters, PatternParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameParameters:
    """Frames that show nothing are not used; grey levels are 0 to 255."""

    darkest_grey: int = 6  # least median
    brightest_grey: int = 250  # a pixel from here on is burnt out
    most_burnt: float = 0.7  # greatest share of burnt-out pixels
    least_contrast: float = 3.0  # least standard deviation of the grey levels


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionParameters:
    """Direction of the wheel by the motion of the ground."""

    most_direction_sd_rad: float = 0.05  # of a direction that is given without a trace
    rig_sd_rad: float = 0.006  # of an angle, by what no innovation shows: calibration of the camera, tilt
    least_motion_m: float = 0.003  # between two frames, for a direction that is given without a trace
    reach_m: float = 0.12  # frames further apart share too little ground: they are matched first
    least_share: float = 0.3  # of the points that must move with the ground in matched frames
    slip_guess: float = 0.15  # expected slip where the ground's motion is not measured
    straight: float = 0.02  # greatest motion of the wheel aside by a rotation, over that ahead: 1.1 deg
    motion_sd_m: float = 0.0002  # least standard deviation of a motion
    backwards_share: float = 0.3  # motion against the wheel's, over the wheel's, that counts as backwards
    backwards_gain: float = 0.05  # of the mean share of such frames, per frame
    most_backwards: float = 0.04  # greatest mean share, exceeded by frames that are upside down


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchingParameters:
    """Search for the ground of the last frame in a frame with little overlap."""

    length_m: float = 0.16  # of the template
    half_width_m: float = 0.16  # of the template
    least_seen: float = 0.97  # share of a row of the template that is in view
    shortest: float = 0.5  # least distance moved, over the wheel's: slip
    longest: float = 1.15  # greatest distance moved, over the wheel's: errors of scale
    least_correlation: float = 0.35
    least_lead: float = 0.08  # over every other place: grouser prints and bricks repeat
    same_place_m: float = 0.020  # places closer than this are the same


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadingParameters:
    """Shadows of the rover, which do not move in the image."""

    step_m: float = 0.008  # least travel between frames that are compared: half of that at 0.08 m/s, 5 Hz
    gain: float = 0.3  # of one comparison
    leak: float = 0.002  # lost per comparison
    baselines_m: tuple[float, float] = (0.04, 0.09)  # in turn: for sharp edges, for wide shadows
    past_m: float = 0.19  # frames are compared with those of this travel before
    most_difference: float = 0.6  # of log grey; greater ones are mismatched edges
    least_pixels: int = 250  # that two frames must share
    steepest: float = 1.0  # greatest slope of the ground's motion across the image
    lit_share: float = 0.75  # share of each line along the motion that may be darker than lit ground


LONG_PATTERN = PatternParameters(length_pixels=125.0)
"""0.5 m: with 0.15 m traces that are driven straight are missed twice as often."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedParameters:
    """What is fixed in the picture. Chosen on seeds 10 to 12 of `tests/nature/ground_drives`."""

    pattern: PatternParameters = LONG_PATTERN
    known_m: float = 0.06  # least travel over which the mean is taken


@dataclass(frozen=True, slots=True, kw_only=True)
class SectionParameters:
    """Cross-sections of the ground, block by block."""

    block_m: float = 0.04  # length of a block
    light_m: float = 0.5  # brightness that varies more slowly is light, not rut
    kernel_reach: float = 2.0  # half widths of the wheel that a kernel covers on either side
    softness: float = 0.12  # of a kernel's edges, in half widths
    least_weight: float = 0.5  # share of a block that must be in view
    clip: float = 2.5  # limit of an answer, in standard deviations: no stone decides alone
    energy_floor: float = 0.5  # of the gradients of the fine structure, before the logarithm
    texture_m: tuple[float, float] = (0.012, 0.044)  # window of the roughness, along and across
    least_blocks: int = 4  # that a curve must have in view
    one_sided_share: float = 0.3  # weight of evidence on one side only: walls may be lit from one side
    near_m: float = 0.016  # the place of a block's rut is searched this near to the curve
    alike: float = 0.45  # a block shows the rut when it answers with this share of the better blocks
    least_peak: float = 1.3  # and at least with this many standard deviations
    point_sd_m: float = 0.004  # of the place of a block at `usual_peak`
    usual_peak: float = 2.5  # standard deviations
    faintest_peak: float = 0.6  # standard deviations; fainter peaks count as this
    point_sd_range: tuple[float, float] = (0.7, 3.0)  # limits of the factor on `point_sd_m`


@dataclass(frozen=True, slots=True, kw_only=True)
class PathParameters:
    """Filter of the path travelled."""

    node_m: float = 0.012  # distance between remembered points
    substep_m: float = 0.02  # longest step of the prediction
    slope_sd: float = 0.2  # of dy/ds at start
    curvature_sd_1_m: float = 0.7  # as by a slip angle of 10 deg that comes and goes within half a metre
    curvature_length_m: float = 0.25  # correlation length of the curvature
    row_sd_m: float = 0.0005  # of each point at start
    beside_sd_m: float = 0.006  # of the distance of the trace from the path
    beside_length_m: float = 1.0  # its correlation length


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchParameters:
    """Search for the curve of the trace, and its use as a measurement."""

    offset_sd_m: float = 0.002  # common error of all points of a frame
    slope_sd: float = 0.01  # common error of their slope
    point_sd_factor: float = 2.5  # errors of points are correlated, also from frame to frame
    outlier_sd: float = 1.5  # points further off get less weight
    candidate_sd_m: float = 0.006  # common uncertainty of all places of a candidate
    curve_step_m: float = 0.006  # between candidates
    spread_sd: float = 2.2  # candidates cover this many standard deviations
    most_steps: tuple[int, int, int] = (22, 5, 2)  # along each main direction of the covariance
    near_blocks: int = 9  # in a second sum of the answers, for a trace that has just begun
    both_penalty: float = 3.0  # two overlapping traces must score better than one by this
    touching_widths: float = 1.1  # traces further apart do not touch; in widths of the wheel
    known_m: float = 0.012  # a path known better than this is not searched
    contradiction_sd: float = 3.0  # a trace contradicts the motion of the ground from here on
    most_beside: float = 0.5  # a trace further from the path is not the wheel's own; in widths of the wheel


@dataclass(frozen=True, slots=True, kw_only=True)
class PresenceParameters:
    """Decision whether the trace is present; odds as logarithms.

    Chosen on `trace_drives`, on seeds 0 and 1 of `tests/nature/ground_drives`, 0 to 2 of
    `tests/nature/trace_*`, and 1 of the simulated rear scene.
    """

    least_length_m: float = 0.20  # of a trace that counts as present
    start_error_m: float = 0.02  # of the distance travelled, for the first trace
    lock_odds: float = 4.0  # a trace appears
    keep_odds: float = -1.0  # a trace that was present remains
    bridge_odds: float = -3.0  # the same, where shadows may hide it:
    bridged_m: float = 0.4  # for this travel since evidence of
    bridged_odds: float = 5.0  # at least
    persists_m: float = 0.08  # at the start: in the median over this travel, in which shadows pass
    clear_odds: float = 6.0  # the length of a trace with these odds is known
    shortest_m: float = 0.18  # strips of such a trace; the last one is covered in part
    signature_gain: float = 0.1  # per frame


@dataclass(frozen=True, slots=True, kw_only=True)
class StripParameters:
    """Distributions of the answers of strips of ground, bare or with a trace.

    Means and standard deviations are of even parts (right plus left over root 2: tone, wall, roughness, rough
    walls, rough floor) and odd parts (right minus left) of the answers. Moments of the answers on
    `trace_drives`, seed 0 of `tests/nature/trace_*` and seed 1 of the simulated rear scene, rounded;
    `bare_sd` and the edges were changed by hand on seeds 0 and 1 of `tests/nature/ground_drives`.
    """

    views: int = 24  # kept of each strip
    view_m: float = 0.010  # least travel between two views
    least_strips: int = 4  # of a stretch of trace
    bare_sd: tuple[float, ...] = (0.6, 0.5, 0.4, 0.3, 0.3)  # by kernel, of the mean of many bare strips
    strip_sd: float = 0.65  # of a single strip
    independent: float = 0.43  # share of strips that count as independent: neighbours are alike
    trace_mean: tuple[float, ...] = (0.0, 0.0, 0.0, 1.45, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0)
    trace_sd: tuple[float, ...] = (1.1, 0.6, 0.85, 0.8, 0.8, 0.45, 1.1, 0.5, 0.4, 0.35)
    edge_sd: float = 1.2  # of the answers on the side on which the edge of a shadow runs
    log_edge: float = -2.3  # logarithm of the probability that one runs there
    log_hidden: float = log(0.25)  # of the probability that a given edge lies in the front wheel's imprint
    log_change: float = -3.5  # logarithm of the probability that a trace begins or ends at a given strip
    search_cost: float = 4.0  # logarithm of the number of independent places that a search tries
    other_reading: float = 2.0  # logarithm of how much less likely two overlapping traces are than one


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfidenceParameters:
    """Logistic regression of "trace present, angle within 5 deg" on the logarithm of the odds.

    Fitted on the development drives of three renderers (5366 frames), then flattened by hand for odds near 1,
    where the regression was too cautious.
    """

    constant: float = 0.1
    odds: float = 0.52
    most_in_doubt: float = 0.4  # where no trace is reported


@dataclass(frozen=True, slots=True, kw_only=True)
class HoughParameters:
    """The paper's finder: edges and lines. The paper does not publish its numbers."""

    edge_percentiles: tuple[float, float] = (85.0, 95.0)  # of the gradient: weak and strong edges
    most_lines: int = 14
    least_votes: int = 30  # edge pixels of a line
    angle_step_rad: float = radians(1.0)
    near_pixels: float = 2.0  # edge pixels this near belong to a line
    rounds: int = 3  # of its fit
    roi_widths: float = 1.2  # half width of the band searched around the last trace, in widths of the wheel
    parallel_rad: float = radians(5.0)  # edges of one trace differ by less
    accepted: float = 0.62  # least match
    accepted_at_start: float = 0.75  # least match within `start_m`
    start_m: float = 0.20


@dataclass(frozen=True, slots=True, kw_only=True)
class FuzzyParameters:
    """The paper's finder: membership functions and weights. The paper does not publish them."""

    width_tolerance: float = 0.35  # of the distance of two edges, over the wheel's width
    single_edge: float = 0.25  # width match of a line without a partner
    angle_step_rad: float = radians(6.0)  # of the trace between frames
    offset_step: float = 0.5  # of the trace between frames, in widths of the wheel
    full_support: float = 0.6  # share of a line covered by edges that counts as full
    angle_weight: float = 1.0
    contact_weight: float = 2.0
    support_weight: float = 1.0
    width_weight: float = 1.5
    continuity_weight: float = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class FTraceParameters:
    """All groups."""

    kept_m: float = 0.055  # travel without a trace on which the last one is kept: three frames of 16 mm
    ground_motion: GroundMotionParameters = GROUND_MOTION
    frame: FrameParameters = FrameParameters()
    direction: DirectionParameters = DirectionParameters()
    matching: MatchingParameters = MatchingParameters()
    shading: ShadingParameters = ShadingParameters()
    fixed: FixedParameters = FixedParameters()
    sections: SectionParameters = SectionParameters()
    path: PathParameters = PathParameters()
    search: SearchParameters = SearchParameters()
    presence: PresenceParameters = PresenceParameters()
    strips: StripParameters = StripParameters()
    confidence: ConfidenceParameters = ConfidenceParameters()
    hough: HoughParameters = HoughParameters()
    fuzzy: FuzzyParameters = FuzzyParameters()


DEFAULTS = FTraceParameters()
