"""Thrust of a propeller: one number per run."""

from rover_hil.gap import Channel, EffectCard, Parameter


def card(name, sentence, strength, claim, experiment):
    """Define an effect on the test stand."""
    return EffectCard(
        name=name,
        sentence=sentence,
        place="test stand",
        parameters=(strength,),
        claims=(claim,),
        experiment=experiment,
        source="propeller handbook",
    )


class Propeller:
    """Thrust of a propeller in wind: a coefficient that falls with the advance ratio."""

    name = "propeller"
    channels = (Channel(name="thrust", unit="N"),)
    condition_units = {"rate": "1/s", "wind": "m/s"}
    parameters = (
        Parameter(name="coefficient", unit="1", nominal=0.11, prior_sd=0.004, lower=0.02, upper=0.5),
    )
    effects = (
        card(
            "tip_loss",
            "The tips lose thrust as they turn faster.",
            Parameter(name="share", unit="s", nominal=0.0, prior_sd=0.001, lower=0.0, upper=0.008),
            "grows with the rate; none at slow rates",
            "one wind, rising rate",
        ),
        card(
            "scale_zero",
            "The scale shows a force at rest.",
            Parameter(name="force", unit="N", nominal=0.0, prior_sd=0.1, lower=-2.0, upper=2.0),
            "the same at every rate and wind",
            "the propeller at rest",
        ),
        card(
            "wind_error",
            "The wind is stronger or weaker than it was set.",
            Parameter(name="share", unit="1", nominal=0.0, prior_sd=0.1, lower=-0.8, upper=0.8),
            "none without wind",
            "an anemometer beside the propeller",
        ),
    )

    def predict(self, runs, parameters, effects):
        """Predict each run."""
        coefficient = parameters.get("coefficient", 0.11)
        loss = effects.get("tip_loss", {}).get("share", 0.0)
        zero = effects.get("scale_zero", {}).get("force", 0.0)
        more_wind = effects.get("wind_error", {}).get("share", 0.0)
        diameter, density = 0.25, 1.2
        tables = []
        for run in runs:
            rate = run.conditions["rate"]
            advance = run.conditions["wind"] * (1.0 + more_wind) / (rate * diameter)
            thrust = coefficient * (1.0 - advance / 1.1) * density * rate**2 * diameter**4
            tables.append({"thrust": thrust * (1.0 - loss * rate) + zero})
        return tables


def make():
    """Make the model."""
    return Propeller()
