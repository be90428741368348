"""The option of all batteries that run their cases in parallel."""

import argparse


def add_cluster_option(parser: argparse.ArgumentParser) -> None:
    """Add `--cluster`."""
    parser.add_argument(
        "--cluster", metavar="ADDRESS", help="run on the workers of this Dask scheduler instead of here"
    )
