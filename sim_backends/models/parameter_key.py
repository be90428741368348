"""Which parameter a number belongs to: of the model or an effect, of all runs or a single one."""

from dataclasses import dataclass

SEPARATOR = "."
"""Between the name of an effect and that of its parameter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterKey:
    """A parameter of a model or of an effect, in all runs or in one.

    Attributes:
        name: Of the parameter.
        effect: Whose parameter it is; empty for one of the model.
        run: The run, or the unit under test, that it belongs to; empty for all runs.
        is_deviation: It is the deviation of this run or unit from the value for all runs.
    """

    name: str
    effect: str = ""
    run: str = ""
    is_deviation: bool = False

    @property
    def is_base(self) -> bool:
        """True for a parameter of the model for all runs."""
        return not self.effect and not self.run

    @property
    def is_of_effect(self) -> bool:
        """True for a parameter of an effect for all runs."""
        return bool(self.effect) and not self.run

    @property
    def shared(self) -> "ParameterKey":
        """The same parameter in whatever run."""
        if not self.run:
            return self
        return ParameterKey(name=self.name, effect=self.effect, is_deviation=self.is_deviation)

    @property
    def text(self) -> str:
        """What models and files call it: `NAME`, `EFFECT.NAME`, `NAME@RUN`; a deviation `NAME~@RUN`."""
        owner = f"{self.effect}{SEPARATOR}" if self.effect else ""
        run = f"@{self.run}" if self.run else ""
        return f"{owner}{self.name}{'~' if self.is_deviation else ''}{run}"


def joined_name(effect: str, parameter: str) -> str:
    """Return what a parameter of an effect is called among those of a model that has the effect."""
    return ParameterKey(effect=effect, name=parameter).text


def read_key(text: str) -> ParameterKey:
    """Return the parameter for all runs that a name among those of a model stands for."""
    effect, _, name = text.rpartition(SEPARATOR)
    return ParameterKey(effect=effect, name=name)
