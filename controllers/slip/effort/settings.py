"""Settings of slip compensation."""

from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from controllers.slip.effort.slip_map import SlipMapFile
from drivers.settings import Settings

SURFACES = "surfaces"
YAW_PROBE = "yaw_probe"


class TorqueCorrectionSettings(Settings):
    """How strongly the paper's torque correction acts. It is positive feedback, so it is bounded.

    Attributes:
        matrix: `dual` is R J^-T, the inverse of the statics; the one printed in paper 003 weighs yaw twice.
        gain_rad_s_nm: Change of a set-point per torque.
        bound_rad_s: Greatest change of a set-point.
    """

    matrix: Literal["dual"] = "dual"
    gain_rad_s_nm: Annotated[float, Field(ge=0.0, le=50.0)] = 1.0
    bound_rad_s: Annotated[float, Field(ge=0.0, le=5.0)] = 0.5

    @field_validator("matrix", mode="before")
    @classmethod
    def _check_matrix(cls, matrix: object) -> object:
        if matrix == "as_printed":
            raise ValueError("'as_printed' was removed, it weighs yaw twice: leave matrix out")
        return matrix


class SlipSettings(Settings):
    """Slip compensation by motor effort or yaw excitation.

    Attributes:
        maps: Fitted maps; in a configuration file the name of a shipped file or the path of one.
        use: `yaw_probe` for slip by a small yaw excitation, `surfaces` for the map that recognises the
            surface, or the name of one of the wheel maps.
        known_surfaces: Where the ground is known: the only surfaces to choose from.
        torque_correction: Also correct the set-points; None leaves them unchanged.
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
