"""Simulations with a functional mock-up unit that the tests build."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from sim_backends.fmu.example.build import HERE
from sim_backends.fmu.model import UnitModel
from sim_backends.fmu.read import read_unit_model
from sim_backends.models.interface import Array, Run
from tests.fmu_unit import TOML, needs_a_unit, unit_folder

pytestmark = needs_a_unit
CODE = (HERE / "axis.c").read_text("utf-8")
STEP_S, COUNT = 0.04, 60


def a_run(name: str = "run0", *, seed: int = 0, count: int = COUNT) -> Run:
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(-6.0, 6.0, count // 10 + 1), 10)[:count]
    return Run(name=name, conditions={}, inputs={"voltage": voltage}, measured={"encoder": np.zeros(count)})


def angle_of(run: Run, *, friction: float = 0.0, first_speed: float = 0.0, inertia: float = 0.005) -> Array:
    """Return the angle by an integration of our own: midpoint rule, steps of 0.1 ms, inputs held."""
    angle, speed, found = 0.0, first_speed, []
    for volts in run.inputs["voltage"]:
        found.append(angle)
        for _ in range(400):

            def rate(now: float, volts: float = float(volts)) -> float:
                return (0.085 * volts - 0.02 * now - friction * math.tanh(now / 0.1)) / inertia

            middle = speed + 0.5e-4 * rate(speed)
            angle += 1e-4 * middle
            speed += 1e-4 * rate(middle)
    return np.array(found)


@pytest.fixture(scope="module", params=[2, 3])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[UnitModel]:
    version: int = request.param
    folder = tmp_path_factory.mktemp(f"fmi{version}")
    found = read_unit_model(unit_folder(folder, version=version))
    yield found
    found.workers.close()


def encoder(model: UnitModel, run: Run, parameters: Mapping[str, float], **effects: float) -> Array:
    given = {"coulomb_friction": {"level": effects["level"]}} if effects else {}
    return model.predict([run], parameters, given)[0]["encoder"]


def test_a_run_is_that_of_the_equations(model: UnitModel) -> None:
    run = a_run()
    assert encoder(model, run, {}) == pytest.approx(angle_of(run), abs=2e-4)
    moved = encoder(model, run, {"first_speed@run0": 3.0, "inertia": 0.006}, level=0.02)
    assert moved == pytest.approx(angle_of(run, friction=0.02, first_speed=3.0, inertia=0.006), abs=2e-4)


def test_points_and_runs_are_independent_of_each_other(model: UnitModel) -> None:
    runs = [a_run("run0"), a_run("run1", seed=1, count=45)]
    points = [({}, {}), ({"first_speed@run1": 2.0}, {"push": {"offset": 0.01}}), ({}, {})]
    together = model.predict_points(runs, points)
    assert [[table["encoder"].size for table in row] for row in together] == [[60, 45]] * 3
    for point, row in zip(points, together, strict=True):
        for run, table in zip(runs, row, strict=True):
            alone = model.predict([run], *point)[0]["encoder"]
            assert np.array_equal(table["encoder"], alone)
    assert np.array_equal(together[0][0]["encoder"], together[2][0]["encoder"])


def test_the_first_reading_is_where_a_run_starts(model: UnitModel) -> None:
    run = a_run()
    run.measured["encoder"][:] = 0.7
    assert encoder(model, run, {})[0] == 0.7
    assert encoder(model, run, {"first_angle@run0": 0.8})[0] == 0.8


def test_runs_may_deviate_from_a_parameter_and_from_a_strength(model: UnitModel) -> None:
    runs = [a_run("run0"), a_run("run1")]
    point = {"damping": 0.02, "damping~@run1": 0.003, "coulomb_friction.level~@run0": 0.004}
    first, second = model.predict(runs, point, {"coulomb_friction": {"level": 0.01}})
    assert np.array_equal(first["encoder"], encoder(model, a_run(), {}, level=0.014))
    assert np.array_equal(second["encoder"], encoder(model, a_run(), {"damping": 0.023}, level=0.01))
    (held,) = model.predict(runs[:1], {"damping~@run0": -1.0}, {})
    assert np.array_equal(held["encoder"], encoder(model, a_run(), {"damping": 0.001}))


def test_an_effect_may_be_the_error_of_a_base_parameter(model: UnitModel) -> None:
    error = model.predict([a_run()], {"inertia": 0.0055}, {"wrong_inertia": {"error": 0.0005}})
    assert np.allclose(error[0]["encoder"], encoder(model, a_run(), {"inertia": 0.006}))


def test_signals_of_the_inside_are_read(model: UnitModel) -> None:
    (series,) = model.trajectories([a_run()], {}, {})
    assert sorted(series) == ["speed", "voltage"]
    assert np.trapezoid(series["speed"], dx=STEP_S) == pytest.approx(
        encoder(model, a_run(), {})[-1], rel=0.02
    )


def test_a_unit_that_ends_has_no_prediction_from_there_on_and_works_again(model: UnitModel) -> None:
    runs = [a_run("run0"), a_run("run1")]
    wild, sound = model.predict(runs, {"first_speed@run0": 3000.0}, {})
    assert np.isfinite(wild["encoder"][0])
    assert np.isnan(wild["encoder"][1:]).all()
    assert sound["encoder"] == pytest.approx(angle_of(runs[1]), abs=2e-4)


def test_values_that_are_not_finite_are_no_prediction(model: UnitModel) -> None:
    assert np.isnan(encoder(model, a_run(), {"inertia": 0.0, "damping": math.nan})[1:]).all()
    assert np.isfinite(encoder(model, a_run(), {})).all()


def test_the_folder_is_removed(tmp_path: Path) -> None:
    model = read_unit_model(unit_folder(tmp_path))
    folder = Path(model.workers.unit.place.folder)
    assert (folder / "modelDescription.xml").is_file()
    model.workers.close()
    assert not folder.exists()


def one_prediction(tmp_path: Path, code: str, *, version: int = 2, toml: str = TOML) -> Array:
    model = read_unit_model(unit_folder(tmp_path, version=version, code=code, toml=toml))
    try:
        model.predict([a_run()], {}, {})
        return model.predict([a_run()], {}, {})[0]["encoder"]
    finally:
        model.workers.close()


@pytest.mark.parametrize("version", [2, 3])
def test_a_crash_of_the_native_code_is_one_sentence(tmp_path: Path, version: int) -> None:
    code = CODE.replace("int count = (int)ceil", "abort();\n    int count = (int)ceil")
    with pytest.raises(ConfigError, match=r"the native code of axis\.fmu crashed"):
        one_prediction(tmp_path, code, version=version)


def test_what_a_unit_prints_does_not_mix_with_results(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code = CODE.replace(
        "static void begin(Axis *axis)\n{",
        'static void begin(Axis *axis)\n{\n    puts("hello"); fflush(stdout);',
    )
    assert one_prediction(tmp_path, f"#include <stdio.h>\n{code}").size == COUNT
    assert "hello" not in capfd.readouterr().out


def test_a_unit_that_refuses_its_token_cannot_be_loaded(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="the unit axis cannot be loaded"):
        one_prediction(tmp_path, CODE.replace("{a4a1c5f2", "{ffffffff"))


def test_a_unit_that_does_not_reset_gets_a_new_instance(tmp_path: Path) -> None:
    begun = "axis->value[ANGLE] = axis->value[FIRST_ANGLE];"
    lazy = CODE.replace(begun, begun.replace("=", "+=", 1))
    lazy = lazy.replace("memcpy(((Axis *)axis)->value, START, sizeof START);", "")
    kept = one_prediction(tmp_path, lazy)
    assert kept[0] != 0.0
    assert one_prediction(tmp_path, lazy, toml=f"reset = false\n{TOML}")[0] == 0.0


def euler(tmp_path: Path, line: str = "", *, sigma: float = 0.005) -> UnitModel:
    """Return a unit that makes one coarse step of its own per communication step."""
    code = CODE.replace("int count = (int)ceil(duration / INNER_STEP_S - 1e-9);", "int count = 1;").replace(
        "value[SPEED] += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0;", "value[SPEED] += h * a1;"
    )
    toml = TOML.replace("sigma = 0.005", f"sigma = {sigma}")
    return read_unit_model(unit_folder(tmp_path, code=code, toml=f"{line}\n{toml}"))


def test_communication_steps_are_halved_until_nothing_moves(tmp_path: Path) -> None:
    model = euler(tmp_path, sigma=0.05)
    refined = model.refined([a_run()])
    assert refined.substeps > 4
    errors = [encoder(one, a_run(), {}) - angle_of(a_run()) for one in (model, refined)]
    assert np.abs(errors[0]).max() > 0.1
    assert np.abs(errors[1]).max() < 0.02
    model.workers.close()


def test_a_step_that_never_suffices_is_an_error(tmp_path: Path) -> None:
    model = euler(tmp_path, sigma=0.0005)
    with pytest.raises(ConfigError, match="32 communication steps per sample are not enough"):
        model.refined([a_run()])
    model.workers.close()


def test_a_communication_step_that_is_given_is_kept(tmp_path: Path) -> None:
    model = euler(tmp_path, "communication_step_s = 0.02")
    assert model.refined([a_run()])._series(a_run()).substeps == 2
    model.workers.close()
    model = euler(tmp_path, "communication_step_s = 0.03")
    with pytest.raises(ConfigError, match=r"0\.03 does not divide the 0\.04 s"):
        model.refined([a_run()])
    model.workers.close()


def test_runs_may_have_different_multiples_of_the_communication_step(tmp_path: Path) -> None:
    timed = TOML.replace(f"step_s = {STEP_S}", "")
    model = read_unit_model(unit_folder(tmp_path, toml=f"communication_step_s = 0.02\n{timed}"))
    assert model.step_s is None
    runs = [
        replace(run, inputs={**run.inputs, "t_s": step_s * np.arange(float(COUNT))})
        for run, step_s in ((a_run("fine"), 0.02), (a_run("coarse"), 0.06))
    ]
    refined = model.refined(runs)
    assert [refined._series(run).substeps for run in runs] == [1, 3]
    times = runs[0].inputs["t_s"] + np.where(np.arange(COUNT) == 7, 0.01, 0.0)
    with pytest.raises(
        ConfigError, match=r"run fine: samples are 0\.01 to 0\.03 s apart, and the unit is simulated"
    ):
        refined.predict([replace(runs[0], inputs={**runs[0].inputs, "t_s": times})], {}, {})
    model.workers.close()


def test_inputs_are_straight_lines_where_they_are_not_held(tmp_path: Path) -> None:
    ramp = Run(
        name="run0", conditions={}, inputs={"voltage": np.arange(60.0)}, measured={"encoder": np.zeros(60)}
    )
    found = []
    for line in ("held = true", "held = false"):
        model = read_unit_model(unit_folder(tmp_path, toml=f"{line}\n{TOML}"))
        found.append(model.predict([ramp], {}, {})[0]["encoder"])
        model.workers.close()
    # Half a sample later: 0.02 s times the speed at the end, 4.25 rad/s per volt.
    assert found[1][-1] - found[0][-1] == pytest.approx(0.02 * 4.25 * 59.0, rel=0.15)
