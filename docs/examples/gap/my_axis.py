"""A motor axis as a simulator that can only be called."""

import numpy as np

from rover_hil.gap import Channel, EffectCard, Parameter


class Axis:
    """Speed of a motor axis on voltage: T dw/dt = K u - w."""

    name = "motor axis"
    channels = (Channel(name="speed", unit="rad/s"),)
    condition_units = {"load": "kg"}
    input_units = {"voltage": "V"}
    parameters = (
        Parameter(name="gain", unit="rad/s/V", nominal=4.0, prior_sd=0.2, lower=2.0, upper=8.0),
        Parameter(name="lag", unit="s", nominal=0.25, prior_sd=0.02, lower=0.05, upper=1.0),
    )
    effects = (
        EffectCard(
            name="dry_friction",
            sentence="A torque against the motion, independent of the speed, brakes the axis.",
            place="torque at the axis",
            parameters=(
                Parameter(name="level", unit="rad/s", nominal=0.0, prior_sd=1.0, lower=0.0, upper=10.0),
            ),
            claims=("changes its sign with the speed", "does not grow with speed"),
            experiment="drive slowly in both directions",
            source="Coulomb friction over the viscous one that is in the lag",
        ),
        EffectCard(
            name="delay",
            sentence="The voltage acts later than logged.",
            place="clock",
            parameters=(Parameter(name="time", unit="s", nominal=0.0, prior_sd=0.02, lower=0.0, upper=0.2),),
            claims=("shows only where the voltage changes",),
            experiment="steps of the voltage",
            source="bus and amplifier",
        ),
        EffectCard(
            name="sag",
            sentence="The voltage of the supply falls under load.",
            place="supply",
            parameters=(
                Parameter(name="per_volt", unit="1/V", nominal=0.0, prior_sd=0.01, lower=0.0, upper=0.05),
            ),
            claims=("grows with the square of the voltage",),
            experiment="measure the voltage at the motor",
            source="inner resistance of the battery",
        ),
        EffectCard(
            name="sensor_offset",
            sentence="The speed sensor shows a speed at rest.",
            place="speed sensor",
            parameters=(
                Parameter(name="offset", unit="rad/s", nominal=0.0, prior_sd=0.5, lower=-5.0, upper=5.0),
            ),
            claims=("the same at every speed",),
            experiment="log at rest",
            source="electronics",
        ),
        EffectCard(
            name="gain_error",
            sentence="The motor constant is not the one of the data sheet.",
            place="motor",
            parameters=(
                Parameter(name="change", unit="rad/s/V", nominal=0.0, prior_sd=0.5, lower=-1.5, upper=1.5),
            ),
            claims=("proportional to the voltage",),
            experiment="a known speed",
            source="tolerance",
            releases="gain",
        ),
    )
    step_s = 0.02

    def predict(self, runs, parameters, effects):
        """Predict each run."""
        gain = parameters.get("gain", 4.0) + effects.get("gain_error", {}).get("change", 0.0)
        lag = parameters.get("lag", 0.25)
        friction = effects.get("dry_friction", {}).get("level", 0.0)
        delay = effects.get("delay", {}).get("time", 0.0)
        sag = effects.get("sag", {}).get("per_volt", 0.0)
        offset = effects.get("sensor_offset", {}).get("offset", 0.0)
        return [{"speed": offset + self.drive(run, gain, lag, friction, delay, sag)} for run in runs]

    def drive(self, run, gain, lag, friction, delay, sag):
        """Predict the speed of one run."""
        voltage = run.inputs["voltage"]
        time = self.step_s * np.arange(-1, voltage.size)  # nothing was on before the log began
        voltage = np.interp(time[1:] - delay, time, np.append(0.0, voltage), left=0.0)
        drive = gain * voltage * (1.0 - sag * np.abs(voltage))
        keep = np.exp(-self.step_s / lag)
        speed = np.zeros(voltage.size)
        for i in range(1, voltage.size):
            free = keep * speed[i - 1] + (1.0 - keep) * drive[i - 1]
            brake = (1.0 - keep) * friction
            speed[i] = np.sign(free) * max(abs(free) - brake, 0.0)
        return speed


def make():
    """Make the model."""
    return Axis()
