"""`rover-hil terrain wheel`, `traverse` and `climb`: wheels and rovers on soil."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.options import ForceOption, JsonOption, out_option
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
    ReportOption,
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

RoverOption = Annotated[
    str, typer.Option("--rover", help="`paper_001`, or a TOML file; see docs/reference/terrain.md.")
]
RoverWheelOption = Annotated[
    str | None, typer.Option("--wheel", help="A wheel of the library or a TOML file [default: the rover's].")
]
SoilOption = Annotated[str, typer.Option("--soil", help="A soil of the library, or a TOML file.")]
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
    wheel_name: Annotated[
        str, typer.Option("--wheel", help="A wheel of the library, or a TOML file.")
    ] = "paper_001",
    soil_name: SoilOption = "toyoura",
    load_n: Annotated[str, typer.Option(help="Loads, `a,b,c` or `from:to:step`.")] = "58",
    slip: Annotated[str, typer.Option(help="Slip ratios, negative in skid.")] = "0:0.6:0.1",
    slip_angle_deg: Annotated[str, typer.Option(help="Slip angles, positive to the left.")] = "0,5,10,20",
    camber_deg: Annotated[
        float, typer.Option(help="Of the wheel to the left, to the surface's normal.")
    ] = 0.0,
    cross_slope_deg: Annotated[float, typer.Option(help="Of the surface, rising to the left.")] = 0.0,
    out: ReportOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Forces on a wheel over slip and slip angle, at given loads; the last list runs fastest.

    Exit code 1: the soil does not bear a load.

    Example: `rover-hil terrain wheel --slip 0:0.8:0.1 --slip-angle-deg -10,0,10`
    """
    output = Output(out, as_json, force)
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
    slope_deg: Annotated[str, typer.Option(help="Slopes, `a,b,c` or `from:to:step`.")] = "20",
    roll_deg: Annotated[str, typer.Option(help="Rolls of the rover towards uphill.")] = "0:20:5",
    mass_kg: Annotated[str | None, typer.Option(help="Masses [default: the rover's, 23.8].")] = None,
    rover_name: RoverOption = "paper_001",
    wheel_name: RoverWheelOption = None,
    soil_name: SoilOption = "toyoura",
    model: Annotated[
        Path | None, typer.Option(help="A model.toml by `gap side-slope`: adds the effects in it.")
    ] = None,
    out: ReportOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Slip, slip angle and sinkage of a rover that crosses a side slope steadily (paper 001).

    All combinations: slope by slope, in each roll by roll, in each mass by mass. Exit code 1: no equilibrium.

    Example: `rover-hil terrain traverse --slope-deg 10,15,20 --roll-deg 0:20:5 --mass-kg 23.8 --out slope`
    """
    output = Output(out, as_json, force)
    choice = Choice(rover_name, wheel_name, soil_name)
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


def climb(
    slope_deg: Annotated[str, typer.Option(help="Slopes, `a,b,c` or `from:to:step`.")] = "0:35:5",
    mass_kg: Annotated[float | None, typer.Option(help="Mass [default: the rover's, 23.8].")] = None,
    slip_limit: Annotated[float, typer.Option(help="Greatest slip ratio that counts as a climb.")] = 0.6,
    rover_name: RoverOption = "paper_001",
    wheel_name: RoverWheelOption = None,
    soil_name: SoilOption = "toyoura",
    out: ReportOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Slip up and down slopes, and the steepest slopes, compared with the wheels measured in paper 002.

    Exit code 1: the rover does not even drive on level ground.

    Example: `rover-hil terrain climb --wheel wh31 --soil hit_lss1`
    """
    output = Output(out, as_json, force)
    choice = Choice(rover_name, wheel_name, soil_name)
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


def papers(
    out: Annotated[Path, out_option("Folder for report.html and CSV.")],
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Write one report with the conditions of paper 001 and the wheels of paper 002.

    Example: `rover-hil terrain papers --out papers`
    """
    output = Output(out, as_json, force)
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
