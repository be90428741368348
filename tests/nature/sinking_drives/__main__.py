"""Render the drives: python -m tests.nature.sinking_drives --seed 1 --out DIR."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2

from .drives import DRIVES
from .grounds import Ground, make_ground
from .write import write_drive


def main() -> None:
    """Read the arguments and render, ground by ground."""
    parser = argparse.ArgumentParser(prog="sinking_drives", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", help="names, or beginnings of names, of drives")
    parser.add_argument("--longer", type=int, default=1, help="so many times as many frames")
    choice = parser.parse_args()
    cv2.setNumThreads(1)
    chosen = [
        (i, replace(d, frames=choice.longer * d.frames))
        for i, d in enumerate(DRIVES)
        if not choice.only or any(d.name.startswith(n) for n in choice.only)
    ]
    ground: Ground | None = None
    for index, drive in sorted(chosen, key=lambda pair: pair[1].ground):
        begin = time.process_time()
        if ground is None or ground.name != drive.ground:
            ground = make_ground(drive.ground, choice.seed)
        size = write_drive(choice.out, drive, ground, choice.seed, index)
        spent = time.process_time() - begin
        sys.stdout.write(f"{drive.name:12s} {drive.frames:4d} frames {size / 1e6:6.1f} MB {spent:6.1f} s\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
