"""What other programs read: the MCAP library of Foxglove, pandas, and the layouts that we ship."""

import json
import re
import shutil
from pathlib import Path
from typing import Any, BinaryIO

import pandas as pd
import pytest
from mcap.reader import SeekingReader, make_reader

from drivers.driver import DeviceState, Health
from rover_hil.recording.json_schema import topic_schema
from rover_hil.recording.views import diagnostics_view
from tests.rover_hil.command import Command
from tests.rover_hil.conftest import ROBOTINO_S

LAYOUTS = Path(__file__).parents[2] / "docs" / "examples" / "layouts"
CYCLES = round(50 * ROBOTINO_S)


@pytest.fixture(scope="module")
def log(robotino_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copy(robotino_log, tmp_path_factory.mktemp("readers") / "run.mcap"))


def reader_of(stream: BinaryIO) -> SeekingReader:
    reader = make_reader(stream, validate_crcs=True)
    assert isinstance(reader, SeekingReader)
    return reader


def undeclared(value: Any, schema: dict[str, Any], place: str) -> list[str]:
    """Return the fields of a value that its schema does not name."""
    found: list[str] = []
    if isinstance(value, dict) and "properties" in schema:
        named = schema["properties"]
        for key, inner in value.items():
            inside = undeclared(inner, named[key], f"{place}.{key}") if key in named else [f"{place}.{key}"]
            found += inside
    elif isinstance(value, list):
        for inner in value:
            found += undeclared(inner, schema["items"], f"{place}[]")
    return found


def test_the_library_of_foxglove_reads_index_and_named_fields(log: Path) -> None:
    with log.open("rb") as stream:
        reader = reader_of(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 0
        assert summary.statistics.message_count == sum(summary.statistics.channel_message_counts.values())
        for channel in summary.channels.values():
            encoding = summary.schemas[channel.schema_id].encoding
            assert (encoding, channel.message_encoding) == ("jsonschema", "json")
        counts: dict[str, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            record = json.loads(message.data)
            assert isinstance(record, dict)
            assert undeclared(record, json.loads(schema.data), channel.topic) == []
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    assert counts["/estimate"] == counts["/truth"] == counts["/cycle"] == CYCLES
    assert {"/view/pose", "/view/true_pose", "/view/path", "/view/diagnostics"} <= set(counts)


def test_a_topic_in_a_time_span_is_found_by_the_index(log: Path) -> None:
    with log.open("rb") as stream:
        reader = reader_of(stream)
        times = [message.log_time for _, _, message in reader.iter_messages("/estimate")]
        some = [
            message.log_time
            for _, _, message in reader.iter_messages(
                "/estimate", starting_at=times[20], ending_before=times[30]
            )
        ]
    assert times == sorted(times)
    assert some == times[20:30]


def test_the_log_and_its_tables_open_in_pandas(log: Path, command: Command, tmp_path: Path) -> None:
    with log.open("rb") as stream:
        rows = [json.loads(message.data) for _, _, message in reader_of(stream).iter_messages("/truth")]
    truth = pd.json_normalize(rows)
    assert {"x_m", "y_m", "yaw_rad"} <= set(truth.columns)
    for option, folder, read in (
        ("--csv", "csv", pd.read_csv),
        ("--parquet", "parquet", pd.read_parquet),
    ):
        out = tmp_path / folder
        assert command("export", str(log), option, "--out", str(out)) == 0
        table = read(out / f"truth.{folder}")
        assert table["x_m"].to_list() == truth["x_m"].to_list()
        assert table["t_s"].iloc[-1] == pytest.approx(CYCLES / 50)


def test_the_diagnostics_are_those_that_panels_of_viewers_show() -> None:
    healths = [
        Health(
            device="imu",
            state=state,
            rate_hz=50.0,
            age_s=None,
            accepted=7,
            rejected={"checksum": 3},
            breaks=1,
            sent=0,
            send_failures=0,
            last_link_reason="unplugged",
        )
        for state in DeviceState
    ]
    record = json.loads(diagnostics_view(1_500_000_000, healths))
    assert record["header"]["stamp"] == {"sec": 1, "nsec": 500_000_000}
    levels = {status["message"].split(":")[0]: status["level"] for status in record["status"]}
    assert levels == {"closed": 3, "connected": 1, "streaming": 0, "degraded": 1, "failed": 2}
    assert {"key": "rejected: checksum", "value": "3"} in record["status"][0]["values"]
    schema = topic_schema("/view/diagnostics")
    assert schema.name == "diagnostic_msgs/DiagnosticArray"
    assert undeclared(record, json.loads(schema.text), "") == []


def _resolves(path: str) -> bool:
    """Return whether a schema names a field like `/truth.slip[0]`."""
    topic, *fields = path.split(".")
    shape: dict[str, Any] = json.loads(topic_schema(topic).text)
    for field in fields:
        shape = shape.get("properties", {}).get(field.split("[")[0], {})
        if "[" in field:
            shape = shape.get("items", {})
    return shape.get("type") in ("number", "integer")


def test_the_layouts_show_fields_that_exist() -> None:
    foxglove = json.loads((LAYOUTS / "foxglove.json").read_text())
    panels = foxglove["configById"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert len(paths) > 8
    curves = re.findall(r'<curve name="([^"]+)"', (LAYOUTS / "plotjuggler.xml").read_text())
    assert len(curves) > 8
    # /topic/field/field[0] is /topic.field.field[0] there.
    paths += [re.sub(r"(?<=.)/", ".", curve) for curve in curves]
    assert [path for path in paths if not _resolves(path)] == []
    shown = [panel["topicToRender"] for panel in panels.values() if "topicToRender" in panel]
    shown += [topic for panel in panels.values() for topic in panel.get("topics", ())]
    assert all(topic_schema(topic).name != "rover_hil.Object" for topic in shown)
    placed = set(re.findall(r"[A-Za-z0-9]+![a-z]+", json.dumps(foxglove["layout"])))
    assert placed == set(panels)
