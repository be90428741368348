"""Wrong names on drives of third-party simulated rovers: five builds, one hidden cause or none.

    python -m benchmarks.gap.third_party_rovers [--first 0] [--cases 60] [--slope]

The drives are those of `tests/nature/wheeled_rover.py`, whose law of contact is another than the model's;
many cannot show their cause: all head one way, none turns, none changes its speed. Prints a line for each
case, and how many verdicts have a wrong name: NAMED with anything but the truth, or a set without it.
`--slope` takes slopes only.
"""

import argparse
import itertools
import os
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap.drive_logs import write_log
from benchmarks.gap.rover_of_wheels import ROOT
from benchmarks.gap.tricycle import write_config
from controllers.motion.rover_geometry import WheelsRoverSettings
from rover_hil.config import Config, load_config
from rover_hil.gap.data.rover_logs import read_rover_runs
from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.model import WheelsModel
from tests.nature.wheeled_rover import Driving, TrueRover, drive

DRIVES, DURATION_S = 6, 16.0
SKIDDING = ("four_fixed", "six_fixed")
STEERING = ("tricycle", "six_steered")
DRIVINGS = {
    "all headings": Driving(is_reversing=True),
    "one heading": Driving(headings="one"),
    "one heading, reversing": Driving(headings="one", is_reversing=True),
    "one heading, left": Driving(headings="one", turns="left"),
    "straight": Driving(headings="one", turns="none"),
    "straight, constant": Driving(headings="one", turns="none", speed="constant"),
    "constant": Driving(headings="one", speed="constant"),
}


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A cause in the truth.

    Attributes:
        name: Of the effect; "marker" of the base parameters of its place.
        changes: Of the true rover.
        builds: Rovers that it is tried on; empty for all.
    """

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    builds: tuple[str, ...] = ()


NONE = Hidden(name="none")
SHORTER = {"wheel_radius", "rolling_resistance", "contact_stiffness"}
"""Each makes every motion on one ground shorter by a share: one is as right as another."""
SLOPES = tuple(
    Hidden(name="side_slope", changes={"slope_deg": 15.0, "downhill_deg": downhill_deg})
    for downhill_deg in (-90.0, 0.0, 120.0)
)
HIDDEN = (
    NONE,
    Hidden(name="rotation_centre", changes={"ahead_m": 0.08}, builds=SKIDDING),
    SLOPES[0],
    Hidden(name="base_radius", changes={"wider": 0.1}, builds=("differential", *SKIDDING)),
    Hidden(name="gyro_scale", changes={"gyro_gain": 1.05}),
    Hidden(name="wheel_radius", changes={"radius_share": -0.04}),
    Hidden(name="uneven_wheel", changes={"first_larger": 0.03}, builds=("differential", *SKIDDING)),
    Hidden(name="latency", changes={"pose_age_s": 0.15}),
    Hidden(name="marker", changes={"marker": (0.06, -0.04, 0.08)}),
    Hidden(name="steering_offset", changes={"offset_rad": 0.05}, builds=STEERING),
    Hidden(name="steering_ratio", changes={"steering_gain": 1.12}, builds=STEERING),
    Hidden(name="rolling_resistance", changes={"rolling": 0.2}),
    Hidden(name="contact_stiffness", changes={"grip": 25.0}),
)
CAUSES = {
    "radius_error": "wheel_radius",
    "base_error": "base_radius",
    "stiffness_change": "contact_stiffness",
    "pose_age_s": "latency",
    "gyro_bias_rad_s": "gyro_bias",
    "marker_x_m": "marker",
    "marker_y_m": "marker",
    "marker_yaw_rad": "marker",
}


def configurations() -> dict[str, Config]:
    """Return the configuration of each build."""
    found = {"differential": load_config("docs/examples/differential.toml")}
    for name, example in (("four_fixed", "mecanum"), ("six_fixed", "six_wheels")):
        table: dict[str, Any] = load_config(f"docs/examples/{example}.toml").model_dump(by_alias=True)
        for wheel in (*table["rover"]["wheels"], *table["simulation"]["plant"]["wheels"]):
            wheel |= {"roller_deg": None, "steering": None}
        table["mission"]["heading"] = "along_path"
        found[name] = Config.model_validate(table)
    with tempfile.TemporaryDirectory() as folder:
        found["tricycle"] = write_config(Path(folder) / "tricycle.toml")
    return {**found, "six_steered": load_config("docs/examples/six_wheels.toml")}


def true_rover(config: Config, hidden: Hidden, rng: np.random.Generator) -> TrueRover:
    """Return a rover as configured, each number a little off, with what is hidden in it."""
    settings = config.rover
    assert isinstance(settings, WheelsRoverSettings)
    wheels = settings.wheels
    rover = TrueRover(
        place_m=tuple((one.x_m, one.y_m) for one in wheels),
        radius_m=wheels[0].radius_m,
        steered=tuple(index for index, one in enumerate(wheels) if one.steering is not None),
        free=tuple(index for index, one in enumerate(wheels) if not one.driven),
        grip=float(rng.uniform(90.0, 180.0)),
        rolling=float(rng.uniform(0.004, 0.02)),
        radius_share=0.001 * float(rng.standard_normal()),
        wider=0.002 * float(rng.standard_normal()),
    )
    return replace(rover, **hidden.changes)


def verdict_on(config: Config, hidden: Hidden, driving: Driving, seed: int) -> Verdict:
    """Return the verdict on drives of a true rover."""
    settings = config.require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    model, rng = WheelsModel(settings), np.random.default_rng(seed)
    rover = true_rover(config, hidden, rng)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(DRIVES):
            drive_, steering_rad = drive(rover, driving, number, rng, DURATION_S)
            path = Path(folder) / str(number) / "run.mcap"
            write_log(path, config, drive_, steering_rad=steering_rad if model.steers else None)
        runs = read_rover_runs(model, [Path(folder)])
    return analyse(model, runs).verdict


def causes(verdict: Verdict) -> list[set[str]]:
    """Return the explanations, base parameters as the effects that set them free."""

    def cause(name: str) -> str:
        return (
            "uneven_wheel"
            if name.startswith("wheel_") and name.endswith("_error")
            else CAUSES.get(name, name)
        )

    return [{cause(name) for name in names} for names in verdict.confidence_set]


def is_wrong(hidden: Hidden, verdict: Verdict) -> bool:
    """Return True where the verdict reports names as certain that are not the hidden cause."""
    return verdict.verdict in (Answer.NAMED, Answer.NAMED_SET) and not is_reported(hidden, verdict)


def is_reported(hidden: Hidden, verdict: Verdict) -> bool:
    """Return True where the hidden cause is reported, alone or in a set; no gap where nothing is hidden.

    The resistance of the ground may be reported, too: that of each true rover is not the configured one.
    """
    right = SHORTER if hidden.name in SHORTER else {hidden.name}
    is_member = any(names & right and names <= right | {"rolling_resistance"} for names in causes(verdict))
    return is_member or (hidden is NONE and verdict.verdict is Answer.NO_GAP)


def cases(*, is_slope: bool) -> list[tuple[str, Hidden, str]]:
    """Return build, cause and driving of all cases, in an order that mixes them."""
    builds = ("differential", *SKIDDING, *STEERING)
    hidden = SLOPES if is_slope else HIDDEN
    every = [
        (build, one, driving)
        for build, one, driving in itertools.product(builds, hidden, DRIVINGS)
        if not one.builds or build in one.builds
    ]
    order = np.random.default_rng(1).permutation(len(every))
    return [every[index] for index in order]


def main() -> int:
    """Print the verdicts; the exit code is 1 where a name is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--slope", action="store_true")
    arguments = parser.parse_args()
    os.chdir(ROOT)
    configs, wrong, right = configurations(), 0, 0
    chosen = list(enumerate(cases(is_slope=arguments.slope)))[arguments.first :][: arguments.cases]
    for seed, (build, hidden, driving) in chosen:
        verdict = verdict_on(configs[build], hidden, DRIVINGS[driving], seed)
        mark = "WRONG" if is_wrong(hidden, verdict) else ""
        wrong += bool(mark)
        right += is_reported(hidden, verdict)
        sets = " or ".join("+".join(names) for names in verdict.confidence_set)
        print(
            f"{seed:4} {build:12} {hidden.name:18} {driving:22} {verdict.verdict:16} {sets} {mark}",
            flush=True,
        )
    print(f"wrong names: {wrong} of {len(chosen)}; hidden cause reported, alone or in a set: {right}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
