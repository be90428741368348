"""Whether a simulated mission is the same, bit for bit, with the instructions of other processors.

    python -m benchmarks.tuning.other_processors

Runs a mission of the Robotino with the variants that OpenBLAS, numpy and the C library choose on older
processors. Prints a digest of each; exit code 1 when they differ.
"""

import hashlib
import os
import subprocess
import sys

from benchmarks.program.kernels import VARIABLE, runnable_kernels
from rover_hil.config import load_config
from rover_hil.tune.scenarios import with_scenario
from rover_hil.tune.simulated_mission import drive

VARIANTS: dict[str, dict[str, str]] = {
    "this processor": {},
    **{f"OpenBLAS for {kernel}": {VARIABLE: kernel} for kernel in runnable_kernels()},
    "numpy without AVX and FMA": {"NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX2 FMA3"},
    "C library without AVX and FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F"},
}
DIGEST = "--digest"


def digest() -> str:
    driven = drive(with_scenario(load_config("robotino"), 1))
    parts = (driven.truth.x_m, driven.truth.yaw_rad, driven.estimate.yaw_rad, driven.set_points_rad_s)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def main() -> int:
    if sys.argv[1:] == [DIGEST]:
        print(digest())
        return 0
    by_processor: dict[str, str] = {}
    for name, variables in VARIANTS.items():
        by_processor[name] = subprocess.run(
            [sys.executable, "-m", "benchmarks.tuning.other_processors", DIGEST],
            env={**os.environ, **variables},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()[-1]
        print(f"{name}: {by_processor[name][:16]}", flush=True)
    return 0 if len(set(by_processor.values())) == 1 else 1


if __name__ == "__main__":
    sys.exit(main())
