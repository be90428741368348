"""Files of the trace estimator: rig calibration, frames, telemetry, angles, pictures."""
