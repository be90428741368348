"""A log of version 1, written in November 2026 by commit f273483, is read and replays as a new one does."""

from pathlib import Path

from rover_hil.datasets.log import read_drive
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.report.read_run import read_run
from rover_hil.run.replay import replay

LOG = Path(__file__).parent / "data" / "log_1.mcap"


def test_it_replays_with_the_same_samples() -> None:
    log = LogReader(LOG)
    with restore_config(log) as config:
        # Its slip was read by constants that the program does not have any more.
        result = replay(log, config.model_copy(update={"slip": None}), lambda: None)
    assert log.is_complete
    assert result.cycles == 30
    # Estimate and set-points are those of the present controller, which may have changed since.
    fields = [difference.field for difference in result.differences]
    assert [field for field in fields if field.startswith("samples")] == []


def test_its_report_and_its_quantities_are_read() -> None:
    run = read_run(LOG)
    drive = read_drive(LOG)
    assert run.duration_s > 0.5
    assert len(drive.rows["enc1_rad"]) == 29
    assert len(drive.rows["x_m"]) == 30
