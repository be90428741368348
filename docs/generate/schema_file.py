"""The JSON schema of a configuration, for editors, from the settings classes and their docstrings.

Editors with Taplo or tombi (Even Better TOML) read draft 7 and know no null, which TOML does not have.
"""

import json
from collections.abc import Iterator
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from controllers.estimation.settings import MotorFields
from controllers.slip.effort.gyro_response import GyroResponse
from docs.generate.configuration_page import FILES, attributes_of, is_tag, summary_of, unit_of
from drivers.settings import Settings
from rover_hil.config import Config
from sim_backends.plants.wheels.settings import WheelsPlantSettings

DRAFT = "http://json-schema.org/draft-07/schema#"
PLACE = "#/definitions/"
NAMED_FILES = (*FILES, GyroResponse, MotorFields)
FILLED_IN: dict[type[Settings], str] = {WheelsPlantSettings: "wheels"}
"""Required keys that the loader fills in."""

Schema = dict[str, Any]


class _ConfigSchema(GenerateJsonSchema):
    """Gives every key its meaning, and requires the keys that select a table."""

    def model_schema(self, schema: Any) -> JsonSchemaValue:
        """Return the schema of one settings class."""
        kind: type[Settings] = schema["cls"]
        table = super().model_schema(schema)
        table["description"] = summary_of(kind)
        table.pop("title", None)
        meanings = attributes_of(kind)
        keys = {field.alias or name: (name, field) for name, field in kind.model_fields.items()}
        for key, place in table.get("properties", {}).items():
            name, field = keys[key]
            meaning = meanings.get(name, "")
            if is_tag(name, field):
                meaning = "Selects this table."
                table["required"] = list(dict.fromkeys([*table.get("required", ()), key]))
            table["properties"][key] = _described(place, key, meaning, field.annotation)
        if kind in FILLED_IN:
            table["required"] = [key for key in table["required"] if key != FILLED_IN[kind]]
        return table


def schema_text() -> str:
    """Return the schema as JSON text."""
    schema = Config.model_json_schema(schema_generator=_ConfigSchema, ref_template=PLACE + "{model}")
    definitions = {name: _simplified(table) for name, table in schema.pop("$defs").items()}
    schema = {"$schema": DRAFT, "title": "rover-hil-config/1", **_simplified(schema)}
    used: dict[str, Schema] = {}
    pending = sorted(_references(schema))
    while pending:
        name = pending.pop()
        if name not in used:
            used[name] = definitions[name]
            pending += _references(used[name])
    schema["definitions"] = dict(sorted(used.items()))
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _described(place: Schema, key: str, meaning: str, annotation: Any) -> Schema:
    """Return the schema of a key with its meaning and unit."""
    unit = unit_of(key)
    text = f"{meaning} [{unit}]" if unit and meaning else meaning
    if any(kind in NAMED_FILES for kind in _classes_in(annotation)):
        place = {"type": ["string", "object"]}
    elif "$ref" in place:
        place = {"allOf": [{"$ref": place["$ref"]}]}  # draft 7 ignores what stands beside a reference
    place.pop("title", None)
    if isinstance(place.get("default"), dict) or place.get("default", 0) is None:
        place.pop("default")
    return {"description": text, **place} if text else place


def _classes_in(annotation: Any) -> Iterator[Any]:
    if get_origin(annotation) in (Union, UnionType):
        for argument in get_args(annotation):
            yield from _classes_in(argument)
    else:
        yield get_args(annotation)[0] if hasattr(annotation, "__metadata__") else annotation


def _simplified(value: Any) -> Any:
    """Return a schema in draft 7, without null."""
    if isinstance(value, list):
        return [_simplified(item) for item in value]
    if not isinstance(value, dict):
        return value
    found = {key: _simplified(item) for key, item in value.items() if key != "discriminator"}
    choices = [item for item in found.get("anyOf", ()) if item != {"type": "null"}]
    if len(choices) == 1:
        del found["anyOf"]
        only = choices[0]
        found = {**({"allOf": [only]} if "$ref" in only else only), **found}
    elif choices:
        found["anyOf"] = choices
    items = found.pop("prefixItems", None)
    if items:
        found["items"] = items[0] if all(item == items[0] for item in items) else items
    return found


def _references(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, item in value.items():
            if key == "$ref":
                yield item.removeprefix(PLACE)
            else:
                yield from _references(item)
    elif isinstance(value, list):
        for item in value:
            yield from _references(item)
