"""Paper 002 reproduced: `python -m benchmarks.terrain.slip_skid`."""

import numpy as np

from sim_backends.terramechanics.soil import skid_from_slip as skid
from sim_backends.terramechanics.soil import slip_skid_model as model


def main() -> None:
    print(
        "wheel  r_s mm  up at 0.6  down at -1  | skid from slip, rms: M N m  F N | (13) missed by, |s| <= 0.6"
    )
    slip = np.linspace(-1, 0, 2001)
    tested = np.linspace(-0.6, 0.6, 1201)
    for name, wheel in model.shipped_wheels().items():
        up, down = np.degrees(model.slope_rad(wheel, [0.6, -1.0]))
        moment = skid.resistance_moment_in_skid_nm(wheel, slip) - model.resistance_moment_nm(wheel, slip)
        pull = skid.drawbar_pull_in_skid_n(wheel, slip) - model.drawbar_pull_n(wheel, slip)
        closure = wheel.moment.at(tested) - wheel.resistance.at(tested) - wheel.drawbar_pull.at(tested)
        print(
            f"{name}   {wheel.shearing_radius_m * 1000:6.2f}  {up:8.2f}  {down:9.2f}   | "
            f"{_rms(moment):22.2f} {_rms(pull):8.2f} | {np.max(np.abs(closure)):.3f}"
        )
    print("\nTransitions (skid, slip) of sinkage, moment, drawbar pull")
    for name, wheel in model.shipped_wheels().items():
        lines = (wheel.sinkage_mm, wheel.moment, wheel.drawbar_pull)
        shown = [
            f"{three.skid_transition:7.4f} {three.slip_transition:7.4f}" if three else 15 * "-"
            for three in lines
        ]
        print(f"{name}   {'   '.join(shown)}")


def _rms(values: np.typing.NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
