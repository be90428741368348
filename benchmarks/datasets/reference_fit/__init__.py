"""Reference fit of the geometry of the OptiOdom robots by least squares over whole trajectories.

    python -m benchmarks.datasets.reference_fit ../shared/data/vehicles/optiodom

It uses nothing of the program. `results.json` holds the numbers that the program is compared with.
"""
