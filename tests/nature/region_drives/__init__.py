"""Recorded drives with ground truth, for the position region: three rovers, grounds drawn from stated priors.

    python -m tests.nature.region_drives FOLDER --seed 1 [--set firm]

It knows nothing of the program. Each drive is a folder with the tables of its sensors, the columns file, the
configuration, the ground truth and `answer.json`. All are written before any product reads them.
"""
