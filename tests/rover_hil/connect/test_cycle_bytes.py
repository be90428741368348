"""A cycle as bytes: all that is handed over comes out as it went in."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from drivers.samples import AccelerationSample, PowerSample, RateSample, WheelSample
from rover_hil.config import Config, load_config
from rover_hil.connect.cycle_bytes import FORCE, POWER, RATE, WHEEL, CyclePacker, CycleUnpacker, or_none
from rover_hil.recording.schema import health_record
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView

CONFIGS = ("robotino", "robotino-camera", "el-dorado", "el-dorado-crab")


class Seen:
    """Keeps the cycles of a run."""

    def __init__(self) -> None:
        self.views: list[CycleView] = []

    def wanted(self) -> None:
        """Want nothing."""

    def end(self) -> None:
        """End nothing."""

    def show(self, view: CycleView) -> None:
        """Keep a cycle."""
        self.views.append(view)


def views_of(config: Config, path: Path) -> list[CycleView]:
    seen = Seen()
    run_virtual(config, path, 4.0, None, operator=seen)
    return seen.views


def is_part_of(part: object, whole: object) -> bool:
    """Return whether a record has the values of another one, as far as it has keys."""
    if isinstance(part, Mapping) and isinstance(whole, Mapping):
        return all(is_part_of(value, whole[key]) for key, value in part.items())
    if isinstance(part, list | tuple) and isinstance(whole, list | tuple):
        return len(part) == len(whole) and all(map(is_part_of, part, whole))
    return bool(part == whole)


def samples_of(view: CycleView, config: Config) -> list[tuple[int, int, Sequence[float | None]]]:
    found: list[tuple[int, int, Sequence[float | None]]] = []
    for each in view.samples:
        if isinstance(each, WheelSample) and each.device == config.roles.wheels:
            found.append((WHEEL, each.t_ns, [each.wheel, each.position_rad, each.speed_rad_s]))
        elif isinstance(each, RateSample) and each.device == config.roles.gyro:
            found.append((RATE, each.t_ns, [each.rate_x_rad_s, each.rate_y_rad_s, each.rate_z_rad_s]))
        elif isinstance(each, AccelerationSample) and each.device == config.roles.gyro:
            found.append((FORCE, each.t_ns, [each.x_m_s2, each.y_m_s2, each.z_m_s2]))
        elif isinstance(each, PowerSample):
            found.append((POWER, each.t_ns, [each.voltage_v, each.current_a, None]))
    return found


@pytest.mark.parametrize("name", CONFIGS)
def test_every_value_of_a_run_comes_out_as_it_went_in(name: str, tmp_path: Path) -> None:
    config = load_config(name)
    packer, unpacker = CyclePacker(config), CycleUnpacker()
    parts = set()
    for number, view in enumerate(views_of(config, tmp_path / "run.mcap")):
        extra = {"number": number // 50}
        facts = unpacker.unpack(packer.pack(view, number, extra))
        assert (facts.offset_ns, facts.extra) == (number, extra)
        expected: dict[str, Any] = asdict(view.output)
        expected["drift"] = expected.pop("scomp")
        expected["suspicion"] = expected["suspicion"] or ""
        if expected["slip"] is not None and expected["slip"]["rover"] is not None:
            expected["slip"] = {**expected["slip"], "wheels": ()}
        assert is_part_of(facts.cycle, expected), number
        assert facts.cycle["estimate"]["covariance"] == view.output.estimate.covariance
        parts |= {key for key, value in facts.cycle.items() if value is not None}
        samples = [(kind, t_ns, [or_none(each) for each in values]) for kind, t_ns, values in facts.samples]
        assert samples == samples_of(view, config)
        assert list(facts.healths) == [
            {**health_record(each), "state": each.state.value} for each in view.healths
        ]
    expected_parts = {"robotino": "slip", "robotino-camera": "ground", "el-dorado": "drift"}
    assert expected_parts.get(name, "steering_rad") in parts


def test_text_goes_once_and_again_after_a_cycle_that_was_lost(tmp_path: Path) -> None:
    config = load_config("robotino")
    view = views_of(config, tmp_path / "run.mcap")[-1]
    packer, extra = CyclePacker(config), {"commands": "x" * 300}
    first, second = packer.pack(view, 0, extra), packer.pack(view, 0, extra)
    assert len(second) < len(first) - 300
    packer.forget()
    assert packer.pack(view, 0, extra) == first
    assert len(packer.pack(view, 0, {"commands": "y"})) > len(second)
