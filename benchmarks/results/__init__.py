"""Recorded figures of the benchmarks: a CSV file per subject, and the page that is generated from it.

`gates.md`, `constants.md`, `faults.md` and `faults_two_processes.md` have columns of their own: their
benchmarks write them.
"""

from typing import Final

TITLES: Final[dict[str, tuple[str, str]]] = {
    "consistency": (
        "Consistency of the covariance",
        "Missions on grounds that nothing was tuned on: NEES is the squared error over the reported "
        "covariance, over its dimension.",
    ),
    "calibration": (
        "Calibration from drives, and the covariance after diagnose",
        "Measured recordings of three robots, where the peer is a fit by somebody who had not seen the "
        "program; and the same robots in an independent simulator.",
    ),
    "field_tests": (
        "The two field tests of the sComp paper, simulated",
        "Medians over seeds that were not used for development; test 1 is the fit, test 2 the transfer.",
    ),
    "floors": (
        "Missions on floors that no estimator was fitted to",
        "A rectangle of 900 x 400 mm on four contact models, without pose measurements unless stated. A "
        "mission passes with a path error of at most 45 mm rms and an end error (closure) of at most 100 mm.",
    ),
    "ftrace": (
        "Slip angle from the trace of a wheel",
        "Rendered drives that were judged once; 'missed' counts frames with a visible trace.",
    ),
    "gap": (
        "Verdicts of gap on simulated machines with hidden effects",
        "Six independent simulators, on which nothing was tuned; effects of at least three times the noise.",
    ),
    "gap_duration": (
        "Duration of gap",
        "On two shared cores; the peer is solve_ivp (RK45, tolerance 1e-6), one run after the other.",
    ),
    "gap_measured": (
        "Verdicts of gap on measured machines and robots",
        "The peer is the published value or an independent fit; benchmarks/gap/references has a second fit "
        "of the robots.",
    ),
    "gap_next_run": (
        "The next run that gap proposes",
        "Carts 90 to 119 with a hidden resistance, run once; the peer is the best repetition of a "
        "measured run.",
    ),
    "gap_shipped_models": (
        "Verdicts of gap on simulated rovers with hidden effects",
        "Independent simulators, except the six-wheel rover, which shares its contact laws with the model.",
    ),
    "ground_motion": (
        "Motion over the ground by a camera",
        "Rendered drives on seeds that were judged once, and a real road; slip is that of windows of 0.5 m.",
    ),
    "measured_slip": (
        "Slip measured by a ground camera, in the estimate",
        "Missions of simulated rovers whose camera measures the motion over the ground.",
    ),
    "motor_identification": (
        "Motor identification",
        "Simulated motors with known parameters (100 of each case), and published records.",
    ),
    "position_region": (
        "The region of the position",
        "Recorded drives of three rovers on grounds of stated priors, by an independent simulator, judged "
        "once: 95 % regions of x, y and yaw. The peer is an ideal slip estimator (NEES), or the estimate "
        "without [ground].",
    ),
    "program": (
        "The program: time, memory, logs and malformed input",
        "Times are of two shared cores; ratios to the peer are comparable on other computers.",
    ),
    "recorded_drives": (
        "Recorded third-party drives",
        "Measured drives of three robots with motion capture, a robot mower and a car.",
    ),
    "robotino_plant": (
        "The simulated Robotino against measured runs",
        "Measured runs of BrOleg5/research-wheel-slippage; the peer is the measured value.",
    ),
    "ros2": (
        "ROS 2",
        "The peer program is Fast DDS 2.9.1 over the loopback interface.",
    ),
    "safety": (
        "Stops, false stops and ends of a run",
        "Simulated missions with fixed seeds, or two processes in real time.",
    ),
    "scomp": (
        "sComp in an independent simulator",
        "Medians over 20 seeds; all parameters are from test 1, and test 2 is the transfer.",
    ),
    "slip_maps": (
        "Slip from motor currents and from the yaw excitation",
        "Maps on measured runs that they were not trained on, and missions on simulated grounds.",
    ),
    "terrain": (
        "Wheel-soil models",
        "Comparison with published tables and with the CMU single-wheel data.",
    ),
    "tuning": (
        "Tuning, and its size",
        "Costs are 0.9 quantiles on missions that decided nothing.",
    ),
    "twin": (
        "Gains tuned on the twin of a rover",
        "Rovers of an independent simulator, driven six times and diagnosed. Gains are tuned on the "
        "simulation that `diagnose --enter` made, and on shipped values, with the same budget; both are "
        "judged on the rover itself, on days that decided nothing.",
    ),
}
"""Title and introduction of each page, by the name of its CSV file."""
