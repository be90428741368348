"""`rover-hil calibrate time`: offsets between devices, by the turns that they all feel."""

from collections.abc import Sequence
from pathlib import Path

from rover_hil.app.calibrate.results import check_results
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.steps import show_steps
from rover_hil.datasets.toml_text import toml_text
from rover_hil.identify.timing.figures import draw_offsets
from rover_hil.identify.timing.offsets import Offset, YawTrack, find_offsets, read_tracks
from rover_hil.pages.atomic_write import write_files
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.terminal import Terminal

KEYS = {
    "heading": "filter.heading_lag_s",
    "ground": "ground_motion.camera_delay_s = {:.4f}, with a global shutter; turns do not show a rolling "
    "one: then subtract {:.2f} of its readout, at most {:.4f}",
}
"""Where the offset of a kind of device is entered."""


def calibrate_time(log: Path, *, out: Path | None, as_json: bool, force: bool) -> int:
    """Print the offsets of all devices of a log; returns the exit code: 1 where none is sure.

    Args:
        log: A log of turns that begin and end.
        out: File for the offsets, TOML, with a page beside it; None for neither.
        as_json: Print JSON instead of text.
        force: Replace earlier files.

    Raises:
        ConfigError: A file exists or cannot be written.
        LogError: The log is damaged, or fewer than two devices show turns.
    """
    page = None if out is None else check_results(out, force=force)
    with show_steps(f"reading {log}") as step:
        tracks = read_tracks(log)
        step("correlating turns")
        offsets = find_offsets(tracks)
    known = [each for each in offsets if not each.problem]
    if out is not None and page is not None:
        texts = {page.name: _page(tracks[0], offsets)}
        if known:
            texts[out.name] = _table(log, tracks[0], known)
        write_files(out.parent, texts)
    if as_json:
        record = {
            "reference": tracks[0].name,
            "offsets": {
                each.track.name: {
                    "offset_s": each.offset_s,
                    "sd_s": each.sd_s,
                    "readout_share": each.track.readout_share,
                    "problem": each.problem,
                }
                for each in offsets
            },
        }
        print_json(record)
    else:
        console = Terminal(soft_wrap=True)
        for name, value in _facts(tracks[0], offsets):
            console.print(f"{name}: {value}")
        if page is not None:
            console.print(f"picture: {page}")
            console.print(f"written to {out}" if known else "not written: no offset is sure")
    return EXIT_OK if known else EXIT_NO


def _facts(reference: YawTrack, offsets: Sequence[Offset]) -> tuple[tuple[str, str], ...]:
    facts = [("reference", reference.name)]
    for each in offsets:
        if each.problem:
            facts.append((each.track.name, f"not sure: {each.problem}"))
            continue
        side = "late" if each.offset_s >= 0.0 else "early"
        value = f"{abs(each.offset_s):.3f} s {side}, +- {each.sd_s:.3f} s (one standard deviation)"
        if each.track.kind in KEYS:
            value += f"; in the configuration: {KEYS[each.track.kind].format(*_numbers(each))}"
        facts.append((each.track.name, value))
    return tuple(facts)


def _numbers(offset: Offset) -> tuple[float, float, float]:
    """Return the offset, the share of a readout in it, and the most that this may be."""
    share = offset.track.readout_share
    return offset.offset_s, share, share * offset.track.longest_readout_s


def _table(log: Path, reference: YawTrack, known: Sequence[Offset]) -> str:
    devices = [
        {
            "device": each.track.device,
            "of": each.track.kind,
            "offset_s": round(each.offset_s, 4),
            "sd_s": round(each.sd_s, 4),
            "readout_share": round(each.track.readout_share, 2),
        }
        for each in known
    ]
    return toml_text({"source": log.name, "reference": reference.name, "offset": devices})


def _page(reference: YawTrack, offsets: Sequence[Offset]) -> str:
    is_sure = any(not each.problem for each in offsets)
    drawing = Drawing(
        "Offsets of the devices",
        "See whether each line has one clear minimum. A flat line means that the turns show no offset: "
        "record "
        "turns that begin and end.",
        lambda: draw_offsets(offsets),
    )
    return render(
        "identify/report.html",
        grade="plain" if is_sure else "attention",
        title="Time: offsets between devices" if is_sure else "Time: no offset is sure",
        facts=_facts(reference, offsets),
        pictures=draw_pictures([drawing]),
    )
