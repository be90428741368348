"""Every tuned number of FTrace.

Provenance, unless a group or a line states another: unknown; chosen by hand on development drives of the
simulated rear scene (seeds below 1000). Units are in the names; other numbers are ratios. A result's
sensitivity to each number is printed by `python -m benchmarks.ftrace.parameter_sensitivity`.
"""

from dataclasses import dataclass
from math import radians


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnParameters:
    """Uncertainty of the angles turned between two frames."""

    gyro_sd_rad: float = 0.001  # of an angle by the gyro
    gyro_rate_sd_rad_s: float = 0.004  # bias and noise of a small gyro, changes of the rate between samples
    free_tilt_sd_rad: float = 0.006  # of roll and pitch without a gyro
    free_turn_rate_sd_rad_s: float = 0.05  # of yaw without a gyro


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameParameters:
    """Frames that show nothing are not used; grey levels are 0 to 255."""

    darkest_grey: int = 6  # least median
    brightest_grey: int = 250  # a pixel from here on is burnt out
    most_burnt: float = 0.7  # greatest share of burnt-out pixels
    least_contrast: float = 3.0  # least standard deviation of the grey levels


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowParameters:
    """Motion of the rover from the optical flow of the ground."""

    spacing_m: float = 0.056  # of the points
    window_m: float = 0.060  # side of a point's window
    least_points: int = 14  # that follow the ground
    point_sd_m: float = 0.0006  # of the motion of a point
    standing_m: float = 0.008  # from this motion on, points that do not move are rejected
    standing_share: float = 0.3  # a point with less than this share of the expected motion does not move
    rounds: int = 4  # of the robust fit
    cut: float = 3.0  # points with a greater residual have no weight; in robust standard deviations
    most_scale_m: float = 0.0025  # greatest scatter of points that follow the ground
    inlier_weight: float = 0.2  # least weight of a point that moves with the ground
    covariance_factor: float = 2.0  # neighbouring windows overlap: there are fewer independent points
    contrast: float = 160.0  # grey levels per unit of log grey in the pictures that are compared
    reach_m: float = 0.12  # frames further apart share too little ground: they are matched first
    least_share: float = 0.3  # of the points that must move with the ground
    slip_guess: float = 0.15  # expected slip where the ground's motion is not measured
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

    gain: float = 0.3  # of one frame
    leak: float = 0.002  # lost per frame
    baselines_m: tuple[float, float] = (0.04, 0.09)  # in turn: for sharp edges, for wide shadows
    past_frames: int = 12  # to compare with
    most_difference: float = 0.6  # of log grey; greater ones are mismatched edges
    least_pixels: int = 250  # that two frames must share
    steepest: float = 1.0  # greatest slope of the ground's motion across the image
    lit_share: float = 0.75  # share of each line along the motion that may be darker than lit ground
    rough_share: float = 0.5  # the same for roughness: edges of shadows are rough


@dataclass(frozen=True, slots=True, kw_only=True)
class SectionParameters:
    """Cross-sections of the ground, block by block."""

    block_m: float = 0.04  # length of a block
    light_m: float = 0.5  # brightness that varies more slowly is light, not rut
    kernel_reach: float = 2.0  # half widths of the wheel that a kernel covers on either side
    softness: float = 0.12  # of a kernel's edges, in half widths
    least_weight: float = 0.5  # share of a block that must be in view
    clip: float = 2.5  # limit of an answer, in standard deviations: no stone decides alone
    energy_floor: float = 0.02  # of the gradients of log grey, before the logarithm
    texture_m: tuple[float, float] = (0.012, 0.044)  # window of the roughness, along and across
    grey_floor: float = 12.0  # grey levels added before the logarithm
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
    temper: float = 16.0  # answers of neighbouring curves and blocks are correlated: this many count as one
    touching_widths: float = 1.1  # traces further apart do not touch; in widths of the wheel
    surround_m: tuple[float, float] = (0.28, 0.016)  # reach and step of the neighbouring curves
    surround_widths: float = 1.0  # curves this near to the front wheel's trace are left out
    most_beside: float = 0.5  # a trace further from the path is not the wheel's own; in widths of the wheel


@dataclass(frozen=True, slots=True, kw_only=True)
class PresenceParameters:
    """Decision whether the trace is present. Strengths are squared answers, floors standard deviations."""

    least_length_m: float = 0.20  # of a trace that counts as present
    kept_length_m: float = 0.13  # of one that was present, or is the first of the drive
    ends_m: float = 0.055  # the ends of the trace cover their blocks in part only
    full_answer: float = 0.75  # a block that answers with this share of the usual strength is covered
    start_error_m: float = 0.01  # of the distance travelled, for the first trace
    # Accepted before the rover can have left a trace.
    start_strength: float = 130.0  # with `start_floor`: accepted at once
    start_floor: float = 6.0
    start_clearness: float = 1.7  # in every frame so far, and at least in `start_frames`
    start_frames: int = 2
    start_two_sided: float = 90.0  # strength on both sides
    start_moved_m: float = 0.01  # least travel with a floor above `start_roughness`
    light_known_m: float = 0.06  # least travel otherwise: until then shadows cannot be separated from tone
    start_roughness: float = 5.5
    full_share: float = 0.5  # answer of the farthest third of the view, over the rest, where a trace fills it
    background_share: float = 0.5  # of the clearness before, subtracted from what looks alike
    # Accepted later.
    lock_margin: float = 14.0  # of the strength over that of the neighbours, in all of the last frames
    lock_frames: int = 5
    lock_far_frames: int = 2  # where frames are further apart than `memory_m`
    lasting_strength: float = 46.0  # mean strength that needs no margin, as among shadows
    lock_floor: float = 3.5  # in this frame
    mean_lock_floor: float = 2.2  # on average
    sure_m: float = 0.20  # clearness summed over distance that needs no floor, as of a plain band of tone
    most_sure_m: float = 0.45
    # Kept, and found again.
    mean_keep_floor: float = 0.5
    keep_agreement: float = 3.7  # with the signature, in standard deviations
    bare_agreement: float = 5.5  # keeps a trace for any strength of the neighbours
    sure_agreement: float = 6.5
    again_agreement: float = 5.0  # with `again_floor`: a lost trace is found again
    again_floor: float = 1.8
    range_blocks: int = 5  # least length of the stretch that agrees
    # Clearness, about a logarithm of odds per metre.
    surround: float = 5.0  # usual strength of ground without a trace
    clear_ratio: float = 1.3  # of the strength over that of the neighbours
    most_log_ratio: float = 1.0  # edges of shadows are strong: floor or tone must show as well
    floor_share: float = 0.3
    usual_floor: float = 1.0
    most_floor: float = 5.0
    usual_likeness: float = 0.7  # cosine between the sums of answers
    most_likeness: float = 0.9
    memory_m: float = 0.10  # of averages
    least_gain: float = 0.05  # of averages, per frame
    signature_gain: float = 0.1  # per frame


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfidenceParameters:
    """Logistic regression of the error of an angle.

    Fitted on drives of the simulated rear scene (seeds 0 to 2 and 10 to 12) and of another renderer, each
    half tested on the other one, with an earlier method: the present one made too few errors to fit.
    """

    constant: float = -15.06
    spread: float = -2.41  # per logarithm of the spread of likely curves
    residual: float = -0.96  # per logarithm of the scatter of the blocks about the curve
    bend: float = -1.47  # per logarithm of the change of direction along the curve
    least_m: float = 0.001  # added to spread and residual
    least_bend_rad: float = 0.02  # added to the change of direction


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

    most_misses: int = 3  # frames in a row without a trace for which the last one is kept
    turn: TurnParameters = TurnParameters()
    frame: FrameParameters = FrameParameters()
    flow: FlowParameters = FlowParameters()
    matching: MatchingParameters = MatchingParameters()
    shading: ShadingParameters = ShadingParameters()
    sections: SectionParameters = SectionParameters()
    path: PathParameters = PathParameters()
    search: SearchParameters = SearchParameters()
    presence: PresenceParameters = PresenceParameters()
    confidence: ConfidenceParameters = ConfidenceParameters()
    hough: HoughParameters = HoughParameters()
    fuzzy: FuzzyParameters = FuzzyParameters()


DEFAULTS = FTraceParameters()
