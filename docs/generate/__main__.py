"""`python -m docs.generate FOLDER`: write the reference pages, the manual page and the JSON schema."""

import sys
from pathlib import Path

from docs.generate.commands_page import commands_page
from docs.generate.configuration_page import configuration_page, mapping_page
from docs.generate.effects_page import effects_page
from docs.generate.gap_pages import models_page, unit_page
from docs.generate.man_page import man_page
from docs.generate.safety_page import safety_page
from docs.generate.schema_file import schema_text
from rover_hil.config.loader import SCHEMA_NAME, SHIPPED_CONFIGS

PAGES = {
    "configuration.md": configuration_page,
    "can_mapping.md": mapping_page,
    "commands.md": commands_page,
    "safety.md": safety_page,
    "gap_models.md": models_page,
    "gap_effects.md": effects_page,
    "gap_fmu.md": unit_page,
}

MAN_PAGE = "rover-hil.1"


def write_pages(folder: Path) -> None:
    """Write every generated page, the manual page, and the schema."""
    for name, make_page in PAGES.items():
        (folder / name).write_text(make_page(), "utf-8")
    (folder / MAN_PAGE).write_text(man_page(), "utf-8")
    (folder / SCHEMA_NAME).write_text(schema_text(), "utf-8")


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]))
    (Path(str(SHIPPED_CONFIGS)) / SCHEMA_NAME).write_text(schema_text(), "utf-8")
