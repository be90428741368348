"""Pictures of the slip model (figures 7-12 of paper 000) and of drives (figures 15-21), as SVG texts."""

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from controllers.slip.scomp.combined_slip import CombinedSlip
from controllers.slip.scomp.two_segment_slip_law import two_segments_of_model
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.identify.scomp.fit import Identification
from rover_hil.pages.picture import svg
from rover_hil.pages.style import ENCODERS, ESTIMATE, STYLE, TRUTH, WIDTH_IN
from rover_hil.scomp.drive import Track
from rover_hil.scomp.true_slip import true_velocity

ANGLES_DEG = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0)
SLOPE_DEG = 12.0
RANGE_DEG = (0.0, 25.0)


def model_pictures(model: CombinedSlip) -> dict[str, str]:
    """Return figures 7 to 12 for a model, by file name."""
    with mpl.rc_context(STYLE):
        return {
            "fig07_longitudinal_force.svg": _forces(model, 0),
            "fig08_lateral_force.svg": _forces(model, 1),
            "fig09_traction.svg": _traction(model),
            "fig10_cornering.svg": _forces(model, 1, ANGLES_DEG),
            "fig11_ellipses.svg": _ellipses(model),
            "fig12_slip_over_angle.svg": _two_segments(model),
        }


def fit_pictures(identification: Identification, track: Track, truth: TruePoses) -> dict[str, str]:
    """Return pictures of an identification: the fitted model's, slip over slip angle, and the drive."""
    pictures = model_pictures(identification.parameters.pitch.model)
    with mpl.rc_context(STYLE):
        figure, axes = _one("slip angle (deg)", "slip ratio")
        angle = np.degrees(np.abs(identification.windows.slip_angle_rad))
        axes.plot(angle, identification.windows.slip, ".", color=TRUTH, label="windows of the drive")
        line = np.linspace(0.0, max(float(angle.max()), 1.0), 200)
        law = identification.parameters.two_segment_slip
        axes.plot(
            line,
            [law.slip_at(a) for a in np.radians(line).tolist()],
            color=ESTIMATE,
            label="two segments, eq 12",
        )
        pictures["slip_over_angle.svg"] = _svg(figure, axes)
    return pictures | drive_pictures({"estimate": track}, truth)


def drive_pictures(tracks: Mapping[str, Track], truth: TruePoses) -> dict[str, str]:
    """Return slip angle (figures 15, 17) and path (19, 21) of a drive against the truth."""
    with mpl.rc_context(STYLE):
        angle, angle_axes = _one("time (s)", "slip angle (deg)")
        path, path_axes = _one("x (m)", "y (m)")
        velocity = true_velocity(truth, truth.t_s)
        moves = velocity.speed_m_s > 0.02
        angle_axes.plot(
            truth.t_s,
            np.where(moves, np.degrees(velocity.slip_angle_rad), np.nan),
            color=TRUTH,
            label="truth",
        )
        path_axes.plot(truth.x_m - truth.x_m[0], truth.y_m - truth.y_m[0], color=TRUTH, label="truth")
        for (name, track), colour in zip(
            tracks.items(), (ESTIMATE, ENCODERS, "#0f8a5f", "#9b4dca"), strict=False
        ):
            angle_axes.plot(
                track.t_s, np.degrees(track.slip_angle_rad), color=colour, label=name, linewidth=1.0
            )
            path_axes.plot(track.x_m, track.y_m, color=colour, label=name, linewidth=1.2)
        path_axes.set_aspect("equal", adjustable="datalim")
        return {"slip_angle.svg": _svg(angle, angle_axes), "path.svg": _svg(path, path_axes)}


def _forces(model: CombinedSlip, which: int, angles_deg: Sequence[float] = ANGLES_DEG[:5]) -> str:
    return _svg(*_force_axes(model, which, angles_deg))


def _traction(model: CombinedSlip) -> str:
    figure, axes = _force_axes(model, 0, ANGLES_DEG)
    needed_n = model.load_n * np.sin(np.radians(SLOPE_DEG))
    axes.axhline(needed_n, color=TRUTH, linestyle="--", label=f"needed on {SLOPE_DEG:.0f} deg")
    return _svg(figure, axes)


def _force_axes(model: CombinedSlip, which: int, angles_deg: Sequence[float]) -> tuple[Figure, Axes]:
    figure, axes = _one("slip ratio", ("longitudinal force (N)", "lateral force (N)")[which])
    slip = np.linspace(0.0, 1.0, 200)
    for angle in angles_deg:
        force_n = model.forces_n(slip, np.full_like(slip, np.radians(angle)))[which]
        axes.plot(slip, force_n, label=f"{angle:.0f} deg")
    return figure, axes


def _ellipses(model: CombinedSlip) -> str:
    """Draw F_y over F_x at constant slip angle, and the printed ellipse (eqs 10, 11), which differs."""
    figure, axes = _one("longitudinal force (N)", "lateral force (N)")
    slip = np.linspace(0.0, 1.0, 200)
    for angle in ANGLES_DEG:
        at = np.full_like(slip, np.radians(angle))
        force_x_n, force_y_n = model.forces_n(slip, at)
        line = axes.plot(force_x_n, force_y_n, label=f"{angle:.0f} deg")[0]
        quarter = np.linspace(0.0, np.pi / 2, 60)
        most = np.radians([angle])
        axes.plot(
            model.greatest_x_n(most) * np.sin(quarter),
            model.greatest_y_n(most) * np.cos(quarter),
            ":",
            color=line.get_color(),
        )
    return _svg(figure, axes)


def _two_segments(model: CombinedSlip) -> str:
    figure, axes = _one("slip angle (deg)", "slip ratio")
    low, high = RANGE_DEG
    law = two_segments_of_model(model, np.radians(SLOPE_DEG), (np.radians(low), np.radians(high)))
    angle = np.linspace(0.0, 30.0, 61)
    radians = np.radians(angle).tolist()
    traction = float(np.sin(np.radians(SLOPE_DEG)))
    axes.plot(angle, [model.slip_at(traction, a) for a in radians], ".-", color=TRUTH, label="model, eqs 5-9")
    axes.plot(
        angle,
        [law.slip_at(a) for a in radians],
        color=ESTIMATE,
        label=f"two segments fitted over {low:.0f}-{high:.0f} deg",
    )
    return _svg(figure, axes)


def _one(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(WIDTH_IN, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    return figure, axes


def _svg(figure: Figure, axes: Axes) -> str:
    axes.legend(fontsize="small")
    return svg(figure).decode()
