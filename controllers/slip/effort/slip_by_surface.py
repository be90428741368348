"""Slip of the rover by the surface that the drive force shows."""

from typing import NamedTuple

from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.kinematics import Kinematics
from controllers.slip.effort.ground_knowledge import GroundKnowledge, KnownSlip
from controllers.slip.effort.settings import YAW_PROBE, SlipSettings
from controllers.slip.effort.surface_map import NO_TRAVEL, SurfaceTracker, Travel
from controllers.slip.effort.wheel_efforts import WheelEfforts
from controllers.slip.effort.wheel_map_check import WheelMapCheck


class WindowSlip(NamedTuple):
    """Slips of the wheels in a window; None where they can only be held. Valid where `reason` is empty."""

    slips: tuple[float, ...] | None
    drift_rad: float
    reason: str


def same_slip(count: int, slip: float, reason: str, drift_rad: float = 0.0) -> WindowSlip:
    """Return a window in which all wheels slip alike."""
    return WindowSlip((slip,) * count, drift_rad, reason)


class SlipBySurface:
    """Recognises the ground by the drive force of half a second; the map of the surfaces gives the slip.

    A map of single wheels, if one is in use, is compared with it.

    Args:
        settings: Maps, and which of them to use.
        kinematics: Of the wheels.
        base_radius_m: Distance of the wheels from the centre of the rover.

    Attributes:
        ground: What is known of the ground.
        wheel_map: Map of single wheels in use; None for another.
        map_check: Whether that agrees with the ground.
        uses_map_anywhere: Whether the map is used on unknown ground, too.
    """

    def __init__(self, settings: SlipSettings, kinematics: Kinematics, base_radius_m: float) -> None:
        surfaces = settings.maps.surfaces
        if settings.known_surfaces:
            surfaces = surfaces.only(settings.known_surfaces)
        self._count = kinematics.wheel_count
        self._is_excited = settings.use == YAW_PROBE
        self._tells_by_force = bool(settings.known_surfaces or settings.learn)
        # The excitation falls back by rules of its own.
        self.uses_map_anywhere = settings.unknown_ground == "map" or self._is_excited
        self.ground = GroundKnowledge(
            surfaces, are_named=bool(settings.known_surfaces), learns=settings.learn
        )
        self._tracker = SurfaceTracker(surfaces, base_radius_m)
        self._surface = self._tracker.step(NO_TRAVEL)
        self.wheel_map = settings.maps.wheel_maps.get(settings.use)
        self.map_check = WheelMapCheck(settings.use, kinematics, self.ground.known.reason)

    @property
    def name(self) -> str | None:
        """The recognised surface; None where it is unknown."""
        return self._surface.surface

    @property
    def prior_slip(self) -> float:
        """Slip of a wheel without any other knowledge."""
        known = self.ground.known
        if not known.reason:
            return known.slip
        if not self.uses_map_anywhere:
            return 0.0
        return self._tracker.prior_slip if self._surface.surface is None else self._surface.slip

    def step(self, increment: BodyIncrement, efforts: WheelEfforts, drift_rad: float) -> WindowSlip | None:
        """Take an increment; return the slip of the wheels at the end of half a second, else None.

        Args:
            increment: Of rolling wheels.
            efforts: Of the wheels, as of the increment.
            drift_rad: Drift of the window before, which stays while the work is unknown.
        """
        unknown = efforts.unknown_work
        if unknown is not None:
            self._tracker.interrupt()
            self.map_check.begin()
            return WindowSlip(None, drift_rad, unknown.value)
        if self.wheel_map is not None:
            self.map_check.add(self.wheel_map, efforts.newest, increment.turned_rad)
        work_j = efforts.work_j(increment)
        before = self._surface
        self._surface = self._tracker.step(
            Travel(increment.duration_s, increment.x_m, increment.y_m, increment.turn_rad, work_j)
        )
        if self._surface is before or self._tracker.window is None:
            return None
        known = self.ground.known
        if not self._is_excited:
            known = self.ground.step(self._tracker.window)
        self.map_check.compare(known, has_map=self.wheel_map is not None)
        if known.reason and not self.uses_map_anywhere:
            return WindowSlip(None, 0.0, known.reason)
        if known.reason:
            return same_slip(self._count, self._surface.slip, known.reason, self._surface.drift_rad)
        return same_slip(self._count, known.slip, "", known.drift_rad)

    def by_force(self, travel: Travel | None) -> KnownSlip | None:
        """Return the slip by the drive force of a travel; None where currents are not to be used.

        Args:
            travel: None where its work is unknown: what is known of the ground then stays.
        """
        if not self._tells_by_force:
            return None
        if travel is not None:
            self.ground.step(self._tracker.force_window(travel))
        return self.ground.known
