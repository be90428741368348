"""The rover that `tune logs` tunes, also where only its logs describe it."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rover_hil.config import Config, load_config, read_config_text
from rover_hil.config.tune_settings import LogTuneSettings, TunableSettings, TuneSettings
from rover_hil.drives.formats.described_rover import is_configuration, load_rover
from rover_hil.drives.toml_text import toml_text
from rover_hil.run.checks import ROVER_CHECKS
from rover_hil.tune.parameters import unit_of

OF_GYRO = {"gyro_noise_rad_sqrt_s": (1e-5, 0.05), "gyro_rate_noise_rad_s": (1e-4, 0.1)}
OF_WHEELS = {"wheel_yaw_noise_rad_sqrt_rad": (1e-3, 1.0), "wheel_yaw_noise_rad_sqrt_m": (1e-3, 1.0)}
OF_HEADINGS = {"heading_noise_rad": (0.005, 0.5)}
OF_SLIP = {"slip_sd": (1e-3, 1.0)}
"""Keys of [filter], and of [ground], that are tuned where nothing is marked, with the ranges of the shipped
rovers."""


class TunedRover(NamedTuple):
    """What is tuned.

    Attributes:
        config: The rover; has [tune.logs].
        text: The configuration into which the values are written.
    """

    config: Config
    text: str


def tuned_rover(source: str) -> TunedRover:
    """Return the rover of a configuration; or that of a log or a file of columns.

    The latter have the noise of their sensors tuned where they mark nothing as tunable.

    Raises:
        ConfigError: The file cannot be read, or holds mistakes; one line per mistake.
        LogError: The log cannot be read.
    """
    if is_configuration(source):
        return TunedRover(load_config(source, ROVER_CHECKS), read_config_text(source))
    config = load_rover(source)
    if config.tune is None or config.tune.logs is None:
        tune = config.tune or TuneSettings()
        if config.ground.slip != "firm":
            ground = config.ground.model_copy(update={"slip_sd": config.ground.prior().sd})
            config = config.model_copy(update={"ground": ground})
        logs = LogTuneSettings(parameters=dict(_sensor_noise(config)))
        config = config.model_copy(update={"tune": tune.model_copy(update={"logs": logs})})
    return TunedRover(config, _text_of(config))


def _sensor_noise(config: Config) -> Iterator[tuple[str, TunableSettings]]:
    """Yield the noise of the sensors of a rover with its ranges, which contain the present values."""
    roles = config.roles
    of_filter = (OF_WHEELS if roles.gyro is None else OF_GYRO) | (OF_HEADINGS if roles.headings else {})
    # The numbers of firm ground are fixed.
    of_ground = {} if config.ground.slip == "firm" else OF_SLIP
    for section, ranges in (("ground", of_ground), ("filter", of_filter)):
        for key, (low, high) in ranges.items():
            present = getattr(getattr(config, section), key)
            yield (
                f"{section}.{key}",
                TunableSettings(
                    low=min(low, present) if present > 0.0 else low,
                    high=max(high, present),
                    scale="log",
                    unit=unit_of(key) or "1",
                ),
            )


def _text_of(config: Config) -> str:
    """Return a configuration as TOML; its data files are named, not held."""
    table = config.model_dump(mode="json", by_alias=True, exclude_none=True)
    for name, device in config.devices.items():
        for key in device.data_file_keys:
            if key in table["devices"][name]:
                table["devices"][name][key] = Path(table["devices"][name][key]).name
    return toml_text(table)
