"""Simulated missions on all cores, or on a cluster."""

from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial

from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor
from rover_hil.recording.data_files import PackedConfig
from rover_hil.tune.objective import MissionRunner, RunT
from rover_hil.tune.simulated_mission import SimulatedMission, simulate_mission


@contextmanager
def open_missions(cluster: str | None = None, *, has_camera: bool = True) -> Iterator[MissionRunner]:
    """Give what drives missions in parallel, of a rover with a camera or without; see `open_executor`."""
    with open_executor(cluster, uses_blas=has_camera) as executor:
        yield missions_on(executor)


def missions_on(executor: Executor) -> MissionRunner:
    """Return what drives missions on an executor."""
    return partial(_drive, executor)


def _drive(
    executor: Executor, config: Config, seeds: Sequence[int]
) -> Generator[SimulatedMission, None, None]:
    packed = PackedConfig.of(config)
    # All of them start now, not when the first result is asked for.
    return results_in_order([executor.submit(_simulate, packed, seed) for seed in seeds])


def results_in_order(futures: Iterable[Future[RunT]]) -> Generator[RunT, None, None]:
    """Yield the results in order; cancel those not started when the caller has seen enough."""
    waiting = deque(futures)
    try:
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()


def _simulate(packed: PackedConfig, seed: int) -> SimulatedMission:
    with packed.unpacked() as config:
        return simulate_mission(config, seed)
