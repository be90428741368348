"""Settings of slip compensation."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from controllers.slip.effort.slip_map import SlipMapFile
from drivers.settings import Settings

SURFACES = "surfaces"
YAW_PROBE = "yaw_probe"


class TorqueCorrectionSettings(Settings):
    """How strongly the paper's torque correction acts. It is positive feedback, so it is bounded.

    Attributes:
        matrix: `dual` is R J^-T, the inverse of the statics; `as_printed` is the matrix of paper 003, which
            weighs yaw twice and is there for comparison only.
        gain_rad_s_nm: Change of a set-point per torque.
        bound_rad_s: Greatest change of a set-point.
    """

    matrix: Literal["dual", "as_printed"] = "dual"
    gain_rad_s_nm: Annotated[float, Field(ge=0.0, le=50.0)] = 1.0
    bound_rad_s: Annotated[float, Field(ge=0.0, le=5.0)] = 0.5


class SlipSettings(Settings):
    """How slip is found and what is done about it.

    Attributes:
        maps: Fitted maps; in a configuration file the name of a shipped file or the path of one.
        use: `yaw_probe` to shake the yaw a little and see what is lost of it, `surfaces` for the map that
            recognises the surface, or the name of one of the wheel maps.
        known_surfaces: Where the ground is known: only these surfaces come into question.
        torque_correction: Also correct the set-points; None leaves them alone.
    """

    maps: SlipMapFile
    use: str = SURFACES
    known_surfaces: tuple[str, ...] = ()
    torque_correction: TorqueCorrectionSettings | None = None

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        probe = () if self.maps.yaw_probe is None else (YAW_PROBE,)
        if self.use not in (SURFACES, *probe, *self.maps.wheel_maps):
            names = ", ".join((SURFACES, *probe, *self.maps.wheel_maps))
            raise ValueError(f"use is '{self.use}', but the maps hold {names}: name one of these")
        shipped = [surface.name for surface in self.maps.surfaces.surfaces]
        for name in self.known_surfaces:
            if name not in shipped:
                raise ValueError(f"known_surfaces has '{name}', but the map knows {', '.join(shipped)}")
        return self
