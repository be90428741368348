"""The pictures of a report, each with one sentence on what to look at."""

from collections.abc import Callable
from functools import partial

from matplotlib.figure import Figure

from rover_hil.pages.picture import Drawing, Picture, draw_pictures
from rover_hil.report.figures.crab import draw_crab
from rover_hil.report.figures.drift import draw_drift
from rover_hil.report.figures.ground import draw_ground_slip
from rover_hil.report.figures.pose import draw_error, draw_headings, draw_path
from rover_hil.report.figures.slip import draw_effort, draw_slip
from rover_hil.report.figures.system import draw_innovations, draw_timeline, draw_timing
from rover_hil.report.figures.wheels import draw_currents, draw_speeds
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary

Draw = Callable[[RunData, Summary], Figure | None]

PICTURES: tuple[tuple[str, str, Draw], ...] = (
    (
        "Path",
        "See where the paths part; the ground truth should lie inside the ellipses, "
        "the 95 % regions of the estimate.",
        draw_path,
    ),
    (
        "Distance from the truth",
        "See when it went wrong: a step is a single event, a slope is steady slip.",
        draw_error,
    ),
    (
        "Headings",
        "See who turns away from the others first: one degree costs 17 mm per metre driven.",
        draw_headings,
    ),
    (
        "Slip",
        "See where the wheels turned for nothing: 0 % is pure rolling, 100 % is turning without moving. "
        "The estimate should follow the truth half a second later, or be marked as not valid.",
        draw_slip,
    ),
    (
        "Slip over the ground",
        "See how far the wheels turned for nothing, measured by the camera: the truth should lie within two "
        "standard deviations, and where the ground was not measured there is no line.",
        draw_ground_slip,
    ),
    (
        "Slip and slip angle",
        "See how far the rover slid back and aside, estimated from trace and tilt.",
        draw_drift,
    ),
    (
        "Crabbing",
        "See whether the wheels are turned against their slip angle: the two mirror each other, and the "
        "rover stays on its line.",
        draw_crab,
    ),
    (
        "Effort",
        "See what the slip maps read: torque at the wheel, and M of the paper times the gear ratio, "
        "mostly copper loss at low speed.",
        draw_effort,
    ),
    (
        "Motor currents",
        "See which wheel works hardest, and when: soft ground and slopes ask for more current.",
        draw_currents,
    ),
    (
        "Wheel speeds",
        "See whether the wheels follow their setpoints: the measured speed should lie on the setpoint.",
        draw_speeds,
    ),
    (
        "Time-line",
        "See what held the rover up: safety stops, broken links and the watchdog are red.",
        draw_timeline,
    ),
    (
        "Innovations",
        "See whether the sensors agree with the estimate: "
        "95 % of the dots should lie inside the band of two standard deviations.",
        draw_innovations,
    ),
    (
        "Timing",
        "See whether the computer is fast enough: everything should end well to the left of the period.",
        draw_timing,
    ),
)


def draw_report(run: RunData, summary: Summary) -> list[Picture]:
    """Return the pictures that the log has data for, in the order of the report."""
    return draw_pictures(
        Drawing(title, caption, partial(draw, run, summary)) for title, caption, draw in PICTURES
    )
