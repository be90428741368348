"""Runs of a motor axis with a dry friction of 0.0125 N m, which my_axis.py does not have."""

from pathlib import Path

import numpy as np

rng = np.random.default_rng(3)
torque_constant, resistance, viscous, inertia, dry = 0.051, 0.6, 0.0166667, 0.0051, 0.0125

with Path("axis.csv").open("w") as file:
    print("run,load [kg],voltage [V],speed [rad/s]", file=file)
    for run in range(12):
        voltage = np.repeat(rng.uniform(-6.0, 6.0, 6), 50)
        error, speed = 0.0, 0.0
        for volts in voltage:
            error = 0.9 * error + 0.09 * rng.standard_normal()
            print(f"run{run},1,{volts:.4f},{speed + error:.4f}", file=file)
            for _ in range(20):
                push = torque_constant * (volts - torque_constant * speed) / resistance - viscous * speed
                if speed == 0.0 and abs(push) < dry:
                    continue
                sense = np.sign(speed) if speed != 0.0 else np.sign(push)
                after = speed + 0.001 * (push - sense * dry) / inertia
                speed = 0.0 if after * sense < 0.0 else after
