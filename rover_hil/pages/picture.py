"""Pictures of a page: drawn as SVG, each with one sentence on what to look at."""

import base64
import io
from collections.abc import Callable, Iterable
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure

from rover_hil.pages.style import STYLE


class Picture(NamedTuple):
    """A picture: its title, what to look at, and the picture itself as an address that holds it."""

    title: str
    caption: str
    source: str


class Drawing(NamedTuple):
    """A picture to be drawn: title, what to look at, and how; `draw` returns None where it has no data."""

    title: str
    caption: str
    draw: Callable[[], Figure | None]


def draw_pictures(drawings: Iterable[Drawing]) -> list[Picture]:
    """Return the pictures that there is data for, in order."""
    pictures: list[Picture] = []
    with mpl.rc_context(STYLE):
        for title, caption, draw in drawings:
            figure = draw()
            if figure is not None:
                source = base64.b64encode(svg(figure)).decode()
                pictures.append(Picture(title, caption, f"data:image/svg+xml;base64,{source}"))
    return pictures


def svg(figure: Figure) -> bytes:
    """Return a figure as SVG; the same figure gives the same bytes."""
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()
