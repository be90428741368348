"""A cluster gives what one process gives, whatever happens to its workers, and says what is wrong with it."""

import signal
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers.clock import SystemClock, nanoseconds
from drivers.errors import ConfigError
from rover_hil.app.program import main
from rover_hil.config import Config
from rover_hil.parallel import cluster
from rover_hil.parallel.build_id import build_id
from rover_hil.parallel.executor import open_executor
from rover_hil.tune.parameters import check_parameters
from rover_hil.tune.simulated_mission import SimulatedMission
from rover_hil.tune.study import MissionStudy
from tests.rover_hil.parallel.cluster import running_scheduler, running_worker, slow_answer, wait_for_workers
from tests.rover_hil.tune.tuning import FakeRuns, make_config, write_config

pytestmark = pytest.mark.slow

TRIALS = 9
START_LIMIT_S = 60.0


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with running_scheduler() as found:
        yield found


def wait_for_no_worker(address: str) -> None:
    from distributed import Client

    clock = SystemClock()
    with Client(address, timeout=START_LIMIT_S, set_as_default=False) as client:
        while client.scheduler_info()["workers"]:
            clock.sleep_until(clock.now_ns() + nanoseconds(0.05))


def test_one_worker_killed_one_slow_and_one_late_change_nothing(address: str, tmp_path: Path) -> None:
    config = make_config(tmp_path)
    alone = MissionStudy(tmp_path / "alone", "name", config, check_parameters(config))
    alone.search(FakeRuns().drive, TRIALS, lambda: False, lambda: None)
    study = MissionStudy(tmp_path / "cluster", "name", config, check_parameters(config))
    with ExitStack() as stack:
        dying = stack.enter_context(running_worker(address, delay_s=0.02))
        stack.enter_context(running_worker(address, delay_s=0.05))
        wait_for_workers(address, 2)
        executor = stack.enter_context(open_executor(address))

        def drive(config: Config, seeds: Sequence[int]) -> Generator[SimulatedMission, None, None]:
            futures = deque(executor.submit(slow_answer, config, seed) for seed in seeds)
            return (future.result() for future in futures)

        def kill_and_add() -> None:
            if len(study.attempts()) == 3:
                dying.send_signal(signal.SIGKILL)
                stack.enter_context(running_worker(address))

        study.search(drive, TRIALS, lambda: False, kill_and_add)
        assert dying.wait() == -signal.SIGKILL
    assert study.attempts() == alone.attempts()
    assert len((tmp_path / "cluster").read_text().splitlines()) == 1 + TRIALS
    wait_for_no_worker(address)


def test_a_worker_with_several_threads_is_refused(address: str) -> None:
    with running_worker(address, threads=2):
        wait_for_workers(address, 1)
        with pytest.raises(ConfigError, match="runs 2 threads: start it with --nthreads 1"):
            cluster.ClusterExecutor(address)
    wait_for_no_worker(address)


def test_a_worker_without_the_package_is_refused(address: str) -> None:
    with running_worker(address, has_package=False):
        wait_for_workers(address, 1)
        with pytest.raises(ConfigError, match="is refused, as it has no rover-hil: install it there"):
            cluster.ClusterExecutor(address)
    wait_for_no_worker(address)


def test_a_cluster_without_workers_is_said_so(address: str) -> None:
    with pytest.raises(ConfigError, match="has no worker: start one with `dask worker tcp"):
        cluster.ClusterExecutor(address)


def test_another_version_is_refused() -> None:
    worker = SimpleNamespace(address="tcp://there:1", state=SimpleNamespace(nthreads=1))
    assert cluster.find_refusal(build_id(), worker) == ""  # type: ignore[arg-type]
    refusal = cluster.find_refusal("rover-hil 9.9", worker)  # type: ignore[arg-type]
    assert refusal.startswith(
        "worker tcp://there:1 is refused, as its results could differ: it has rover-hil"
    )
    assert "this machine has rover-hil 9.9" in refusal


def test_a_cluster_that_is_lost_is_said_so_and_the_study_is_kept(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    study = MissionStudy(tmp_path / "study", "name", config, check_parameters(config))
    with ExitStack() as stack:
        scheduler = stack.enter_context(ExitStack())
        address = scheduler.enter_context(running_scheduler())
        stack.enter_context(running_worker(address, delay_s=0.02))
        wait_for_workers(address, 1)
        executor = stack.enter_context(open_executor(address))

        def drive(config: Config, seeds: Sequence[int]) -> Generator[SimulatedMission, None, None]:
            futures = deque(executor.submit(slow_answer, config, seed) for seed in seeds)
            return (future.result() for future in futures)

        def kill() -> None:
            if len(study.attempts()) == 3:
                scheduler.close()

        with pytest.raises(ConfigError, match="was lost: what is finished is kept"):
            study.search(drive, TRIALS, lambda: False, kill)
    found = MissionStudy(tmp_path / "study", "name", config, check_parameters(config)).attempts()
    assert [attempt.number for attempt in found[:3]] == [0, 1, 2]


def test_a_call_that_cannot_be_made_again_ends_with_an_error_and_not_never() -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError

    executor = object.__new__(cluster.ClusterExecutor)
    executor._address = "tcp://there:1"
    executor._build_id = build_id()
    executor._client = SimpleNamespace(status="running", submit=refuse)  # type: ignore[assignment]
    outer: Future[None] = Future()
    executor._settle(refuse, outer, 3, SimpleNamespace(status="lost", result=refuse))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="connection to the cluster at tcp://there:1 was lost"):
        outer.result(timeout=0.0)


def test_an_unreachable_cluster_ends_the_command_with_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT_S", 0.3)
    path = write_config(tmp_path)
    monkeypatch.setattr(
        "sys.argv", ["rover-hil", "tune", str(path), "--study", "a", "--cluster", "tcp://127.0.0.1:1"]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:1" in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.parametrize(
    "address",
    ["", "localhost", "tcp://localhost", "tcp://", "tcp://host:port", "foo://host:1", "h:99999", "[::1"],
)
def test_what_is_no_address_is_refused_at_once(address: str) -> None:
    with pytest.raises(ConfigError, match="is no address of a scheduler: write it with its port"):
        cluster.ClusterExecutor(address)


@pytest.mark.parametrize(
    "address", ["tcp://192.168.1.5:8786", "host.example:1", "tls://[fe80::1%eth0]:8786/"]
)
def test_addresses_of_schedulers(address: str) -> None:
    assert cluster.ADDRESS.fullmatch(address) is not None
