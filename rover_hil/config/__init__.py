"""The configuration of a rover: its schema, the reader of its file, and the texts of its errors."""

from rover_hil.config.error_text import describe_validation_error, validated
from rover_hil.config.loader import (
    load_config,
    load_slip_map,
    read_config_table,
    read_config_text,
    read_rig,
    schema_text,
    shipped_configs,
)
from rover_hil.config.schema import BenchSettings, Config, Draft, LoopSettings, RoleSettings, Rule

__all__ = [
    "BenchSettings",
    "Config",
    "Draft",
    "LoopSettings",
    "RoleSettings",
    "Rule",
    "describe_validation_error",
    "load_config",
    "load_slip_map",
    "read_config_table",
    "read_config_text",
    "read_rig",
    "schema_text",
    "shipped_configs",
    "validated",
]
