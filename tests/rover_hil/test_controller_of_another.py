"""`replay --config` takes the whole controller of another configuration, and nothing else of it."""

from controllers.safety.settings import SafetySettings
from controllers.settings import ControlSettings
from drivers.settings import Settings
from rover_hil.config import Config, load_config
from rover_hil.recording.data_files import with_controller_of

SECTIONS = set(ControlSettings.model_fields)


def test_every_section_of_the_controller_comes_from_the_other_configuration() -> None:
    logged = load_config("robotino")
    others = {name: Settings() for name in Config.model_fields} | {"safety": SafetySettings()}
    other = logged.model_copy(update=others)
    used = with_controller_of(logged, other)
    from_other = {name for name in Config.model_fields if getattr(used, name) is getattr(other, name)}
    assert from_other == SECTIONS
    assert all(getattr(used, name) is getattr(logged, name) for name in set(Config.model_fields) - SECTIONS)


def test_a_log_without_a_mission_stays_without() -> None:
    logged = load_config("robotino")
    observed = logged.model_copy(update={"mission": None})
    assert with_controller_of(observed, logged).mission is None
    assert with_controller_of(logged, observed).mission is logged.mission
