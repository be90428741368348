"""Which of the motions that the points share is that of the ground."""

from dataclasses import replace

from controllers.ground_motion.flow import Followed, PatchMotion
from controllers.ground_motion.parameters import ValidityParameters

MAY_STAND = "ground that stands cannot be distinguished from what is fixed in the picture"


def choose(
    followed: Followed, apart_pixels: float, numbers: ValidityParameters
) -> tuple[PatchMotion | None, str]:
    """Return the motion that is the ground's, or why none is.

    Args:
        followed: The groups of motions.
        apart_pixels: Known motion between the earlier frame and the one before this.
        numbers: What a pair must show.
    """
    moving, fixed = followed.moving, followed.fixed
    if moving is not None and fixed is not None and _shared(moving, fixed) > numbers.most_shared:
        # Points that stand and move at once are of ground that repeats, not ground behind specks.
        is_faint = moving.points < numbers.most_ambiguous * fixed.points
        moving = None if is_faint else replace(moving, ambiguity=1.0)
    if moving is not None and moving.moved_pixels > numbers.still_pixels:
        most_sd_pixels = min(
            numbers.least_sd_pixels + numbers.sd_share * moving.moved_pixels, numbers.most_sd_pixels
        )
        if moving.points >= numbers.least_moving and moving.moved_sd_pixels < most_sd_pixels:
            return moving, ""
        reason = "too few points move alike"
    else:
        reason = "too few points follow the ground"
    still = max((m for m in (moving, fixed) if m is not None), key=lambda m: m.points, default=None)
    if still is None or still.moved_pixels > numbers.still_pixels:
        return None, reason
    if apart_pixels > 1.0:
        return None, "what is fixed in the picture hides the ground"
    # One that creeps is neither at rest nor clearly moving: it must be sharp, and of nearly all points.
    creeps = still.moved_pixels > numbers.creeping_pixels
    sharp = still.moved_sd_pixels < numbers.clear_still_sd_pixels
    least_share = numbers.clear_still_share if sharp and not creeps else numbers.least_still_share
    most_sd_pixels = numbers.creeping_sd_pixels if creeps else numbers.most_still_sd_pixels
    if still.share < least_share or still.moved_sd_pixels > most_sd_pixels:
        return None, MAY_STAND
    return still, ""


def _shared(moving: PatchMotion, fixed: PatchMotion) -> float:
    """Return the share of the points of one motion that the other explains too."""
    if moving.tracks is None or fixed.tracks is None:
        return 0.0
    follows = moving.tracks.follows
    return float((follows & fixed.tracks.follows).sum()) / max(int(follows.sum()), 1)
