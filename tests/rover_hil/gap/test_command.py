"""`rover-hil gap` as a user meets it: files, keys, exit codes, models of their own, extended models."""

import json
import re
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.app.app import main
from rover_hil.gap.command.find import find_gap, named_model
from rover_hil.gap.data.load import check_model, load_model, read_runs
from rover_hil.gap.output.model_file import ExtendedModel, read_model_file
from tests.nature.axis import Drive, measure_axis, some_axis, table
from tests.rover_hil.gap.gap_data import EXAMPLES, cart_rows, cart_runs, write_cart
from tests.rover_hil.gap.gap_models import Cart

CART = f"{Path(__file__).parent / 'gap_models.py'}:make_cart"
KEYS = {
    "verdict",
    "sentence",
    "p_gap",
    "where",
    "effects",
    "base_parameters",
    "confidence_set",
    "probabilities",
    "order",
    "rejected",
    "unnamed",
    "next_run",
    "next_runs",
    "detectable",
    "gap",
    "error_budget",
    "draft",
    "weightings",
    "warnings",
    "missing",
    "seconds",
}
Run = Callable[..., tuple[int, dict[str, object]]]


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    def call(
        data: Path, out: str = "out", model: str = CART, extended: Path | None = None, confirm: str = ""
    ) -> tuple[int, dict[str, object]]:
        folder = tmp_path / out
        code = find_gap(
            named_model(model, data), out=folder, extended=extended, confirm=confirm, seed=0, as_json=True
        )
        printed = json.loads(capsys.readouterr().out)
        if code == 1:
            assert not folder.exists()
            return code, printed
        assert printed == json.loads((folder / "verdict.json").read_text())
        assert sorted(path.name for path in folder.iterdir()) == [
            "model.toml",
            "plan.json",
            "report.html",
            "verdict.json",
        ]
        return code, printed

    return call


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Analyse runs in which soil flows, once for all tests that read or change what is written."""
    folder = tmp_path_factory.mktemp("gap")
    data = write_cart(folder / "runs.csv", cart_rows(5, creep=0.35))
    find_gap(named_model(CART, data), out=folder / "out", extended=None, confirm="", seed=0, as_json=True)
    return folder / "out"


@pytest.mark.usefixtures("unrendered")
def test_a_hidden_effect_is_named_added_and_gone(run: Run, tmp_path: Path) -> None:
    data = write_cart(tmp_path / "runs.csv", cart_rows(5, creep=0.35))
    code, verdict = run(data)
    assert code == 0
    assert set(verdict) == KEYS
    assert verdict["verdict"] == "NAMED"
    assert verdict["confidence_set"] == [["slope_failure"]]
    plan = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert len(plan["confirm"]) == 15
    model = tomllib.loads((tmp_path / "out" / "model.toml").read_text())
    assert model["base"] == CART
    assert model["provenance"]["plan_sha256"] == plan["plan_sha256"]
    assert model["provenance"]["data_sha256"] == plan["data_sha256"]
    assert set(model["effects"]) == {"slope_failure"}
    gain = model["effects"]["slope_failure"]["gain_deg_per_deg"]
    assert gain["unit"] == "deg/deg"
    assert gain["ci95"][0] <= gain["value"] <= gain["ci95"][1]

    code, again = run(data, out="again", extended=tmp_path / "out" / "model.toml")
    assert code == 0
    assert again["verdict"] == "NO_GAP"
    kept = tomllib.loads((tmp_path / "again" / "model.toml").read_text())
    assert kept["effects"]["slope_failure"]["gain_deg_per_deg"]["value"] == gain["value"]


@pytest.mark.usefixtures("unrendered")
def test_a_second_effect_is_found_with_the_first_in_the_model(run: Run, found: Path, tmp_path: Path) -> None:
    second = write_cart(tmp_path / "second.csv", cart_rows(5, creep=0.35, radius=1.0))
    _, verdict = run(second, out="next", extended=found / "model.toml")
    assert verdict["confidence_set"] == [["wheel_radius"]]
    model = tomllib.loads((tmp_path / "next" / "model.toml").read_text())
    assert set(model["effects"]) == {"slope_failure", "wheel_radius"}


def test_an_extended_model_predicts_what_was_fitted(found: Path) -> None:
    file = read_model_file(found / "model.toml")
    runs = cart_runs(1)[:5]
    extended = ExtendedModel(Cart(), file)
    values = {name: number.value for name, number in file.parameters.items()}
    effects = {
        name: {key: number.value for key, number in numbers.items()} for name, numbers in file.effects.items()
    }
    assert extended.predict(runs, {}, {}) == Cart().predict(runs, values, effects)
    assert "slope_failure" not in {card.name for card in extended.effects}
    assert extended.active == ("slope_failure",)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rover-hil-model/1", "rover-hil-model/9", "schema"),
        ("[effects.slope_failure.", "[effects.landslide.", "no effect 'landslide'"),
        ("[parameters.rolling]", "[parameters.rollin]", "no such parameter"),
        ('unit = "deg/deg"', 'unit = "rad"', "unit is rad"),
        ("seed = 0", "seed = 0\nspeed = 3", "speed"),
        ("[parameters.rolling]", "[parameters.rolling", "not a TOML"),
    ],
)
def test_a_wrong_model_file_is_told(found: Path, tmp_path: Path, old: str, new: str, words: str) -> None:
    text = (found / "model.toml").read_text()
    path = tmp_path / "model.toml"
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=re.escape(words)):
        ExtendedModel(Cart(), read_model_file(path))


def test_the_report_stands_alone_and_says_everything(found: Path) -> None:
    verdict = json.loads((found / "verdict.json").read_text())
    page = (found / "report.html").read_text()
    assert str(verdict["sentence"]).split(" (")[0] in page
    # Budget and agreement of six channels.
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    assert page.count("data:image/svg+xml") == 12
    for words in (
        "Measured and simulated",
        "Error budget",
        "Base parameters",
        "Not named, and why",
        "plan_sha256",
    ):
        assert words in page


def test_locked_runs_are_not_drawn_where_nothing_is_proved(run: Run, tmp_path: Path) -> None:
    _, verdict = run(write_cart(tmp_path / "runs.csv", cart_rows(12)))
    assert verdict["verdict"] == "NO_GAP"
    page = (tmp_path / "out" / "report.html").read_text()
    assert "On the locked runs" not in page


@pytest.mark.usefixtures("unrendered")
def test_confirm_chooses_the_locked_runs(run: Run, tmp_path: Path) -> None:
    data = write_cart(tmp_path / "runs.csv", cart_rows(5, creep=0.35))
    run(data, confirm="mass_kg > 30")
    plan = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert all(name.startswith("c4") for name in plan["confirm"])
    assert plan["confirm_rule"] == "mass_kg > 30"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("slip_angle_deg", "slip_angle_deg [rad]", "is in rad"),
        ("slip_angle_deg", "slip_angle", "channel slip_angle_deg is in no run"),
        ("roll_deg", "lean_deg", "no column 'roll_deg'"),
        ("c1_p0_r1,10.0", "c1_p0_r1,steep", "'steep' is not a number"),
        ("c1_p0_r1,10.0", "c1_p0_r1,", "slope_deg is nan"),
    ],
)
def test_bad_tables_get_a_verdict_with_the_reason(
    run: Run, tmp_path: Path, old: str, new: str, words: str
) -> None:
    data = write_cart(tmp_path / "runs.csv", cart_rows(5))
    text = data.read_text()
    assert old in text
    data.write_text(text.replace(old, new, 1))
    code, verdict = run(data)
    assert code == 1
    assert verdict["verdict"] == "BAD_DATA"
    assert words in str(verdict["sentence"])
    assert verdict["confidence_set"] == []


def test_series_need_units_in_their_header(run: Run, tmp_path: Path) -> None:
    import numpy as np

    rng = np.random.default_rng(1)
    text = table(measure_axis(some_axis(rng), Drive(), rng))
    (tmp_path / "axis.csv").write_text(text.replace("voltage [V]", "voltage"))
    code, verdict = run(tmp_path / "axis.csv", model=f"{EXAMPLES / 'my_axis.py'}:make")
    assert code == 1
    assert "column 'voltage' has no unit; write 'voltage [V]'" in str(verdict["sentence"])


def test_one_file_per_run(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    for name in ("b", "a"):
        (folder / f"{name}.csv").write_text("load [kg],voltage [V],speed [rad/s]\n1,2,3\n1,2,4\n")
    runs = read_runs(load_model(f"{EXAMPLES / 'my_axis.py'}:make"), folder)
    assert [one.name for one in runs] == ["a", "b"]
    assert runs[0].measured["speed"].tolist() == [3.0, 4.0]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no-such-model", "there is no model"),
        ("axis.py", "axis.py: name the function that makes the model, like axis.py:make"),
        ("nowhere.py:make", "check the path"),
        (CART.replace("make_cart", "make_cat"), "no function 'make_cat'"),
    ],
)
def test_a_wrong_model_name_is_told(name: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_model(name)


def test_a_card_whose_null_is_not_the_base_model_is_told() -> None:
    class Wrong(Cart):
        def predict(self, runs, parameters, effects):  # type: ignore[no-untyped-def]
            tables = super().predict(runs, parameters, effects)
            if "camera_yaw" in effects:
                tables[0]["slip"] = tables[0]["slip"] + 1e-3
            return tables

    with pytest.raises(ConfigError, match="camera_yaw changes slip"):
        check_model(Wrong(), cart_runs(1))


def test_exit_codes_of_the_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = str(tmp_path / "o")
    monkeypatch.setattr(sys, "argv", ["rover-hil", "gap", CART, str(tmp_path / "no.csv"), "--out", out])
    with pytest.raises(SystemExit) as absent:
        main()
    assert absent.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "o").exists()
