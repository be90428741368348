"""Named sets of drives for those who find traces: development and held-out, each with seeds of its own.

A seed below `FIRST_HELD_OUT_SEED` is for development. Held-out drives have other grounds, rigs and ruts, so
that what was tuned on the first is tested on the second.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError
from sim_backends.rear_scene.ground_map import GroundSettings, Rut, Sun, Terrain, WheelStep
from sim_backends.rear_scene.scene import Lens
from sim_backends.rear_scene.settings import GroundKind
from tests.rear_scene.draws import SPEED_M_S, draw_errors, draw_rig, wander
from tests.rear_scene.motion import RATE_HZ, Plan, drive
from tests.rear_scene.rig_file import CalibratedRig
from tests.rear_scene.sequence import Appearance, FrameSequence

Floats: TypeAlias = NDArray[np.float64]
SetName: TypeAlias = Literal[
    "easy",
    "texture",
    "shadow",
    "overlap",
    "curved",
    "drop_out",
    "no_trace",
    "field_test_1",
    "field_test_2",
    "sparse",
]
SET_NAMES: tuple[SetName, ...] = get_args(SetName)
FIRST_HELD_OUT_SEED = 1000
FRAME_RATE_HZ = 5.0
SPARSE_STEP_M = 0.32
DURATION_S = 40.0
DURATIONS_S: Mapping[str, float] = {"field_test_1": 100.0, "field_test_2": 185.0, "sparse": 160.0}
SANDS: Mapping[bool, tuple[GroundKind, ...]] = {
    False: ("fine_sand", "rippled_sand"),
    True: ("coarse_sand", "patchy_sand"),
}
PHOTOGRAPHS: Mapping[bool, tuple[GroundKind, ...]] = {
    False: ("gravel", "brick"),
    True: ("grass", "sandy_gravel"),
}


@dataclass(frozen=True, kw_only=True)
class DriveDraft:
    """A drive being put together; `gain` is the exposure of each frame."""

    held_out: bool
    rig: CalibratedRig
    plan: Plan
    ground: GroundSettings
    sun: Sun
    rut: Rut
    lens: Lens
    gain: Floats
    earlier_steps: tuple[WheelStep, ...] = ()

    @property
    def steps(self) -> int:
        """Return the number of steps of the plan."""
        return len(self.plan.rim_speed_m_s)


Change: TypeAlias = Callable[[DriveDraft, np.random.Generator], DriveDraft]


def make_sequence(name: SetName, seed: int, duration_s: float | None = None) -> FrameSequence:
    """Return the drive of a set with this seed; nothing is rendered yet.

    Args:
        name: Of the set.
        seed: 0 and up for development, `FIRST_HELD_OUT_SEED` and up held out.
        duration_s: Length of the drive; None takes the set's own.

    Raises:
        ConfigError: There is no such set.
    """
    if name not in SET_NAMES:
        msg = f"no set of scenes is called '{name}': choose one of {', '.join(SET_NAMES)}"
        raise ConfigError(msg)
    rng = np.random.default_rng([seed, SET_NAMES.index(name)])
    fps = SPEED_M_S / SPARSE_STEP_M if name == "sparse" else FRAME_RATE_HZ
    easy = _easy(seed >= FIRST_HELD_OUT_SEED, fps, duration_s or DURATIONS_S.get(name, DURATION_S), rng)
    draft = _CHANGES[name](easy, rng)
    motion = drive(draft.rig, draft.ground.terrain, draft.plan, draft.rut.depth_m)
    appearance = Appearance(
        ground=draft.ground,
        sun=draft.sun,
        rut=draft.rut,
        lens=draft.lens,
        gain=tuple(map(float, draft.gain)),
        earlier_steps=draft.earlier_steps,
    )
    return FrameSequence(name, seed, draft.rig, motion, appearance, draw_errors(rng))


def _easy(held_out: bool, fps: float, duration_s: float, rng: np.random.Generator) -> DriveDraft:
    """Return a drive on sand with the sun from the side and slow drift; the other sets change it."""
    steps = round(duration_s * RATE_HZ)
    frames = int(duration_s * fps)
    heading = float(rng.uniform(-np.pi, np.pi))
    from_side_deg = float(rng.choice([-1, 1]) * rng.uniform(60, 120))
    rock = np.stack([wander(steps, 0.35 * RATE_HZ, rng), wander(steps, 0.35 * RATE_HZ, rng)], axis=1)
    return DriveDraft(
        held_out=held_out,
        rig=draw_rig(held_out, fps, rng),
        plan=Plan(
            rim_speed_m_s=SPEED_M_S * (1 + 0.03 * wander(steps, 1.5 * RATE_HZ, rng)),
            slip=np.clip(0.12 + 0.05 * wander(steps, 3 * RATE_HZ, rng), -0.05, 0.6),
            slip_angle_rad=np.radians(rng.uniform(-5, 5) + 2 * wander(steps, 6 * RATE_HZ, rng)),
            yaw_rate_rad_s=np.radians(0.25) * wander(steps, 2 * RATE_HZ, rng),
            rock_rad=np.radians(0.4) * rock,
            start_yaw_rad=heading,
        ),
        ground=GroundSettings(
            kind=_pick(SANDS[held_out], rng),
            tile_turn_deg=float(rng.uniform(0, 360)),
            stones_per_m2=float(rng.uniform(0, 6)),
        ),
        sun=Sun(azimuth_deg=math.degrees(heading) + from_side_deg, elevation_deg=float(rng.uniform(35, 60))),
        rut=Rut(
            depth_m=float(rng.uniform(0.010, 0.018)),
            berm_m=float(rng.uniform(0.003, 0.007)),
            tone=float(rng.uniform(0.75, 1.05) if held_out else rng.uniform(0.80, 0.95)),
        ),
        lens=Lens(noise_grey=float(rng.uniform(2, 4)), exposure_s=float(rng.uniform(0.006, 0.02))),
        gain=np.clip(1 + 0.05 * wander(frames, 10, rng), 0.7, 1.3),
    )


def _texture(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    ground = replace(draft.ground, kind=_pick(PHOTOGRAPHS[draft.held_out], rng), patchiness=0.1)
    rut = replace(
        draft.rut, compaction=float(rng.uniform(0.35, 0.6)), depth_m=float(rng.uniform(0.008, 0.014))
    )
    return replace(draft, ground=ground, rut=rut)


def _shadow(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    heading_deg = math.degrees(draft.plan.start_yaw_rad)
    poles = tuple(
        (heading_deg + float(rng.uniform(-60, 60)), float(way_m), float(rng.uniform(0.01, 0.08)), 0.008)
        for way_m in np.arange(0.3, 4.0, 0.5) + rng.uniform(-0.2, 0.2, 8)
    )
    sun = replace(
        draft.sun,
        azimuth_deg=heading_deg + float(rng.uniform(-40, 40)),
        elevation_deg=float(rng.uniform(28, 50)),
        sky_grey=50.0,
        sun_grey=230.0,
        bands=poles,
    )
    ground = replace(draft.ground, stones_per_m2=float(rng.uniform(8, 25)))
    return _any_ground(replace(draft, sun=sun, ground=ground), rng)


def _overlap(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    """Lay old traces across and beside the way, and drift enough that the front wheel's shows too."""
    heading = draft.plan.start_yaw_rad
    offset = np.radians(rng.choice([-1, 1]) * rng.uniform(4, 9))
    plan = replace(draft.plan, slip_angle_rad=draft.plan.slip_angle_rad + offset)
    course = np.array([math.cos(heading + offset), math.sin(heading + offset)])
    old = [
        _earlier_step(way_m * course + rng.normal(0, 0.15, 2), heading + turn, draft.rig.wheel.width_m, rng)
        for way_m, turn in zip(rng.uniform(-1, 4, 8), np.radians(rng.uniform(-70, 70, 8)), strict=True)
    ]
    return _any_ground(replace(draft, plan=plan, earlier_steps=tuple(old)), rng)


def _earlier_step(through_m: Floats, heading: float, width_m: float, rng: np.random.Generator) -> WheelStep:
    half = 2.5 * np.array([math.cos(heading), math.sin(heading)])
    start, end = through_m - half, through_m + half
    return WheelStep(
        start_m=(float(start[0]), float(start[1])),
        end_m=(float(end[0]), float(end[1])),
        heading_rad=heading,
        lugs=(0.0, 5.0 / 0.032),
        width_m=width_m,
        softness=float(rng.uniform(0.4, 1.0)),
    )


def _curved(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    drift = np.radians(rng.uniform(4, 7) * wander(draft.steps, 3.5 * RATE_HZ, rng))
    yaw_rate = np.radians(0.6) * wander(draft.steps, 3 * RATE_HZ, rng)
    plan = replace(draft.plan, slip_angle_rad=np.clip(drift, -0.5, 0.5), yaw_rate_rad_s=yaw_rate)
    return _any_ground(replace(draft, plan=plan), rng)


def _drop_out(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    """Black, dim and burnt frames, and stretches of ground too hard for a rut."""
    gain = draft.gain.copy()
    for _ in range(len(gain) // 15):
        first, length = int(rng.integers(10, max(11, len(gain) - 5))), int(rng.integers(1, 4))
        gain[first : first + length] *= rng.choice([0.0, 0.01, 0.35, 1.8, 6.0])
    starts = np.arange(1.0, 12.0, 1.1) + rng.uniform(-0.2, 0.2, 10)
    hard = tuple((float(start), float(start + rng.uniform(0.1, 0.5))) for start in starts)
    return _any_ground(replace(draft, gain=gain, plan=replace(draft.plan, hard_m=hard)), rng)


def _no_trace(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    """Drive on ground too hard for any rut, with shadows and old lines to be fooled by."""
    hard = replace(draft.plan, hard_m=((-1.0, 1e3),))
    other = _shadow(replace(draft, plan=hard), rng) if rng.random() < 0.5 else replace(draft, plan=hard)
    return _any_ground(other, rng)


def _field_test_1(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    """7 m up a slope of about 5 degrees, from 60 s on along the flank of a long mound."""
    side = float(rng.choice([-1, 1]))
    heading = draft.plan.start_yaw_rad
    tops = (5.4, 6.1, 6.8, 7.5)
    long_mound = tuple(_beside(heading, way_m, side * 0.95, height_m=0.13, radius_m=0.65) for way_m in tops)
    return _on_slope(draft, heading, long_mound, rng)


def _field_test_2(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    """13 m up a slope of about 5 degrees over small mounds on alternating sides."""
    heading = draft.plan.start_yaw_rad
    side = float(rng.choice([-1, 1]))
    mounds = tuple(
        _beside(
            heading,
            along_m=way_m,
            left_m=side * (-1) ** k * rng.uniform(0.5, 0.7),
            height_m=height_m,
            radius_m=0.5,
        )
        for k, (way_m, height_m) in enumerate(
            zip(
                np.array([2.5, 4.8, 7.2, 9.6, 11.8]) + rng.uniform(-0.3, 0.3, 5),
                rng.uniform(0.10, 0.18, 5),
                strict=True,
            )
        )
    )
    return _on_slope(draft, heading, mounds, rng)


def _on_slope(
    draft: DriveDraft,
    heading: float,
    mounds: tuple[tuple[float, float, float, float], ...],
    rng: np.random.Generator,
) -> DriveDraft:
    grade = math.tan(math.radians(5))
    terrain = Terrain(slope=(grade * math.cos(heading), grade * math.sin(heading)), mounds=mounds)
    plan = replace(
        draft.plan,
        slip=0.04 + 0.03 * wander(draft.steps, 3 * RATE_HZ, rng),
        slip_angle_rad=np.radians(0.7) * wander(draft.steps, 3 * RATE_HZ, rng),
        drift_per_roll=1.1,
        slip_per_pitch=0.9,
        slip_per_drift=0.5,
    )
    ground = replace(draft.ground, terrain=terrain)
    sun = replace(draft.sun, azimuth_deg=math.degrees(heading) + float(rng.uniform(-150, 150)))
    return replace(draft, plan=plan, ground=ground, sun=sun)


def _beside(
    heading: float, along_m: float, left_m: float, height_m: float, radius_m: float
) -> tuple[float, float, float, float]:
    cosine, sine = math.cos(heading), math.sin(heading)
    return cosine * along_m - sine * left_m, sine * along_m + cosine * left_m, float(height_m), radius_m


def _sparse(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    drift = np.radians(5 * wander(draft.steps, 8 * RATE_HZ, rng))
    return _any_ground(replace(draft, plan=replace(draft.plan, slip_angle_rad=drift)), rng)


def _any_ground(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    """Half on sand, half on a photograph."""
    return _texture(draft, rng) if rng.random() < 0.5 else draft


def _pick(kinds: tuple[GroundKind, ...], rng: np.random.Generator) -> GroundKind:
    return kinds[int(rng.integers(len(kinds)))]


def _unchanged(draft: DriveDraft, rng: np.random.Generator) -> DriveDraft:
    return draft


_CHANGES: Mapping[SetName, Change] = {
    "easy": _unchanged,
    "texture": _texture,
    "shadow": _shadow,
    "overlap": _overlap,
    "curved": _curved,
    "drop_out": _drop_out,
    "no_trace": _no_trace,
    "field_test_1": _field_test_1,
    "field_test_2": _field_test_2,
    "sparse": _sparse,
}
