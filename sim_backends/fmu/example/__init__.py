"""A unit of a motor axis, for the tutorial and the tests; `python -m sim_backends.fmu.example axis.fmu`."""
