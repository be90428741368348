"""Tuning tasks with deliberately poor start values, and what the hand-tuned ones cost."""

from rover_hil.config import Config, load_config
from rover_hil.config.tune_settings import CaseSettings, ObjectiveSettings, TunableSettings, TuneSettings
from rover_hil.tune.objective import evaluate
from rover_hil.tune.parameters import check_parameters, with_values
from rover_hil.tune.scenarios import held_out_seeds
from rover_hil.tune.simulated_mission import simulate_mission

OBJECTIVE = ObjectiveSettings(path_rms_m=0.045, closure_m=0.1, heading_deg=3, effort_rad_s2=5, duration_s=30)
GAINS: dict[str, tuple[float, float, float, str]] = {
    "mission.lookahead_m": (0.03, 1.0, 1.5, "m"),
    "mission.heading_gain_per_s": (0.05, 0.1, 10.0, "1/s"),
    "mission.approach_gain_per_s": (0.3, 5.0, 10.0, "1/s"),
}
NOISE: dict[str, tuple[float, float, float, str]] = {
    "filter.gyro_bias_rad_s": (1e-6, 1e-6, 0.1, "rad/s"),
    "filter.gyro_noise_rad_sqrt_s": (1e-5, 0.05, 0.1, "rad/sqrt(s)"),
    "filter.gyro_bias_walk_rad_s_sqrt_s": (1e-7, 0.01, 0.01, "rad/s/sqrt(s)"),
    "filter.gyro_rate_noise_rad_s": (1e-4, 0.1, 0.1, "rad/s"),
    "mission.yaw_rate_limit_rad_s": (0.1, 0.15, 3.0, "rad/s"),
}
FOUR_WHEELS: dict[str, tuple[float, float, float, str]] = {
    "mission.lookahead_m": (0.05, 2.0, 2.0, "m"),
    "mission.heading_gain_per_s": (0.1, 0.1, 5.0, "1/s"),
    "mission.yaw_rate_limit_rad_s": (0.03, 0.03, 0.3, "rad/s"),
    "filter.heading_noise_rad": (0.005, 0.5, 0.5, "rad"),
    "filter.gyro_noise_rad_sqrt_s": (1e-4, 0.05, 0.05, "rad/sqrt(s)"),
    "filter.gyro_bias_rad_s": (1e-4, 1e-4, 0.1, "rad/s"),
}
"""Lowest, start and greatest value, and the unit."""
TASKS = {
    "gains": {**GAINS, "filter.gyro_bias_rad_s": NOISE["filter.gyro_bias_rad_s"]},
    "gains and noise": {**GAINS, **NOISE},
    "four wheels": FOUR_WHEELS,
}


def make_task(name: str) -> Config:
    """Return the rover of a task with poor values, and with [tune]."""
    return with_values(tuned_by_hand(name), {key: start for key, (_, start, _, _) in TASKS[name].items()})


def tuned_by_hand(name: str) -> Config:
    """Return the shipped rover of a task with the task's [tune]."""
    if name == "four wheels":
        rover, cases = without_camera(load_config("el-dorado")), CaseSettings(train=4, held_out=12)
    else:
        rover, cases = load_config("robotino"), CaseSettings(train=8, held_out=24)
    assert rover.tune is not None
    tune = TuneSettings(
        parameters={
            key: TunableSettings(low=low, high=high, scale="log", unit=unit)
            for key, (low, _, high, unit) in TASKS[name].items()
        },
        objective=rover.tune.objective if name == "four wheels" else OBJECTIVE,
        cases=cases,
    )
    return rover.model_copy(update={"tune": tune})


def held_out_cost(config: Config) -> float | None:
    """Return the cost on scenarios that no search uses; None where a mission is rejected."""
    settings = check_parameters(config)

    return evaluate(
        lambda config, seeds: (simulate_mission(config, seed) for seed in seeds),
        config,
        held_out_seeds(settings.cases),
        settings.objective,
    ).cost


def without_camera(config: Config) -> Config:
    """Return a four-wheel rover that estimates its slip by the tilt alone."""
    devices = {name: settings for name, settings in config.devices.items() if name != config.roles.camera}
    scomp = config.scomp
    assert scomp is not None
    return config.model_copy(
        update={
            "devices": devices,
            "roles": config.roles.model_copy(update={"camera": None}),
            "scomp": scomp.model_copy(update={"rig": None}),
        }
    )
