"""Slip maps as data files: TOML with source, date and licence."""

from collections.abc import Sequence
from datetime import date
from pathlib import Path

from controllers.slip.effort.motor_model import MotorSettings
from controllers.slip.effort.slip_map import MapScore, SlipMapFile, WheelMap
from drivers.clock import wall_time_text
from drivers.files import SETTINGS_BYTES, read_bytes, resolved
from rover_hil.config import load_slip_map, validated
from rover_hil.drives.toml_text import toml_text
from rover_hil.identify.slip.identification import SlipIdentification
from rover_hil.identify.slip.scores import Score
from rover_hil.identify.slip.wheel_fit import collect_samples, fit_monotone
from rover_hil.pages.atomic_write import write_file

DIGITS = 6
"""Significant digits kept: a slip is not known to more than three."""

LICENCE_LEVELS = 3


def slip_map_file(
    identification: SlipIdentification, motor: MotorSettings, sources: Sequence[Path]
) -> SlipMapFile:
    """Return the fitted maps as what a data file holds."""
    day = wall_time_text()
    scores = {name: Score.of(errors) for name, errors in identification.cross_validation.items()}
    return SlipMapFile(
        source=", ".join(path.resolve().name for path in sources),
        fitted_on=date(int(day[:4]), int(day[4:6]), int(day[6:8])),
        licence=_licence(sources[0]),
        scale_mm_per_px=identification.scale.mm_per_px,
        motor=motor,
        wheel_maps=dict(identification.maps.wheel_maps),
        surface_wheel_maps=_surface_wheel_maps(identification),
        surfaces=identification.maps.surfaces,
        cross_validation={
            name: MapScore(rms=score.rms, bias=score.bias, n=score.n)
            for name, score in scores.items()
            if score.n
        },
    )


def write_slip_map(content: SlipMapFile, path: Path) -> None:
    """Write a data file.

    Raises:
        ConfigError: It cannot be written.
    """
    write_file(path, toml_text(content.model_dump(by_alias=True, exclude_none=True), DIGITS))


def read_slip_map(name_or_path: str) -> SlipMapFile:
    """Return the maps of a shipped data file, by its name, or of one by its path.

    Raises:
        ConfigError: It cannot be read, or holds something wrong; the message names the key.
    """
    return validated(SlipMapFile, load_slip_map(name_or_path), name_or_path)


def _surface_wheel_maps(identification: SlipIdentification) -> dict[str, WheelMap]:
    maps: dict[str, WheelMap] = {}
    for surface in identification.maps.surfaces.surfaces:
        runs = [run for run in identification.trained_on if run.surface == surface.name]
        maps[surface.name] = fit_monotone(
            collect_samples(runs, identification.scale.m_per_px), "wheel_torque_nm"
        )
    return maps


def _licence(source: Path) -> str:
    """Return the first line of the licence in the folder of the data, or above it."""
    folder = resolved(source) if source.is_dir() else resolved(source).parent
    for place in (folder, *folder.parents[: LICENCE_LEVELS - 1]):
        for path in sorted(place.glob("LICENSE*")):
            try:
                text = read_bytes(path, SETTINGS_BYTES).decode("utf-8", "replace")
            except OSError:
                continue
            lines = [line.strip() for line in text.splitlines()]
            return next((line for line in lines if line), "not stated")
    return "not stated"
