"""Pictures of a page."""

import base64
import io

from matplotlib.figure import Figure


def data_uri(figure: Figure) -> str:
    """Return a figure as an SVG picture inside an address; the same figure gives the same text."""
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(stream.getvalue()).decode()
