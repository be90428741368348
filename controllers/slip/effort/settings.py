"""Settings of slip compensation."""

from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.learned_bracket import LearnedBracket
from controllers.slip.effort.slip_map import SlipMapFile
from controllers.slip.effort.yaw_excitation import ExcitationSettings
from drivers.settings import Settings

SURFACES = "surfaces"
YAW_PROBE = "yaw_probe"


class TorqueCorrectionSettings(Settings):
    """Strength of the torque correction of paper 003. It is positive feedback, so it is bounded.

    Attributes:
        matrix: `dual` is R J^-T, the inverse of the statics; the matrix printed in paper 003 counts the yaw
            twice.
        gain_rad_s_nm: Change of a setpoint per torque.
        bound_rad_s: Greatest change of a setpoint.
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
    """How wheel slip is estimated and compensated.

    Attributes:
        maps: Fitted maps: name of a shipped file or path of one.
        use: `yaw_probe` excites the yaw a little and reads the slip from the body's response; `surfaces` uses
            the map of the recognised surface; the name of a wheel map uses that one.
        known_surfaces: Where the ground is known: only these surfaces are considered.
        gyro_response: Constants of the gyro by `rover-hil calibrate imu`: path of the file. Without them the
            yaw excitation gives the least slip that a gyro late by 0 to 40 ms may show, with a larger
            standard deviation, and says so.
        learned_bracket: What `rover-hil commission` with pose fixes has learned of the reading of the yaw
            excitation on this rover's ground: path of the file. Outside of what was driven then, and with
            another gyro or excitation, the reading is that without it.
        excite_beside_ground: The excitation goes on while a camera measures the slip: so `commission` learns.
        unknown_ground: What is used where the drive force fits no known surface, or several that differ in
            slip. `encoders`: the last valid slip, which decays to zero. `map`: the map nevertheless, as in
            paper 003. Either way the slip is flagged as not valid. Not used by `yaw_probe`.
        learn: Learns slip over drive force of the ground, from the yaw excitation and from pose fixes, and
            uses it where there is no other valid slip.
        excitation_rest_s: With `learn`: the excitation rests for this time after three valid windows, 3 s at
            2 Hz, while the learned curve is valid; 0 for no rest.
        excite_real_rover: Excite the yaw of a real rover, too: `rover-hil commission CONFIG --enter` sets
            it where the excitation has passed. Without it a real run with `yaw_probe` does not compensate
            slip, and says so.
        excitation: The yaw excitation, and mass and inertia of the rover.
        torque_correction: Also corrects the setpoints; without it they stay as they are.
    """

    maps: SlipMapFile
    use: str = SURFACES
    known_surfaces: tuple[str, ...] = ()
    gyro_response: GyroResponse | None = None
    learned_bracket: LearnedBracket | None = None
    excite_beside_ground: bool = False
    unknown_ground: Literal["encoders", "map"] = "encoders"
    learn: bool = False
    excitation_rest_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0
    excite_real_rover: bool = False
    excitation: ExcitationSettings = ExcitationSettings()
    torque_correction: TorqueCorrectionSettings | None = None

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        uses = (SURFACES, YAW_PROBE, *self.maps.wheel_maps)
        if self.use not in uses:
            names = ", ".join(uses)
            raise ValueError(f"use is '{self.use}', but there are {names}: name one of these")
        shipped = [surface.name for surface in self.maps.surfaces.surfaces]
        for name in self.known_surfaces:
            if name not in shipped:
                raise ValueError(f"known_surfaces has '{name}', but the map knows {', '.join(shipped)}")
        return self

    @model_validator(mode="after")
    def _check_rest(self) -> Self:
        if self.excitation_rest_s > 0.0 and not (self.learn and self.use == YAW_PROBE):
            raise ValueError(
                "excitation_rest_s needs learn = true and use = 'yaw_probe': set both, or leave it out"
            )
        return self
