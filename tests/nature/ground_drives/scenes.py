"""Scene types: from which ranges each draws its ground, its prints, light, motion and camera."""

from dataclasses import dataclass, replace
from types import MappingProxyType

Range = tuple[float, float]

NO_PRINT = "none"


@dataclass(frozen=True)
class Recipe:
    """Ranges of one scene type. Angles in degrees, lengths in m, speeds in m/s; chances from 0 to 1.

    Attributes:
        grounds: kinds of ground, one is drawn.
        prints: how the rover's wheels print, one is drawn: "strong", "medium", "weak", "relief" or "none".
        sun_elevation_deg, overcast: height of the sun, and chance of an overcast sky.
        rover_shadow: smallest and largest share of the picture's middle under the rover's own shadow; None:
        as it comes.
        passing: number of moving shadows in ten seconds. standing: number of shadows of objects that stand.
        foliage: chance of leaves above. leaf_cover: their area as a share of the ground's, of one layer.
        wet, old: numbers of wet patches and of old traces.
        along: chance that an old trace runs along the path rather than across.
        side_slip_deg, yaw_rate_dps: mean size, sign drawn; side slip and yaw rate vary about it.
        before_m: way before the first frame. appears: the trace begins and ends in mid-drive.
        exposure: target of the linear mean. hunting: chance of an exposure that oscillates.
        clouds: chance that clouds change the sunlight. shake: factor on vibration. dropped: chance that a
        frame is lost.
    """

    grounds: tuple[str, ...] = ("sand", "sand", "gravel", "cracked_soil")
    prints: tuple[str, ...] = ("strong", "medium", "medium")
    sun_elevation_deg: Range = (25.0, 70.0)
    overcast: float = 0.15
    rover_shadow: Range | None = None
    passing: Range = (0.0, 0.0)
    standing: Range = (0.0, 0.0)
    foliage: float = 0.0
    leaf_cover: Range = (0.15, 0.7)
    wet: Range = (0.0, 0.0)
    wet_streaks: bool = False
    old: Range = (0.0, 0.0)
    along: float = 0.3
    mound_m: Range = (0.0, 0.0)
    side_slip_deg: Range = (0.0, 14.0)
    yaw_rate_dps: Range = (0.0, 0.6)
    before_m: Range = (0.0, 1.2)
    appears: bool = False
    exposure: Range = (0.14, 0.26)
    hunting: float = 0.1
    clouds: float = 0.2
    shake: Range = (0.5, 1.5)
    blur_ms: Range = (1.0, 6.0)
    noise: Range = (0.004, 0.012)
    jpeg: Range = (75.0, 95.0)
    dropped: float = 0.01


_BARE = Recipe(
    grounds=("sand", "gravel", "cracked_soil", "paving", "grass"), prints=(NO_PRINT,), overcast=0.0
)
_OWN = Recipe()

SCENES: MappingProxyType[str, Recipe] = MappingProxyType(
    {
        "bare_shadow": replace(
            _BARE,
            rover_shadow=(0.05, 0.65),
            passing=(2.0, 6.0),
            standing=(0.0, 2.0),
            sun_elevation_deg=(20.0, 60.0),
        ),
        "bare_foliage": replace(_BARE, foliage=1.0, passing=(0.0, 1.0)),
        "bare_stones": replace(_BARE, grounds=("gravel",), overcast=0.3, sun_elevation_deg=(12.0, 75.0)),
        "bare_wet_patches": replace(_BARE, wet=(3.0, 9.0), wet_streaks=True, overcast=0.4),
        "bare_old_traces": replace(
            _BARE, grounds=("sand", "gravel", "cracked_soil"), old=(1.0, 4.0), along=0.7, overcast=0.2
        ),
        "own_easy": replace(_OWN, grounds=("sand",), prints=("strong",), hunting=0.0, clouds=0.0),
        "own_hard_shadow": replace(
            _OWN,
            overcast=0.0,
            rover_shadow=(0.1, 0.75),
            passing=(0.0, 3.0),
            standing=(0.0, 2.0),
            sun_elevation_deg=(20.0, 60.0),
            prints=("strong", "medium", "relief"),
        ),
        "own_foliage": replace(_OWN, overcast=0.0, foliage=1.0, rover_shadow=(0.0, 0.6)),
        "own_low_contrast": replace(
            _OWN,
            grounds=("gravel", "cracked_soil", "sand", "gravel"),
            prints=("weak", "relief"),
            overcast=0.4,
        ),
        "own_mounds": replace(_OWN, grounds=("sand", "sand", "gravel"), mound_m=(0.02, 0.06), old=(0.0, 3.0)),
        "own_old_crossing": replace(
            _OWN, old=(1.0, 4.0), along=0.3, prints=("strong", "medium", "medium", "weak")
        ),
        "own_curved": replace(_OWN, yaw_rate_dps=(1.5, 5.0), side_slip_deg=(0.0, 8.0)),
        "own_grass": replace(_OWN, grounds=("grass",), prints=("strong", "medium")),
        "own_low_sun": replace(_OWN, sun_elevation_deg=(7.0, 18.0), overcast=0.0),
        "own_noon": replace(_OWN, sun_elevation_deg=(65.0, 85.0), overcast=0.0, prints=("medium", "relief")),
        "own_overcast": replace(_OWN, overcast=1.0, prints=("medium", "relief", "weak")),
        "own_overexposed": replace(_OWN, exposure=(0.5, 0.8), hunting=0.5, overcast=0.1),
        "own_jpeg60_blur": replace(
            _OWN, jpeg=(58.0, 64.0), blur_ms=(12.0, 35.0), shake=(1.5, 4.0), noise=(0.01, 0.025)
        ),
        "own_wet_patches": replace(_OWN, wet=(3.0, 9.0), wet_streaks=True),
        "own_appears": replace(_OWN, appears=True, before_m=(0.2, 0.8)),
    }
)
"""Recipe of each scene type by name: `bare_` has no trace of the rover, `own_` has one."""
