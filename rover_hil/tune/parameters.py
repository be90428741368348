"""Tunable values of a configuration, by dotted key."""

from collections.abc import Iterator, Mapping

from controllers.control_loop import ControlLoop
from controllers.motion.missions.mission import Point
from drivers.errors import ConfigError
from rover_hil.config import Config, Draft, Rule, validated
from rover_hil.config.tune_settings import TunableSettings, TuneSettings
from rover_hil.run.checks import ROVER_CHECKS

REPLAYED = ("filter", "ground", "scomp", "slip")
"""Sections that a replay of a log depends on."""
DECIDES_READINGS = ("filter.standstill_s", "scomp.frame_period_s")
"""With other values of these the estimator has other innovations, so that the costs cannot be compared."""
FORBIDDEN = ("devices", "loop", "roles", "rover", "safety", "schema", "simulation", "tune")
SIGNIFICANT_DIGITS = 4
MISSING_LOGS = (
    "tune.logs: the configuration marks nothing as tunable by logs: add [tune.logs.parameters], see "
    "docs/how-to/tune_from_logs.md"
)
MISSING_TUNE = (
    "tune: the configuration marks nothing as tunable on the simulated rover: add [tune.parameters], see "
    "docs/how-to/bench_tuning.md; or use `tune logs`, which needs [tune.logs]"
)

UNITS = {
    "m": "m",
    "s": "s",
    "rad": "rad",
    "deg": "deg",
    "hz": "Hz",
    "m_s": "m/s",
    "m_s2": "m/s^2",
    "rad_s": "rad/s",
    "rad_s2": "rad/s^2",
    "per_s": "1/s",
    "per_rad": "1/rad",
    "rad_sqrt_s": "",
    "rad_sqrt_m": "",
    "rad_sqrt_rad": "",
    "m_sqrt_m": "",
    "m_sqrt_rad": "",
    "rad_s_sqrt_s": "",
}
"""Unit by the end of a key; empty where people write it in many ways."""
QUANTITIES = frozenset(("m", "s", "rad", "deg", "v", "a", "n", "nm", "kg"))
"""Units that may stand before `_per_`, as in `speed_constant_v_s_per_rad`."""
ALIASES = {"1/s": ("s-1", "hz", "/s"), "1/rad": ("rad-1", "/rad"), "deg": ("°",)}

Values = Mapping[str, float]
Table = dict[str, object]


def check_parameters(config: Config) -> TuneSettings:
    """Check every parameter to tune; return [tune].

    Raises:
        ConfigError: There is no [tune], no mission or no simulation; or parameters do not exist, are not
            gains, have ranges that their own limits forbid, or start outside their ranges: one line each.
    """
    if config.tune is None or not config.tune.parameters:
        raise ConfigError(MISSING_TUNE)
    if config.mission is None or config.simulation is None:
        raise ConfigError("tuning drives the mission on the simulated rover: add [mission] and [simulation]")
    ControlLoop(config, config.device_roles())  # to blame the mission itself rather than every range
    _check_all(config, config.tune.parameters, "tune.parameters")
    return config.tune


def check_log_parameters(config: Config) -> TuneSettings:
    """Check every parameter to tune by logs; return [tune] with these as its parameters.

    Raises:
        ConfigError: There is no [tune.logs]; or as for `check_parameters`.
    """
    if config.tune is None or config.tune.logs is None:
        raise ConfigError(MISSING_LOGS)
    ControlLoop(config, config.device_roles())
    parameters = config.tune.logs.parameters
    for key in parameters:
        if key.partition(".")[0] not in REPLAYED:
            raise ConfigError(
                f"tune.logs.parameters.{key}: only values of [filter], [ground], [slip] and [scomp] show in "
                "a replay; remove it, or move it to [tune.parameters]"
            )
        if key in DECIDES_READINGS:
            raise ConfigError(
                f"tune.logs.parameters.{key}: decides which readings correct the estimate, so that costs by "
                "logs cannot be compared: remove it"
            )
    _check_all(config, parameters, "tune.logs.parameters")
    return config.tune.model_copy(update={"parameters": parameters})


def _check_all(config: Config, parameters: Mapping[str, TunableSettings], table: str) -> None:
    mistakes: list[str] = []
    for key, parameter in parameters.items():
        try:
            _check(config, key, parameter, f"{table}.{key}")
        except ConfigError as error:
            mistakes.append(str(error))
    if mistakes:
        raise ConfigError("\n".join(mistakes))


def _find_mistakes(draft: Draft) -> Iterator[str]:
    try:
        check_parameters(draft.config)
    except ConfigError as error:
        yield from str(error).splitlines()


TUNE_CHECKS = (*ROVER_CHECKS, Rule(tuple(Config.model_fields), _find_mistakes, is_last=True))
"""What `tune` checks."""


def start_values(config: Config, tune: TuneSettings) -> dict[str, float]:
    """Return the current values of all parameters."""
    table = config.model_dump(by_alias=True)
    return {key: _number(table, key, key) for key in tune.parameters}


def with_values(config: Config, values: Values) -> Config:
    """Return the configuration with other values under some dotted keys.

    Raises:
        ConfigError: A value is outside its own limits.
    """
    table = config.model_dump(by_alias=True)
    for key, value in values.items():
        _place(table, key, key)[key.rpartition(".")[2]] = value
    return validated(Config, table, "tuned values")


def rounded(values: Values, tune: TuneSettings) -> dict[str, float]:
    """Return values rounded to four digits, within their ranges."""
    result: dict[str, float] = {}
    for key, value in values.items():
        parameter = tune.parameters[key]
        result[key] = min(parameter.high, max(parameter.low, float(f"{value:.{SIGNIFICANT_DIGITS}g}")))
    return result


def _check(config: Config, key: str, parameter: TunableSettings, where: str) -> None:
    section = key.partition(".")[0]
    if section in FORBIDDEN:
        raise ConfigError(f"{where}: [{section}] cannot be tuned; remove the parameter")
    start = _number(config.model_dump(by_alias=True), key, where)
    unit = unit_of(key)
    if unit and _plain(parameter.unit) not in {_plain(unit), *ALIASES.get(unit, ())}:
        raise ConfigError(
            f"{where}: unit is '{parameter.unit}', but the key is in {unit}: write low, high and unit so"
        )
    for value in (parameter.low, parameter.high):
        try:
            edge = with_values(config, {key: value})
            ControlLoop(edge, edge.device_roles())
        except ConfigError as error:
            reason = str(error).splitlines()[0]
            raise ConfigError(f"{where}: the range reaches {value:g}, but {reason}") from error
        if _path(edge) != _path(config):
            raise ConfigError(
                f"{where}: the value changes the path and cannot be tuned; remove the parameter"
            )
    if not parameter.low <= start <= parameter.high:
        raise ConfigError(
            f"{where}: the current value {start:g} is outside {parameter.low:g} to {parameter.high:g}: "
            "widen the range or change the value"
        )


def unit_of(key: str) -> str:
    """Return the unit that the end of a key names; empty where it names none, or one with a root."""
    name = f"_{key.rpartition('.')[2]}"
    of_what, per, _ = name.rpartition("_per_")
    if per and (of_what.rpartition("_")[2] in QUANTITIES or not name.endswith(("_per_s", "_per_rad"))):
        return ""
    ends = [end for end in UNITS if name.endswith(f"_{end}")]
    return UNITS[max(ends, key=len)] if ends else ""


def _plain(unit: str) -> str:
    """Return a unit as it is compared: rad/s^2, rad/s2 and rad/s² are the same."""
    return unit.replace("²", "2").replace("^", "").replace(" ", "").lower()


def _path(config: Config) -> tuple[Point, ...]:
    return () if config.mission is None else config.mission.corners()


def _number(table: Table, key: str, where: str) -> float:
    value = _place(table, key, where)[key.rpartition(".")[2]]
    if not isinstance(value, float):
        raise ConfigError(f"{where}: is not a float; only floats can be tuned: leave it out")
    return value


def _place(table: Table, key: str, where: str) -> Table:
    """Return the table that holds the last part of a dotted key."""
    place = table
    *parents, last = key.split(".")
    for parent in parents:
        inner = place.get(parent)
        if not isinstance(inner, dict):
            raise ConfigError(f"{where}: the configuration has no table '{parent}': check the key")
        place = inner
    if last not in place:
        raise ConfigError(f"{where}: unknown key; the configuration has {', '.join(place)} there")
    return place
