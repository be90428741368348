"""Render a report as one page that needs nothing else."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from jinja2 import Environment, PackageLoader, StrictUndefined

PLOT_SCRIPT = Path(__file__).parent / "plot.js"
"""Draws lines on a canvas; part of the reports, and a file of the bench."""

NO_FILTERS: Mapping[str, Callable[..., str]] = MappingProxyType({})


def render(template: str, filters: Mapping[str, Callable[..., str]] = NO_FILTERS, **values: object) -> str:
    """Return a page as HTML.

    Args:
        template: Path of a template in this package, like `report/report.html`, extending `pages/base.html`.
        filters: The template's own filters, by name.
        values: What the template shows. `grade` is the colour of the header: "good", "attention", "bad",
            "neutral" or "plain".
    """
    environment = Environment(
        loader=PackageLoader("rover_hil", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(filters)
    return environment.get_template(template).render(values)
