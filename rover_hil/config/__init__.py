"""The configuration of a rover: its schema, the reader of its file, and the texts of its errors."""

from rover_hil.config.schema import (
    Config,
    LoopSettings,
    RoleSettings,
    describe_validation_error,
    load_config,
    load_slip_map,
    read_config_text,
    shipped_configs,
)

__all__ = [
    "Config",
    "LoopSettings",
    "RoleSettings",
    "describe_validation_error",
    "load_config",
    "load_slip_map",
    "read_config_text",
    "shipped_configs",
]
