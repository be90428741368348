"""The area of the rover in configurations, runs, logs and pictures."""

import base64
import json
import re
from pathlib import Path

import pytest
from pydantic_core import from_json, to_json

from controllers.control_loop import StepOutput
from controllers.motion.settings import ByHandMission
from controllers.operator import OperatorInput
from controllers.safety import Mode
from controllers.safety.area import CircleArea, PolygonArea
from rover_hil.config import Config, load_config, read_config_text
from rover_hil.recording.data_files import restore_config, with_controller_of
from rover_hil.recording.reader import LogReader
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView, End
from rover_hil.run.replay import replay
from tests.rover_hil.command import Command, assert_one_sentence

BOX = "{ x_min_m = -0.5, x_max_m = 1.5, y_min_m = -0.5, y_max_m = 1.0 }"
CORNERS = ((-0.5, -0.5), (1.5, -0.5), (1.5, 1.0), (-0.5, 1.0))


def write_config(*, area: str = "", old_area: str = "") -> str:
    text = read_config_text("robotino").replace("#:schema", "#").replace('"paper_like"', '"floor_table"')
    if old_area:
        text = text.replace("[mission]\n", f"[mission]\narea = {old_area}\n")
    Path("rover.toml").write_text(text + (f"\n[safety.area]\n{area}\n" if area else ""), "utf-8")
    return "rover.toml"


@pytest.mark.usefixtures("command")
def test_the_area_of_the_mission_is_that_of_the_rover_now(capsys: pytest.CaptureFixture[str]) -> None:
    config = load_config(write_config(old_area=BOX))
    assert config.safety.area == PolygonArea(type="polygon", points_m=CORNERS)
    assert config.safety.settle_s == 3.0  # its other keys stay
    (note,) = capsys.readouterr().err.splitlines()
    assert "mission.area is now [safety.area]" in note
    assert "points_m = [[-0.5, -0.5], [1.5, -0.5], [1.5, 1.0], [-0.5, 1.0]]" in note


@pytest.mark.parametrize(
    ("old_area", "area"),
    [
        (BOX, 'type = "circle"\ncentre_m = [0.4, 0.2]\nradius_m = 2'),
        (BOX.replace("-0.5, x_max_m", "1.6, x_max_m"), ""),
        ("{ x_min_m = -0.5 }", ""),
        (BOX.replace("1.5", '"far"'), ""),
        ("3", ""),
    ],
)
def test_an_area_of_the_mission_that_is_not_read_is_one_sentence(
    command: Command, old_area: str, area: str
) -> None:
    assert command("check", write_config(area=area, old_area=old_area), "--json") == 1
    (mistake,) = json.loads(command.out)["mistakes"]
    assert "mission.area: the area of plan and rover is [safety.area] now" in mistake


@pytest.mark.parametrize(
    ("area", "words"),
    [
        ('type = "polygon"\npoints_m = [[0, 0], [1, 0]]', "safety.area.points_m: "),
        ('type = "polygon"\npoints_m = [[-1, -1], [2, 2], [2, -1], [-1, 1]]', "meets"),
        ('type = "polygon"\npoints_m = [[-1, 0], [1, 0], [2, 0]]', "enclose no area"),
        ('type = "polygon"\npoints_m = [[-1, nan], [1, 0], [2, 0]]', "safety.area.points_m.0.1: "),
        ('type = "circle"\ncentre_m = [0, 0]\nradius_m = 0', "safety.area.radius_m: "),
        ('type = "circle"\ncentre_m = [0, inf]\nradius_m = 2', "safety.area.centre_m.1: "),
        ('type = "box"', "safety.area: "),
        (
            'type = "circle"\ncentre_m = [0.4, 0.2]\nradius_m = 0.6',
            "mission: on the line from 0, 0 to 0.9, 0 m",
        ),
        ('type = "circle"\ncentre_m = [3, 0]\nradius_m = 2.5', "safety.area: the rover starts at 0, 0 m"),
    ],
)
def test_an_area_that_is_none_or_that_the_mission_leaves_is_one_sentence(
    command: Command, area: str, words: str
) -> None:
    assert command("check", write_config(area=area), "--json") == 1
    (mistake,) = json.loads(command.out)["mistakes"]
    assert words in mistake
    assert "\n" not in mistake
    assert command("run", "rover.toml", "--virtual") == 2
    assert_one_sentence(command.error, words)


def test_check_draws_the_area(command: Command) -> None:
    name = write_config(area='type = "circle"\ncentre_m = [0.4, 0.2]\nradius_m = 1.5')
    assert command("check", name, "--preview", "mission.html") == 0, command.out
    (picture,) = re.findall(r'svg\+xml;base64,([^"]+)"', Path("mission.html").read_text("utf-8"))
    assert b"<!-- area -->" in base64.b64decode(picture)


class Hand:
    """Drives ahead by hand, and after the stop confirms and drives back."""

    def __init__(self) -> None:
        self._stopped: list[StepOutput] = []
        self.outputs: list[StepOutput] = []

    def wanted(self) -> OperatorInput | None:
        is_back = len(self._stopped) > 10
        motion = (-0.1 if is_back else 0.15, 0.0, 0.0)
        return OperatorInput(motion=motion, is_confirmed=len(self._stopped) == 10)

    def end(self) -> tuple[End, str] | None:
        return None

    def show(self, view: CycleView) -> None:
        self.outputs.append(view.output)
        if view.output.waits_for_operator or self._stopped:
            self._stopped.append(view.output)


def make_config() -> Config:
    config = load_config("robotino")
    area = CircleArea(type="circle", centre_m=(0.0, 0.0), radius_m=0.3)
    safety = config.safety.model_copy(update={"area": area, "settle_s": 0.2})
    mission = ByHandMission(type="by_hand", speed_m_s=0.15)
    return config.model_copy(update={"slip": None, "safety": safety, "mission": mission})


def test_a_run_that_was_stopped_at_the_border_and_confirmed_replays_exactly(tmp_path: Path) -> None:
    path, hand = tmp_path / "run.mcap", Hand()
    run_virtual(make_config(), path, 4.0, None, operator=hand)
    modes = [output.mode for output in hand.outputs]
    stopped = modes.index(Mode.SAFE_STOP)
    assert Mode.RUNNING in modes[stopped:]
    assert modes[-1] is Mode.RUNNING
    assert not hand.outputs[-1].suspicion  # inside again
    log = LogReader(path)
    records = [
        (message.topic, record)
        for message in log.messages()
        if message.topic in ("/operator", "/estimate") and isinstance(record := message.json(), dict)
    ]
    confirmed = [record["is_confirmed"] for _, record in records if "is_confirmed" in record]
    assert confirmed == [True]
    waited = [record["waits_for_operator"] for _, record in records if "waits_for_operator" in record]
    assert waited == [True] * sum(output.waits_for_operator for output in hand.outputs)
    with restore_config(log) as config:
        assert not replay(log, config, lambda: None).differences
        # The drive is what it was, also where another controller has an area.
        assert with_controller_of(config, config).safety.area is None


def test_a_log_with_the_area_of_the_mission_replays_exactly_and_gets_no_stop(tmp_path: Path) -> None:
    """The version before checked the plan only: the region of this rover leaves the box."""
    path = tmp_path / "run.mcap"
    config = load_config("robotino").model_copy(update={"slip": None})
    run_virtual(config, path, 8.0, None)
    log = LogReader(path)
    table = from_json(log.config_json)
    table["mission"]["area"] = {"x_min_m": 0.0, "x_max_m": 0.9, "y_min_m": 0.0, "y_max_m": 0.4}
    del table["safety"]["area"]
    log.config_json = to_json(table)
    with restore_config(log) as restored:
        assert restored.safety.area is None
        result = replay(log, restored, lambda: None)
    assert not result.differences
    assert result.cycles > 300


@pytest.mark.parametrize("area", [None, 3])
def test_the_configuration_of_a_log_without_an_area_is_read(tmp_path: Path, area: object) -> None:
    path = tmp_path / "run.mcap"
    run_virtual(load_config("robotino").model_copy(update={"slip": None}), path, 0.1, None)
    log = LogReader(path)
    table = from_json(log.config_json)
    table["mission"]["area"] = area
    log.config_json = to_json(table)
    with restore_config(log) as restored:
        assert restored.mission == load_config("robotino").mission
