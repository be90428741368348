"""How the pictures of every report look: one colour per source, everywhere."""

import matplotlib as mpl
from matplotlib.colors import to_hex, to_rgb

COMMANDED = "#8a94a6"
TRUTH = "#111827"
ESTIMATE = "#0b63ce"
ENCODERS = "#e07a00"
GYRO = "#9b4dca"
HEADINGS = ("#0f8a5f", "#7a8b00")
MEASURED = "#0f7f9c"
STOPPED = "#f6c6c6"
NOT_VALID = "#fbe8c8"
ALARM = "#c81e1e"

WIDTH_IN = 6.9

STYLE = mpl.RcParams(
    {
        "font.size": 11.0,
        "axes.titlesize": 11.0,
        "axes.titlelocation": "left",
        "axes.labelcolor": "#374151",
        "axes.edgecolor": "#9ca3af",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": "#e5e7eb",
        "grid.linewidth": 0.8,
        "xtick.color": "#4b5563",
        "ytick.color": "#4b5563",
        "lines.linewidth": 1.6,
        "legend.frameon": False,
        "figure.facecolor": "white",
        "svg.hashsalt": "rover_hil",
        # A dollar sign in the name of a run is no formula.
        "text.parse_math": False,
    }
)


def pale(colour: str) -> str:
    """Return a colour for the noise behind a line of the given one."""
    red, green, blue = (0.35 * part + 0.65 for part in to_rgb(colour))
    return to_hex((red, green, blue))
