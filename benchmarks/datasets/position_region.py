"""Is the position region right, and of use? Compare it with the ground truth of drives on known grounds.

    python -m tests.nature.region_drives FOLDER --seed 1
    python -m benchmarks.datasets.position_region FOLDER --record record.json [--without-setting]

Each folder holds the tables of a drive, its configuration, and `answer.json` with its `[ground]`, written
before. The drive is imported by `import table --no-estimate`, and estimated as
`replay --config` does it. `--without-setting` leaves `[ground]` out, for versions that have none. `--judge
record.json` prints the tables of an earlier run again.

Regions are those of x, y and yaw at 95 % (chi-square, 3 degrees of freedom), at the end and at every 2 m
by the wheels. The radius at 95 % is that of the circle that contains the position with 95 % by the
covariance. A drive of the set `contradicted` is reported with the first finding or warning about the ground
after the slip began; with any before that, it is a false report.
"""

import argparse
import json
import math
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass, field
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import chi2, norm

from benchmarks.wilson import share_text
from controllers.control_loop import StepOutput
from rover_hil.app.program import main as program
from rover_hil.config import load_config
from rover_hil.recording.data_files import restore_config, with_controller_of
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import estimate_again

Array = NDArray[np.float64]

LEVEL = 0.95
LIMIT_3 = float(chi2.ppf(LEVEL, 3))
LIMIT_2 = float(chi2.ppf(LEVEL, 2))
LIMIT_YAW = float(norm.ppf(0.5 + 0.5 * LEVEL))
AREA_M = 10.0
REPORT_M = 1.0
ENDED = (130, 143)
"""Exit codes of a command that a signal ended."""
ABOUT_GROUND = "ground|slip|firm|learned"


@dataclass(kw_only=True)
class Point:
    """The estimate at one row: error of x, y and yaw, and the upper half of its covariance by rows."""

    travel_m: float
    error: list[float]
    covariance: list[float]

    def nees(self) -> float:
        """Return the normalised estimation error squared."""
        error = np.array(self.error)
        return float(error @ np.linalg.solve(self._matrix(), error))

    def is_yaw_inside(self) -> bool:
        """Return whether the yaw is in its interval."""
        return abs(self.error[2]) <= LIMIT_YAW * math.sqrt(self.covariance[5])

    def area_m2(self) -> float:
        """Return the area of the ellipse of the position."""
        return math.pi * LIMIT_2 * math.sqrt(max(0.0, float(np.linalg.det(self._matrix()[:2, :2]))))

    def distance_m(self) -> float:
        """Return the error of the position."""
        return math.hypot(*self.error[:2])

    def radius_m(self) -> float:
        """Return the radius of the circle around the estimate that contains the position with 95 %."""
        small, large = np.linalg.eigvalsh(self._matrix()[:2, :2])
        angles = np.linspace(0.0, math.pi, 721)[:-1]
        inverse = np.cos(angles) ** 2 / large + np.sin(angles) ** 2 / small
        scale = float(np.sqrt(small * large))

        def missing(radius: float) -> float:
            inside = np.mean((1.0 - np.exp(-0.5 * radius**2 * inverse)) / (scale * inverse))
            return float(inside) - LEVEL

        return float(brentq(missing, 0.0, 10.0 * math.sqrt(large)))

    def _matrix(self) -> Array:
        xx, xy, xa, yy, ya, aa = self.covariance
        return np.array(((xx, xy, xa), (xy, yy, ya), (xa, ya, aa)))


@dataclass(kw_only=True)
class Outcome:
    """What became of one drive."""

    refusal: str = ""
    points: list[Point] = field(default_factory=list)
    reports: list[tuple[float, str]] = field(default_factory=list)
    """Times in s since the first row, and texts, of findings and warnings that began then."""


def call(*arguments: str) -> tuple[int, str]:
    """Run a command of the program in this process. Return its exit code and its output."""
    output = StringIO()
    before, sys.argv = sys.argv, ["rover-hil", *arguments]
    try:
        with redirect_stdout(output), redirect_stderr(output):
            program()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None), output.getvalue()
    finally:
        sys.argv = before
    return 0, output.getvalue()


def toml_section(setting: dict[str, Any]) -> str:
    """Return `[ground]`."""
    return "".join(("\n[ground]\n", *(f"{key} = {json.dumps(value)}\n" for key, value in setting.items())))


def estimate(folder: Path, answer: dict[str, Any], *, has_setting: bool) -> Outcome:
    """Import the drive of a folder, and estimate it with its configuration."""
    with TemporaryDirectory() as place:
        config, log = Path(place) / "config.toml", Path(place) / "drive.mcap"
        text = (folder / "config.toml").read_text("utf-8")
        config.write_text(text + (toml_section(answer["setting"]) if has_setting else ""), "utf-8")
        code, output = call(
            *("import", "table", str(folder / "drive.csv"), "--columns", str(folder / "columns.toml")),
            *("--out", str(log), "--no-estimate"),
        )
        if code in ENDED:
            raise SystemExit(code)
        if code:
            return Outcome(refusal=f"import: {output.strip()[-300:]}")
        reader = LogReader(log)
        with restore_config(reader) as logged:
            estimated = estimate_again(reader, with_controller_of(logged, load_config(str(config))))
            return _judge(estimated, reader.start_ns, folder, answer)


def _judge(outputs: Iterable[StepOutput], start_ns: int, folder: Path, answer: dict[str, Any]) -> Outcome:
    truth = np.loadtxt(folder / "truth.csv", delimiter=",", skiprows=1)
    outcome, estimates, times = Outcome(), [], []
    known: set[str] = set()
    for output in outputs:
        times.append((output.t_ns - start_ns) * 1e-9)
        estimates.append(output.estimate)
        texts = [f"{each.cause}: {each.text}" for each in output.findings or ()]
        texts += [output.suspicion] if output.suspicion else []
        outcome.reports += [(times[-1], text) for text in texts if text not in known]
        known = set(texts)
    for row in (*answer["rows"], answer["end"]):
        cycle = min(int(np.searchsorted(times, truth[row, 0] - 1e-3)), len(times) - 1)
        now = estimates[cycle]
        error = np.array((now.x_m, now.y_m, now.yaw_rad)) - truth[row, 1:4]
        error[2] = math.remainder(error[2], math.tau)
        outcome.points.append(
            Point(travel_m=float(truth[row, 4]), error=error.tolist(), covariance=list(now.covariance))
        )
    return outcome


class Tables:
    """Outcomes of all drives by set, and what is printed."""

    def __init__(self, pattern: str) -> None:
        self.pattern = re.compile(pattern, re.IGNORECASE)
        self.drives: dict[str, list[tuple[dict[str, Any], Outcome]]] = defaultdict(list)

    def add(self, answer: dict[str, Any], outcome: Outcome) -> None:
        """Take one drive."""
        self.drives[answer["name"].rsplit("-", 1)[0]].append((answer, outcome))

    def print(self) -> None:
        """Print all tables."""
        for name, pairs in self.drives.items():
            for answer, outcome in pairs:
                if outcome.refusal:
                    print(f"{answer['name']} refused: {outcome.refusal}")
            self.drives[name] = [pair for pair in pairs if not pair[1].refusal]
        print("\nshares with 95 % intervals; NEES over 3 and area are medians")
        head = ("drives", "n", "inside, end", "inside, 2, 4, ... m", "yaw inside, end", "yaw, 2, 4, ... m")
        print(_line((*head, "NEES end", "2, 4", "m2 at 10 m")))
        for name, pairs in self.drives.items():
            self._print_consistency(name, pairs)
        for name in ("unknown", "firm", "learned"):
            self._print_parts(name, lambda answer: answer["about"]["ground"])
        self._print_parts(
            "single", lambda answer: f"{answer['about']['lost']:g}/{answer['about']['sideways']:g}"
        )
        self._print_parts("gyro", lambda answer: answer["about"]["gyro"])
        for name in ("firm", "hard_floor", "carpet"):
            self._print_radius(name)
        self._print_reports()

    def _print_parts(self, name: str, key: Any) -> None:
        parts: dict[str, list[tuple[dict[str, Any], Outcome]]] = defaultdict(list)
        for answer, outcome in self.drives.get(name, []):
            parts[f"{name} {key(answer)}"].append((answer, outcome))
        for part, pairs in parts.items():
            self._print_consistency(part, pairs)

    def _print_consistency(self, name: str, pairs: Sequence[tuple[dict[str, Any], Outcome]]) -> None:
        if not pairs:
            return
        ends = [outcome.points[-1] for _, outcome in pairs]
        on_the_way = [point for _, outcome in pairs for point in outcome.points[:-1]]
        print(
            _line(
                (
                    name,
                    str(len(pairs)),
                    _inside(ends),
                    _inside(on_the_way),
                    share_text(sum(point.is_yaw_inside() for point in ends), len(ends)),
                    share_text(sum(point.is_yaw_inside() for point in on_the_way), len(on_the_way)),
                    f"{np.median([point.nees() for point in ends]) / 3:.2f}",
                    f"{np.median([point.nees() for point in on_the_way]) / 3:.2f}",
                    f"{np.median([point.area_m2() for point in _at(pairs)]):.3g}",
                )
            )
        )

    def _print_radius(self, name: str) -> None:
        points = list(_at(self.drives.get(name, [])))
        if points:
            radius = float(np.median([point.radius_m() for point in points]))
            quantile = float(np.quantile([point.distance_m() for point in points], LEVEL))
            print(
                f"{name}: after {AREA_M:g} m radius of 95 % {radius:.3f} m (median of {len(points)}),",
                f"95 % quantile of the error {quantile:.3f} m, ratio {radius / quantile:.2f}",
            )

    def _print_reports(self) -> None:
        counts: dict[str, list[tuple[bool, bool, bool]]] = defaultdict(list)
        for answer, outcome in self.drives.get("contradicted", []):
            begin_s, seen_s = answer["begin_s"], answer["seen_s"]
            about = [(at_s, text) for at_s, text in outcome.reports if self.pattern.search(text)]
            is_false = any(at_s < begin_s for at_s, _ in about)
            later = [(at_s, text) for at_s, text in about if at_s >= begin_s]
            late_m = math.nan
            if later and seen_s is not None:
                late_m = answer["m_at"](later[0][0]) - answer["m_at"](seen_s)
            is_inside = outcome.points[-1].nees() <= LIMIT_3
            counts[answer["contradicts"]].append((late_m <= REPORT_M, is_inside, is_false))
            texts = later or [each for each in outcome.reports if each[0] >= begin_s]
            print(
                f"{answer['name']} {answer['rover']:12} {answer['contradicts']:15}",
                f"lost {answer['about']['lost']:.2f}, to be seen {_seconds(seen_s)};",
                f"reported {'never' if not later else f'{late_m:.2f} m after'}{', false' * is_false};",
                f"NEES / 3 {outcome.points[-1].nees() / 3:.2f}: {texts[0][1][:90] if texts else ''}",
            )
        for sensor, rows in counts.items():
            within, inside, false = (sum(column) for column in zip(*rows, strict=True))
            print(
                f"{sensor}: reported within {REPORT_M:g} m {within} of {len(rows)}, region contains the",
                f"ground truth {inside}, false reports before the slip {false}",
            )


def _seconds(value: float | None) -> str:
    return "never" if value is None else f"at {value:.1f} s"


def _inside(points: Sequence[Point]) -> str:
    return share_text(sum(point.nees() <= LIMIT_3 for point in points), len(points))


def _at(pairs: Iterable[tuple[dict[str, Any], Outcome]]) -> Iterable[Point]:
    """Yield the point after 10 m of each drive."""
    for _, outcome in pairs:
        yield next(point for point in outcome.points if point.travel_m >= AREA_M - 0.05)


def _line(cells: Sequence[str]) -> str:
    widths = (18, 4, 20, 20, 20, 20, 9, 7, 10)
    return "".join(f"{cell:{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()


def answer_of(folder: Path) -> dict[str, Any]:
    """Return the answer of a drive, with the distance by the wheels at a time."""
    answer: dict[str, Any] = json.loads((folder / "answer.json").read_text("utf-8"))
    truth = np.loadtxt(folder / "truth.csv", delimiter=",", skiprows=1)
    answer["m_at"] = lambda at_s: float(np.interp(at_s, truth[:, 0], truth[:, 4]))
    return answer


def main() -> None:
    """Estimate and judge all drives of a folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="drives whose names contain this")
    parser.add_argument("--record", type=Path, help="file for the outcomes")
    parser.add_argument("--judge", type=Path, help="judge these outcomes; estimate nothing")
    parser.add_argument("--without-setting", action="store_true", help="leave [ground] out")
    parser.add_argument("--reports", default=ABOUT_GROUND, help="what a report about the ground contains")
    options = parser.parse_args()
    recorded = json.loads(options.judge.read_text("utf-8")) if options.judge else {}
    tables = Tables(options.reports)
    for folder in sorted(path.parent for path in options.folder.glob(f"*{options.only}*/answer.json")):
        answer = answer_of(folder)
        if not options.judge:
            outcome = estimate(folder, answer, has_setting=not options.without_setting)
            recorded[folder.name] = asdict(outcome)
            print(f"estimated {folder.name}", file=sys.stderr, flush=True)
            if options.record:
                options.record.write_text(json.dumps(recorded) + "\n", "utf-8")
        held = recorded[folder.name]
        points = [Point(**point) for point in held["points"]]
        tables.add(answer, Outcome(refusal=held["refusal"], points=points, reports=held["reports"]))
    tables.print()


if __name__ == "__main__":
    main()
