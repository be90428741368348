"""`rover-hil terrain`: arguments, help and exit codes; heavy modules are imported inside the commands."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from rover_hil.console.options import ClusterOption, ForceOption, Group, JsonOption, out_option
from rover_hil.run.end_signals import held_signals

terrain_app = typer.Typer(cls=Group, help="Wheels and rovers on soil: forces, slopes, soil numbers.")
RoverOption = Annotated[str, typer.Option(help="`paper_001`, or a TOML file; see docs/reference/terrain.md.")]
RoverWheelOption = Annotated[
    str | None, typer.Option(help="A wheel of the library or a TOML file [default: the rover's].")
]
SoilOption = Annotated[str, typer.Option(help="A soil of the library, or a TOML file.")]
ReportOption = Annotated[Path | None, out_option("Also write report.html and CSV into this folder.")]


@terrain_app.command("wheel")
def terrain_wheel(
    wheel: Annotated[str, typer.Option(help="A wheel of the library, or a TOML file.")] = "paper_001",
    soil: SoilOption = "toyoura",
    load_n: Annotated[str, typer.Option(help="Loads, `a,b,c` or `from:to:step`.")] = "58",
    slip: Annotated[str, typer.Option(help="Slip ratios, negative in skid.")] = "0:0.6:0.1",
    slip_angle_deg: Annotated[str, typer.Option(help="Slip angles, positive to the left.")] = "0,5,10,20",
    camber_deg: Annotated[
        float, typer.Option(help="Of the wheel to the left, to the surface's normal.")
    ] = 0.0,
    cross_slope_deg: Annotated[float, typer.Option(help="Of the surface, rising to the left.")] = 0.0,
    out: ReportOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Forces on a wheel over slip and slip angle, at given loads; the last list runs fastest.

    Exit code 1: the soil does not bear a load.

    Example: `rover-hil terrain wheel --slip 0:0.8:0.1 --slip-angle-deg -10,0,10`
    """
    with held_signals():
        from rover_hil.app.terrain import solve
        from rover_hil.terrain.setup import Output

    sys.exit(
        solve.wheel(
            wheel,
            soil,
            load_n=load_n,
            slip=slip,
            slip_angle_deg=slip_angle_deg,
            camber_deg=camber_deg,
            cross_slope_deg=cross_slope_deg,
            output=Output(out, json, force),
        )
    )


@terrain_app.command("traverse")
def terrain_traverse(
    slope_deg: Annotated[str, typer.Option(help="Slopes, `a,b,c` or `from:to:step`.")] = "20",
    roll_deg: Annotated[str, typer.Option(help="Rolls of the rover towards uphill.")] = "0:20:5",
    mass_kg: Annotated[str | None, typer.Option(help="Masses [default: the rover's, 23.8].")] = None,
    rover: RoverOption = "paper_001",
    wheel: RoverWheelOption = None,
    soil: SoilOption = "toyoura",
    model: Annotated[
        Path | None, typer.Option(help="A model.toml by `gap side-slope`: adds the effects in it.")
    ] = None,
    out: ReportOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Slip, slip angle and sinkage of a rover that crosses a side slope steadily (paper 001).

    All combinations: slope by slope, in each roll by roll, in each mass by mass. Exit code 1: no equilibrium.

    Example: `rover-hil terrain traverse --slope-deg 10,15,20 --roll-deg 0:20:5 --mass-kg 23.8 --out slope`
    """
    with held_signals():
        from rover_hil.app.terrain import solve
        from rover_hil.terrain.setup import Choice, Output

    choice = Choice(rover, wheel, soil)
    sys.exit(
        solve.traverse(
            choice,
            slope_deg=slope_deg,
            roll_deg=roll_deg,
            mass_kg=mass_kg,
            model=model,
            output=Output(out, json, force),
        )
    )


@terrain_app.command("climb")
def terrain_climb(
    slope_deg: Annotated[str, typer.Option(help="Slopes, `a,b,c` or `from:to:step`.")] = "0:35:5",
    mass_kg: Annotated[float | None, typer.Option(help="Mass [default: the rover's, 23.8].")] = None,
    slip_limit: Annotated[float, typer.Option(help="Greatest slip ratio that counts as a climb.")] = 0.6,
    rover: RoverOption = "paper_001",
    wheel: RoverWheelOption = None,
    soil: SoilOption = "toyoura",
    out: ReportOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Slip up and down slopes, and the steepest slopes, compared with the wheels measured in paper 002.

    Exit code 1: the rover does not even drive on level ground.

    Example: `rover-hil terrain climb --wheel wh31 --soil hit_lss1`
    """
    with held_signals():
        from rover_hil.app.terrain import solve
        from rover_hil.terrain.setup import Choice, Output

    choice = Choice(rover, wheel, soil)
    sys.exit(
        solve.climb(
            choice,
            slope_deg=slope_deg,
            mass_kg=mass_kg,
            slip_limit=slip_limit,
            output=Output(out, json, force),
        )
    )


@terrain_app.command("papers")
def terrain_papers(
    out: Annotated[Path, out_option("Folder for report.html and CSV.")],
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Write one report with the conditions of paper 001 and the wheels of paper 002.

    Example: `rover-hil terrain papers --out papers`
    """
    with held_signals():
        from rover_hil.app.terrain import solve
        from rover_hil.terrain.setup import Output

    sys.exit(solve.papers(Output(out, json, force)))


@terrain_app.command("fit")
def terrain_fit(
    data: Annotated[
        Path,
        typer.Argument(help="Folder of plate and wheel tests; docs/reference/terrain.md names the files."),
    ],
    wheel: Annotated[str, typer.Option(help="The wheel of the tests.")] = "cmu_smooth",
    soil: Annotated[str, typer.Option(help="Start values: a soil file, or its name.")] = "cmu_sand_blind",
    free: Annotated[str, typer.Option(help="Numbers to fit to the wheel tests, `a,b,c`.")] = (
        "shear_modulus_m,exit_share,slide_number,push_number,wake_rate,wall_number,sideways_exponent,wall_drag"
    ),
    plates_only: Annotated[bool, typer.Option("--plates-only", help="Leave out the wheel tests.")] = False,
    cluster: ClusterOption = None,
    out: ReportOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Fit a soil to plate and wheel tests, with 95 % confidence intervals.

    Example: `rover-hil terrain fit test_bed --out sand`

    Data: `rover-hil sample test_bed` writes this folder; for plates.csv and wheel.csv of your test bed,
    docs/reference/terrain.md names the columns.
    """
    with held_signals():
        from rover_hil.app.terrain.fit import fit
        from rover_hil.terrain.setup import Output

    output = Output(out, json, force)
    sys.exit(
        fit(
            data,
            wheel_name=wheel,
            soil_name=soil,
            free=free,
            plates_only=plates_only,
            output=output,
            cluster=cluster,
        )
    )
