"""`rover-hil calibrate time`: offsets between devices, by the turns that they all feel."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from rover_hil.config import Config
from rover_hil.console.options import out_option
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.picture import Drawing
from rover_hil.ready.options import command
from rover_hil.ready.procedure import Facts, FileProcedure, Request
from rover_hil.ready.time.figures import draw_offsets
from rover_hil.ready.time.fit import Offset, YawTrack, find_offsets, read_tracks

KEYS = {
    "heading": "filter.heading_lag_s",
    "ground": "ground_motion.camera_delay_s = {:.4f}, with a global shutter; turns do not show a rolling "
    "one: then subtract {:.2f} of its readout, at most {:.4f}",
}
"""Where the offset of a kind of device is entered."""


@command()
def calibrate(
    source: Annotated[str, typer.Argument(help="A log of turns that begin and end.", metavar="LOG")],
    out: Annotated[
        Path | None,
        out_option("Also write the offsets to this TOML file, and a page with a picture beside it."),
    ] = None,
) -> "TimeCalibration":
    """Find offsets between gyro, wheels, compass and cameras by the turns that they all feel.

    Exit code 1: no offset is sure.

    Example: `rover-hil calibrate time gyro.mcap`, the log of `rover-hil calibrate imu`

    Data: your log of turns back and forth for half a minute; docs/how-to/calibrate_the_times.md.
    """
    return TimeCalibration(Path(source).name)


@dataclass(frozen=True, slots=True)
class Offsets:
    """The offsets of all devices."""

    offsets: Sequence[Offset]

    @property
    def known(self) -> list[Offset]:
        """Those that may be used."""
        return [offset for offset in self.offsets if not offset.problem]

    @property
    def problem(self) -> str:
        """Why none may be used; empty where one may."""
        return "" if self.known else "no offset is sure"


@dataclass
class TimeCalibration(FileProcedure[Sequence[YawTrack], Offsets]):
    """Offsets of all devices of a log against the first, the reference.

    Attributes:
        source: Name of the log, for the file.
    """

    takes_config = False

    source: str

    def configure(self, request: Request, config: Config | None) -> Path | None:
        return request.out

    def read(self, logs: Sequence[Path]) -> Sequence[YawTrack]:
        return read_tracks(logs[0])

    def fit(self, record: Sequence[YawTrack]) -> Offsets:
        return Offsets(find_offsets(record))

    def title(self, record: Sequence[YawTrack], result: Offsets) -> str:
        return f"Time: {result.problem or 'offsets between devices'}"

    def facts(self, record: Sequence[YawTrack], result: Offsets) -> Facts:
        facts = [("reference", record[0].name)]
        for offset in result.offsets:
            if offset.problem:
                facts.append((offset.track.name, f"not sure: {offset.problem}"))
                continue
            side = "late" if offset.offset_s >= 0.0 else "early"
            value = f"{abs(offset.offset_s):.3f} s {side}, +- {offset.sd_s:.3f} s (one standard deviation)"
            if offset.track.kind in KEYS:
                share = offset.track.readout_share
                numbers = offset.offset_s, share, share * offset.track.longest_readout_s
                value += f"; in the configuration: {KEYS[offset.track.kind].format(*numbers)}"
            facts.append((offset.track.name, value))
        return facts

    def json(self, record: Sequence[YawTrack], result: Offsets, out: Path | None) -> dict[str, object]:
        offsets = {
            offset.track.name: {
                "offset_s": offset.offset_s,
                "sd_s": offset.sd_s,
                "readout_share": offset.track.readout_share,
                "problem": offset.problem,
            }
            for offset in result.offsets
        }
        return {"reference": record[0].name, "offsets": offsets}

    def figures(self, record: Sequence[YawTrack], result: Offsets) -> Sequence[Drawing]:
        caption = (
            "See whether each line has one clear minimum. A flat line means that the turns show no offset: "
            "record turns that begin and end."
        )
        return (Drawing("Offsets of the devices", caption, lambda: draw_offsets(result.offsets)),)

    def write(self, record: Sequence[YawTrack], result: Offsets) -> str:
        devices = [
            {
                "device": offset.track.device,
                "of": offset.track.kind,
                "offset_s": round(offset.offset_s, 4),
                "sd_s": round(offset.sd_s, 4),
                "readout_share": round(offset.track.readout_share, 2),
            }
            for offset in result.known
        ]
        return toml_text({"source": self.source, "reference": record[0].name, "offset": devices})
