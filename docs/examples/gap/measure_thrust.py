"""Thrust of a propeller that loses a fifth at 100 turns a second."""

from pathlib import Path

import numpy as np

rng = np.random.default_rng(9)
with Path("thrust.csv").open("w") as file:
    print("run,rate [1/s],wind [m/s],thrust [N]", file=file)
    for number in range(45):
        rate, wind = (20, 40, 60, 80, 100)[number // 9], (0, 3, 6)[number // 3 % 3]
        kept = 1.0 - rate / 500.0  # a fifth of the thrust is lost at 100 turns a second
        newtons = 0.000515625 * kept * (rate**2 - rate * wind / 0.275)
        print(f"p{number},{rate},{wind},{newtons + rng.normal(0.0, 0.02):.3f}", file=file)
