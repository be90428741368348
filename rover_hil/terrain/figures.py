"""Pictures of traverses (as paper 001, figures 11 and 12), of a wheel's forces and of climbs."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.terrain.climb import SlopeRow
from rover_hil.terrain.table import Cell, Table
from rover_hil.terrain.traverse import Traverse

COLOURS = ("#0b63ce", "#e07a00", "#0f8a5f", "#9b4dca", "#c81e1e", "#0f7f9c", "#7a8b00", "#111827")
MARKERS = ("o", "s", "^", "D", "v", "P")
PATH_M = 1.0
MOST_PANELS = 6
MOST_LINES = 8


def plots(
    rows: int, columns: int, row_height_in: float, *, same_scale: bool = False
) -> tuple[Figure, list[Axes]]:
    """Return a figure and its plots, row by row."""
    size = (style.WIDTH_IN, row_height_in * rows + 0.5)
    figure = Figure(figsize=size, layout="constrained")
    return figure, list(figure.subplots(rows, columns, sharey=same_scale, squeeze=False).flat)


def legend(figure: Figure, axes: Axes, columns: int = 4) -> Figure:
    """Put what is drawn in one plot above all of them."""
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(list(unique.values()), list(unique), loc="outside upper left", ncols=columns)
    return figure


def curve(axes: Axes, x: Sequence[float], y: Sequence[float | None], index: int, label: str) -> None:
    """Draw one of several curves with its own colour and marker; None leaves a gap."""
    values = np.array([np.nan if value is None else value for value in y])
    axes.plot(
        np.asarray(x),
        values,
        color=COLOURS[index % len(COLOURS)],
        marker=MARKERS[index % len(MARKERS)],
        markersize=5,
        label=label,
    )


def draw_paths(states: Sequence[Traverse]) -> Figure:
    """Draw the ways over one metre in the surface, one plot per slope and mass (paper 001, figure 11)."""
    groups = list(_conditions(states).items())[:MOST_PANELS]
    columns = min(len(groups), 2)
    figure, panels = plots(-(-len(groups) // columns), columns, 2.6, same_scale=True)
    for axes, (name, group) in zip(panels, groups, strict=False):
        axes.set_title(name)
        for index, state in enumerate(group[:MOST_LINES]):
            if state.slip_angle_deg is not None:
                across = PATH_M * float(np.tan(np.radians(state.slip_angle_deg)))
                colour = COLOURS[index % len(COLOURS)]
                axes.plot([0.0, PATH_M], [0.0, across], color=colour, label=f"roll {state.roll_deg:g}°")
        axes.set_xlabel("along the slope (m)")
        axes.set_ylabel("uphill (m)")
    for axes in panels[len(groups) :]:
        axes.set_visible(False)
    return legend(figure, panels[0], 5)


def draw_slippage(states: Sequence[Traverse]) -> Figure:
    """Draw slip ratio and slip angle over the roll, one line per slope and mass (paper 001, figure 12)."""
    figure, (ratio, angle) = plots(1, 2, 3.4)
    for index, (name, group) in enumerate(_conditions(states).items()):
        ordered = sorted(group, key=lambda state: state.roll_deg)
        rolls = [state.roll_deg for state in ordered]
        curve(ratio, rolls, [state.slip for state in ordered], index, name)
        curve(angle, rolls, [state.slip_angle_deg for state in ordered], index, name)
    for axes in (ratio, angle):
        axes.set_xlabel("roll towards uphill (deg)")
    edge = [state for state in states if state.boundary]
    for axes, values in (
        (ratio, [state.slip for state in edge]),
        (angle, [state.slip_angle_deg for state in edge]),
    ):
        if edge:
            _hollow(axes, [state.roll_deg for state in edge], values)
    ratio.set_ylabel("slip ratio")
    angle.set_ylabel("slip angle (deg), negative downhill")
    angle.axhline(0.0, color="#9ca3af", linewidth=1.0)
    return legend(figure, ratio, 3)


def draw_forces(table: Table) -> Figure:
    """Draw drawbar pull, side force, torque and sinkage over the slip ratio, one line per load and angle."""
    figure, panels = plots(2, 2, 2.5)
    lines: dict[tuple[Cell, Cell], list[dict[str, Cell]]] = {}
    for record in table.records():
        lines.setdefault((record["load_n"], record["slip_angle_deg"]), []).append(record)
    loads = {load for load, _ in lines}
    for axes, column, label, scale in (
        (panels[0], "drawbar_n", "drawbar pull (N)", 1.0),
        (panels[1], "side_n", "side force to the left (N)", 1.0),
        (panels[2], "torque_nm", "torque (N m)", 1.0),
        (panels[3], "sinkage_m", "sinkage (mm)", 1000.0),
    ):
        for index, ((load, angle), records) in enumerate(list(lines.items())[:MOST_LINES]):
            name = f"{angle:g}°" if len(loads) == 1 else f"{angle:g}°, {load:g} N"
            values = [_scaled(record[column], scale) for record in records]
            curve(axes, [_value(record["slip"]) for record in records], values, index, name)
        axes.set_ylabel(label)
        axes.set_xlabel("slip ratio")
    return legend(figure, panels[0])


def draw_climbs(rows: Sequence[SlopeRow], measured: Table) -> Figure:
    """Draw the slip ratio of steady climbs (slope > 0) and descents (< 0), with paper 002's wheels."""
    figure, (axes,) = plots(1, 1, 3.6)
    slopes = [-row.slope_deg for row in reversed(rows)] + [row.slope_deg for row in rows]
    slips = [row.slip_down for row in reversed(rows)] + [row.slip_up for row in rows]
    curve(axes, slopes, slips, 0, "rover, steady state")
    records = measured.records()
    names = [column.removesuffix("_slip_up") for column in measured.columns if column.endswith("_slip_up")]
    for index, name in enumerate(names, start=1):
        down = [_scaled(record[f"{name}_slip_down"], 1.0) for record in reversed(records)]
        up = [_scaled(record[f"{name}_slip_up"], 1.0) for record in records]
        curve(axes, slopes, down + up, index, f"{name}, measured lines")
    axes.set_xlabel("slope in the direction of travel (deg)")
    axes.set_ylabel("slip ratio, negative in skid")
    return legend(figure, axes, 2)


def _hollow(axes: Axes, x: Sequence[float], y: Sequence[float | None]) -> None:
    values = np.array(y, dtype=np.float64)
    axes.plot(
        np.asarray(x), values, "o", color="white", markeredgecolor="black", markersize=9, label="boundary"
    )


def _conditions(states: Sequence[Traverse]) -> dict[str, list[Traverse]]:
    groups: dict[str, list[Traverse]] = {}
    for state in states:
        groups.setdefault(f"{state.slope_deg:g}° slope, {state.mass_kg:g} kg", []).append(state)
    return groups


def _value(cell: Cell) -> float:
    return float(cell) if isinstance(cell, int | float) else float("nan")


def _scaled(cell: Cell, scale: float) -> float | None:
    return None if cell is None else scale * _value(cell)
