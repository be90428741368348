"""Filter a record without delay, and differentiate its position."""

import numpy as np
from scipy.signal import butter, filtfilt

step_s, corner_hz, every = 0.001, 50.0, 20
record = np.genfromtxt("record.csv", delimiter=",", names=True, deletechars="")
low_pass = butter(4, 2.0 * corner_hz * step_s)
position = filtfilt(*low_pass, record["position_[m]"])
force = filtfilt(*low_pass, record["force_[N]"])
velocity = np.gradient(position, step_s)
acceleration = np.gradient(velocity, step_s)
keep = slice(200, -200, every)  # the filter is wrong at both ends
time = record["time_[s]"][keep]
table = np.column_stack((time - time[0], velocity[keep], acceleration[keep], force[keep]))
header = "time [s],velocity [m/s],acceleration [m/s^2],force [N]"
np.savetxt("drive.csv", table, delimiter=",", fmt="%.6f", header=header, comments="")
