"""`rover-hil terrain wheel`, `traverse` and `climb`: wheels and rovers on soil."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from drivers.errors import ConfigError
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.terrain.climb import (
    limits_table,
    measured_table,
    slope_solver,
    slopes_table,
    solve_slopes,
)
from rover_hil.terrain.number_list import parse_numbers
from rover_hil.terrain.setup import (
    Choice,
    Output,
    announced_soil,
    choose_kernel,
    say,
    waited_for,
    with_progress,
)
from rover_hil.terrain.table import Table
from rover_hil.terrain.traverse import Traverse, no_equilibrium, solve_traverses, traverse_table
from rover_hil.terrain.wheel import wheel_table
from sim_backends.terramechanics.slope.rover import SlopeRover
from sim_backends.terramechanics.soil.library import SoilSettings, load_wheel
from sim_backends.terramechanics.soil.quantity import check_range

STEEPEST_DEG = 45.0
WIDEST_DEG = 88.0
MASS_KG = (0.01, 1e6)
LOAD_N = (1e-3, 1e6)
SLIP = (-0.99, 1.0)
MODELLED = Choice("paper_001", None, "toyoura")
SLIP_LIMIT = 0.6
"""Of a climb in paper 002."""
CLIMBED_DEG = tuple(float(slope_deg) for slope_deg in range(0, 36, 5))
BISECTED = 30
"""About as many states as the search for the steepest slopes takes."""


def wheel(
    wheel_name: str,
    soil_name: str,
    *,
    load_n: str,
    slip: str,
    slip_angle_deg: str,
    camber_deg: float,
    cross_slope_deg: float,
    output: Output,
) -> int:
    """Print forces on a wheel at given loads; returns the exit code: 1 where the soil does not bear one.

    The lists are those of `parse_numbers`, the rest is as for `wheel_table`.

    Raises:
        ConfigError: No such wheel or soil, a malformed list, or the folder cannot be written to.
        ModelError: A number is outside its range.
    """
    output.refuse_overwrite("wheel")
    chosen, soil = load_wheel(wheel_name), announced_soil(soil_name)
    loads = parse_numbers("--load-n", load_n, "N", *LOAD_N)
    slips = parse_numbers("--slip", slip, "1", *SLIP)
    angles = parse_numbers("--slip-angle-deg", slip_angle_deg, "deg", -WIDEST_DEG, WIDEST_DEG)
    check_range("--camber-deg", camber_deg, "deg", -STEEPEST_DEG, STEEPEST_DEG)
    check_range("--cross-slope-deg", cross_slope_deg, "deg", -STEEPEST_DEG, STEEPEST_DEG)
    table = wheel_table(chosen, soil, loads, slips, angles, camber_deg, cross_slope_deg)
    if output.folder is not None:
        from rover_hil.terrain.pages import wheel_drawings, write_page

        facts = [("camber", f"{camber_deg:g}°"), ("cross slope", f"{cross_slope_deg:g}°")]
        title = f"Forces on the wheel {wheel_name} on {soil_name}"
        write_page(output.folder, title, facts, wheel_drawings(table), [table])
    output.show([table], table.records())
    return _not_borne(table)


def traverse(
    choice: Choice,
    *,
    slope_deg: str,
    roll_deg: str,
    mass_kg: str | None,
    model: Path | None,
    output: Output,
) -> int:
    """Print steady traverses of side slopes; returns the exit code: 1 where one has no equilibrium.

    Args:
        choice: Rover and soil.
        slope_deg: List of slopes.
        roll_deg: List of rolls towards uphill.
        mass_kg: List of masses; None takes the rover's.
        model: Model file of the side-slope rover that replaces the paper's model.
        output: Where results go.

    Raises:
        ConfigError: No such rover, wheel or soil, a malformed list, a model file of another rover or soil, or
            the folder cannot be written to.
        ModelError: A number is outside its range.
    """
    output.refuse_overwrite("traverse")
    rover, soil = choice.load()
    slopes = parse_numbers("--slope-deg", slope_deg, "deg", 0.0, STEEPEST_DEG)
    rolls = parse_numbers("--roll-deg", roll_deg, "deg", -STEEPEST_DEG, STEEPEST_DEG)
    masses = _masses(rover, mass_kg)
    _check_lean(soil, slopes, rolls)
    count = len(slopes) * len(rolls) * len(masses)
    facts = choice.facts(rover)
    solved: Iterator[Traverse]
    if model is None:
        solved = solve_traverses(rover, soil, slopes, rolls, masses, choose_kernel(count))
    else:
        from rover_hil.terrain.extended import extended_traverses, load_side_slope

        if choice != MODELLED:
            raise ConfigError(
                f"{model}: a model file is of the {MODELLED.rover} rover on {MODELLED.soil}; leave out "
                "--rover, --wheel and --soil"
            )
        extended = load_side_slope(model)
        facts.append(("model", f"{model.name}, with {', '.join(extended.active) or 'no effects'}"))
        solved = extended_traverses(extended, slopes, rolls, masses)
    states = with_progress(solved, count, "traverses")
    table = traverse_table(states)
    if output.folder is not None:
        from rover_hil.terrain.pages import traverse_drawings, write_page

        title = f"Traverses of side slopes of {choice.soil}"
        write_page(output.folder, title, facts, traverse_drawings(states), [table])
    output.show([table], table.records())
    failure = no_equilibrium(states)
    if failure:
        say(failure)
    return EXIT_NO if failure else EXIT_OK


def climb(choice: Choice, *, slope_deg: str, mass_kg: float | None, slip_limit: float, output: Output) -> int:
    """Print slip up and down slopes and the steepest ones; returns the exit code: 1 where none is climbed.

    Args:
        choice: Rover and soil.
        slope_deg: List of slopes.
        mass_kg: Mass; None takes the rover's.
        slip_limit: Greatest slip ratio that counts as a climb.
        output: Where results go.

    Raises:
        ConfigError: No such rover, wheel or soil, a malformed list, or the folder cannot be written to.
        ModelError: A number is outside its range.
    """
    output.refuse_overwrite("limits", "slopes", "measured_wheels")
    rover, soil = choice.load()
    slopes = parse_numbers("--slope-deg", slope_deg, "deg", 0.0, STEEPEST_DEG)
    check_range("--slip-limit", slip_limit, "1", 0.01, 0.99)
    if mass_kg is not None:
        check_range("--mass-kg", mass_kg, "kg", *MASS_KG)
        rover = rover.model_copy(update={"mass_kg": mass_kg})
    solve = slope_solver(rover, soil, choose_kernel(2 * len(slopes) + BISECTED))
    rows = with_progress(solve_slopes(solve, slopes), len(slopes), "slopes")
    limits = waited_for(lambda: limits_table(solve, slip_limit), "steepest slopes")
    measured = measured_table(slopes)
    tables = [limits, slopes_table(rows), measured]
    if output.folder is not None:
        from rover_hil.terrain.pages import climb_drawings, write_page

        title = f"Climbs and descents on {choice.soil}"
        write_page(output.folder, title, choice.facts(rover), climb_drawings(rows, measured), tables)
    output.show(tables, {table.name: table.records() for table in tables})
    if limits.rows[0][1] is None:
        reason = limits.rows[0][3]
        say(f"the rover does not even drive on level ground with slip up to {slip_limit:g}: {reason}.")
        return EXIT_NO
    return EXIT_OK


def papers(output: Output) -> int:
    """Write the conditions of paper 001 and the wheels of paper 002 as one report; returns the exit code.

    Raises:
        ConfigError: The folder cannot be written to.
    """
    from rover_hil.terrain.pages import slip_skid_drawings, traverse_drawings, write_page

    output.refuse_overwrite("traverse", "limits", "measured_wheels")
    choice = MODELLED
    rover, soil = choice.load()
    rolls = parse_numbers("roll", "0:20:5", "deg", 0.0, STEEPEST_DEG)
    states = [
        state
        for slopes, mass in (((10.0, 15.0, 20.0), 23.8), ((20.0,), 33.8))
        for state in solve_traverses(rover, soil, slopes, rolls, (mass,), choose_kernel(20))
    ]
    table = traverse_table(states)
    limits = limits_table(slope_solver(rover, soil, choose_kernel(BISECTED)), SLIP_LIMIT)
    tables = [table, limits, measured_table(CLIMBED_DEG)]
    title = "Papers 001 and 002: side slopes, slip and skid"
    if output.folder is not None:
        drawings = [*traverse_drawings(states), *slip_skid_drawings()]
        write_page(output.folder, title, choice.facts(rover), drawings, tables)
    output.show(tables, table.records())
    return EXIT_OK


def _masses(rover: SlopeRover, text: str | None) -> Sequence[float]:
    return (rover.mass_kg,) if text is None else parse_numbers("--mass-kg", text, "kg", *MASS_KG)


def _check_lean(soil: SoilSettings, slopes_deg: Sequence[float], rolls_deg: Sequence[float]) -> None:
    """Check what the laws of the side walls ask for, on slopes on which soil can lie."""
    room_deg = 90.0 - soil.friction_angle_deg - soil.wall_friction_deg
    slopes = [slope for slope in slopes_deg if slope < soil.friction_angle_deg]
    leans = [roll - slope for slope in slopes for roll in rolls_deg]
    check_range("--roll-deg less --slope-deg", leans, "deg", -room_deg, room_deg)


def _not_borne(table: Table) -> int:
    sunk = [record for record in table.records() if record["sinkage_m"] is None]
    if not sunk:
        return EXIT_OK
    first = sunk[0]
    say(
        f"the soil does not bear {first['load_n']:g} N at slip {first['slip']:g}, slip angle "
        f"{first['slip_angle_deg']:g} deg before the wheel sinks to its axle ({len(sunk)} such rows)."
    )
    return EXIT_NO
