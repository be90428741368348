"""Verdicts on measured side-slope sets, before and after what is named is part of the model.

`python -m benchmarks.gap.side_slope_sets DATA [--seeds N]`: DATA holds one folder per set, with summary.csv
and paths.csv. Each set is asked with several seeds, which lock different runs.
"""

import argparse
from pathlib import Path

from rover_hil.gap.data.readers.side_slope import read_side_slope
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.model_file import ExtendedModel, Provenance
from rover_hil.gap.output.results import model_file_of
from rover_hil.gap.workflow import analyse
from sim_backends.models.side_slope.model import SideSlope, make_model


def _extended(model: SideSlope, analysis: Analysis) -> ExtendedModel | None:
    if analysis.machine is None or not analysis.verdict.verdict.is_name:
        return None
    provenance = Provenance(date="", verdict="NAMED", data_sha256="", plan_sha256="", seed=0)
    return ExtendedModel(model, model_file_of(analysis, model.name, provenance))


def _show(folder: Path, seed: int) -> None:
    model = make_model()
    runs = read_side_slope(folder)
    analysis = analyse(model, runs, seed=seed)
    verdict = analysis.verdict
    names = " | ".join("+".join(one) for one in verdict.confidence_set)
    closures = [
        f"{name} {channel['closure']:.0%}"
        for name, channel in verdict.gap.items()
        if isinstance(channel["closure"], float)
    ]
    print(f"{folder.name} seed {seed}: {verdict.verdict} {names} ({verdict.seconds:.1f} s)")
    print(f"  p {verdict.p_gap:.2g}; closure {', '.join(closures) or '-'}")
    for effect in verdict.effects:
        for name, one in effect.parameters.items():
            low, high = one.ci95
            print(f"  {effect.name}.{name} {one.value:.3g} {one.unit} ({low:.3g} .. {high:.3g})")
    extended = _extended(model, analysis)
    if extended is not None:
        again = analyse(extended, runs, seed=seed).verdict
        print(f"  with it in the model: {again.verdict}, p {again.p_gap:.2g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--seeds", type=int, default=1)
    arguments = parser.parse_args()
    for folder in sorted(path for path in arguments.data.iterdir() if path.is_dir()):
        for seed in range(arguments.seeds):
            _show(folder, seed)


if __name__ == "__main__":
    main()
