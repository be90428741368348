"""Record of a linear axis: 20 kg, 60 N s/m, 8 N dry friction, 1.5 N more against one direction."""

import numpy as np

rng = np.random.default_rng(2)
mass, viscous, dry, excess, constant = 20.0, 60.0, 8.0, 1.0, 0.5
step_s, count = 0.001, 16000
time = step_s * np.arange(count)
position, speed = np.zeros(count), np.zeros(count)
acceleration, spring = np.zeros(count), np.zeros(count)
for rate_hz, size in ((0.21, 0.08), (0.55, 0.03), (1.3, 0.01)):
    angle = 2.0 * np.pi * rate_hz * time
    position += size * np.sin(angle)
    speed += size * 2.0 * np.pi * rate_hz * np.cos(angle)
    acceleration -= size * (2.0 * np.pi * rate_hz) ** 2 * np.sin(angle)
friction = viscous * speed + (dry + excess * np.sign(speed)) * np.sign(speed) + constant
force = mass * acceleration + friction + rng.normal(0.0, 1.0, count)
seen = position + rng.normal(0.0, 2e-6, count)
np.savetxt(
    "record.csv",
    np.column_stack((time, seen, force)),
    delimiter=",",
    fmt=("%.3f", "%.7f", "%.4f"),
    header="time [s],position [m],force [N]",
    comments="",
)
