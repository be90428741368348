"""`rover-hil terrain` as a user meets it."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.clock import SystemClock, seconds
from tests.rover_hil.command import Command

KEYS = [
    "slope_deg",
    "roll_deg",
    "mass_kg",
    "slip",
    "slip_angle_deg",
    "sinkage_uphill_m",
    "sinkage_downhill_m",
    "boundary",
    "reason",
]
EXPECTED = {
    (10.0, 0.0): (0.0695, -6.289),
    (10.0, 5.0): (0.0327, -1.882),
    (10.0, 10.0): (0.0, 0.0),
    (10.0, 15.0): (0.0157, 1.174),
    (10.0, 20.0): (0.0364, 3.625),
    (15.0, 0.0): (0.1017, -12.446),
    (15.0, 5.0): (0.0677, -6.220),
    (15.0, 10.0): (0.0258, -1.631),
    (15.0, 15.0): (0.0, 0.0),
    (15.0, 20.0): (0.0067, 0.789),
}


class Terrain(Command):
    """Runs `rover-hil terrain`."""

    def __call__(self, *arguments: str) -> int:
        return super().__call__("terrain", *arguments)


@pytest.fixture
def terrain(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Terrain:
    monkeypatch.chdir(tmp_path)
    return Terrain(monkeypatch, capsys)


@pytest.mark.parametrize("name", ["wheel", "traverse", "climb", "papers", "fit"])
def test_help_has_an_example(terrain: Terrain, name: str) -> None:
    assert terrain(name, "--help") == 0
    assert f"Example: rover-hil terrain {name}" in terrain.out


def test_traverse_reproduces_the_expected_states(terrain: Terrain) -> None:
    assert terrain("traverse", "--slope-deg", "10,15", "--json") == 0
    rows = json.loads(terrain.out)
    assert [list(row) for row in rows] == [KEYS] * 10
    assert [(row["slope_deg"], row["roll_deg"]) for row in rows] == list(EXPECTED)
    for row in rows:
        slip, angle = EXPECTED[row["slope_deg"], row["roll_deg"]]
        assert row["slip"] == pytest.approx(slip, abs=6e-5)
        assert row["slip_angle_deg"] == pytest.approx(angle, abs=6e-4)
        assert row["boundary"] is (row["slope_deg"] == row["roll_deg"])
        assert row["mass_kg"] == 23.8
        assert 0.015 < row["sinkage_uphill_m"] < row["sinkage_downhill_m"] < 0.03


def test_the_last_list_runs_fastest(terrain: Terrain) -> None:
    assert (
        terrain("traverse", "--slope-deg", "5,10", "--roll-deg", "0,2", "--mass-kg", "30,20", "--json") == 0
    )
    rows = json.loads(terrain.out)
    found = [(row["slope_deg"], row["roll_deg"], row["mass_kg"]) for row in rows]
    assert rows[0]["sinkage_uphill_m"] > 1.1 * rows[1]["sinkage_uphill_m"]
    assert found == [(a, r, m) for a in (5.0, 10.0) for r in (0.0, 2.0) for m in (30.0, 20.0)]


def test_no_equilibrium_is_null_and_exit_code_1(terrain: Terrain) -> None:
    assert terrain("traverse", "--slope-deg", "20,40", "--roll-deg", "0", "--json") == 1
    good, bad = json.loads(terrain.out)
    assert good["slip"] > 0.0
    assert [bad[key] for key in KEYS[3:7]] == [None] * 4
    assert bad["boundary"] is False
    assert terrain.error.startswith("no equilibrium at slope 40 deg, roll 0 deg, mass 23.8 kg: the slope is")
    assert terrain.error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["traverse", "--mass-kg", "-3"], ["--mass-kg is -3 kg", "0.01 .. 1e+06 kg"]),
        (["traverse", "--slope-deg", "60"], ["--slope-deg is 60 deg", "0 .. 45 deg"]),
        (["traverse", "--slope-deg", "-5"], ["--slope-deg is -5 deg", "0 .. 45 deg"]),
        (["traverse", "--roll-deg", "nan"], ["--roll-deg is nan deg", "-45 .. 45 deg"]),
        (["traverse", "--roll-deg", "0:20"], ["--roll-deg is '0:20'", "from:to:step"]),
        (["traverse", "--roll-deg", "-40"], ["--roll-deg less --slope-deg is -60 deg", "-52 .. 52 deg"]),
        (["traverse", "--soil", "mud"], ["'mud'", "toyoura"]),
        (["traverse", "--rover", "tank"], ["'tank'", "paper_001"]),
        (["traverse", "--rover", "missing.toml"], ["missing.toml"]),
        (["traverse", "--wheel", "round"], ["'round'", "wh31"]),
        (["wheel", "--load-n", "-1"], ["--load-n is -1 N"]),
        (["wheel", "--slip", "1.5"], ["--slip is 1.5", "-0.99 .. 1"]),
        (["wheel", "--slip-angle-deg", "90"], ["--slip-angle-deg is 90 deg", "-88 .. 88 deg"]),
        (["wheel", "--camber-deg", "nan"], ["--camber-deg is nan deg", "-45 .. 45 deg"]),
        (["climb", "--slip-limit", "1.2"], ["--slip-limit is 1.2", "0.01 .. 0.99"]),
        (["climb", "--mass-kg", "nan"], ["--mass-kg is nan kg"]),
        (["fit", "nowhere"], ["nowhere"]),
        (["fit", "."], [". holds no plates.csv: docs/reference/terrain.md"]),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(
    terrain: Terrain, arguments: list[str], words: list[str]
) -> None:
    assert terrain(*arguments) == 2
    assert terrain.out == ""
    assert terrain.error.startswith("rover-hil: ")
    assert terrain.error.count("\n") == 1
    for word in words:
        assert word in terrain.error


def test_wrong_data_files_name_file_key_and_range(terrain: Terrain, tmp_path: Path) -> None:
    (tmp_path / "flat.toml").write_text('source = "me"\nradius_m = -0.1\nwidth_m = 0.1\n')
    assert terrain("wheel", "--wheel", "flat.toml") == 2
    assert "flat.toml: radius_m is -0.1 m, outside 0.001 .. 5 m" in terrain.error


def test_rover_file_is_read_and_another_wheel_replaces_its_own(terrain: Terrain, tmp_path: Path) -> None:
    (tmp_path / "six.toml").write_text(
        "mass_kg = 35.7\n"
        "wheel_positions_m = [[0.3, 0.275], [0.0, 0.275], [-0.3, 0.275],"
        " [0.3, -0.275], [0.0, -0.275], [-0.3, -0.275]]\n"
        '[wheel]\nsource = "paper"\nradius_m = 0.097\nwidth_m = 0.1\n'
    )
    assert terrain("traverse", "--rover", "six.toml", "--roll-deg", "0", "--json") == 0
    (six,) = json.loads(terrain.out)
    assert terrain("traverse", "--roll-deg", "0", "--json") == 0
    (four,) = json.loads(terrain.out)
    # Six wheels with half as much mass again bear what four do.
    assert six["mass_kg"] == 35.7
    assert six["slip"] == pytest.approx(four["slip"], rel=1e-9)
    assert terrain("traverse", "--rover", "six.toml", "--wheel", "wh34", "--roll-deg", "0", "--json") == 0
    assert json.loads(terrain.out)[0]["sinkage_uphill_m"] < 0.8 * six["sinkage_uphill_m"]


def test_wheel_tells_forces_in_order_and_what_the_soil_does_not_bear(terrain: Terrain) -> None:
    arguments = ["--slip", "0,0.3", "--slip-angle-deg", "-10,0,10", "--load-n", "60", "--json"]
    assert terrain("wheel", *arguments) == 0
    rows = json.loads(terrain.out)
    assert [(row["slip"], row["slip_angle_deg"]) for row in rows] == [
        (slip, angle) for slip in (0.0, 0.3) for angle in (-10.0, 0.0, 10.0)
    ]
    left, straight, right = rows[3:]
    assert left["side_n"] == pytest.approx(-right["side_n"], rel=1e-9)
    assert left["side_n"] > 5.0
    assert straight["side_n"] == 0.0
    assert straight["drawbar_n"] > left["drawbar_n"] == pytest.approx(right["drawbar_n"], rel=1e-9)
    assert terrain("wheel", "--slip", "0.1", "--slip-angle-deg", "0", "--load-n", "60,5000", "--json") == 1
    borne, sunk = json.loads(terrain.out)
    assert borne["drawbar_n"] > 0.0
    assert sunk["sinkage_m"] is None
    assert sunk["drawbar_n"] is None
    assert terrain.error == (
        "the soil does not bear 5000 N at slip 0.1, slip angle 0 deg before the wheel sinks to its axle "
        "(1 such rows).\n"
    )


def test_climb_needs_more_slip_than_descent_and_ends_at_its_limit(terrain: Terrain) -> None:
    arguments = ["--slope-deg", "5,10,20", "--slip-limit", "0.5", "--json"]
    assert terrain("climb", *arguments) == 0
    result = json.loads(terrain.out)
    five, ten, twenty = result["slopes"]
    assert 0.0 < five["slip_up"] < ten["slip_up"] < 0.5 < twenty["slip_up"]
    assert 0.0 > five["slip_down"] > ten["slip_down"] > twenty["slip_down"] > -twenty["slip_up"]
    rover, wh31 = result["limits"][0], result["limits"][1]
    assert 10.0 < rover["climbable_deg"] < 20.0 < rover["descendable_deg"]
    edge = f"{rover['climbable_deg']}"
    assert terrain("climb", "--slope-deg", edge, "--slip-limit", "0.5", "--json") == 0
    assert json.loads(terrain.out)["slopes"][0]["slip_up"] == pytest.approx(0.5, abs=1e-3)
    # Paper 002, Table V: 0.13 s + 0.25 in slip, 0.56 s - 0.26 in skid.
    assert wh31["climbable_deg"] == pytest.approx(17.4848, abs=1e-3)
    assert wh31["descendable_deg"] == pytest.approx(39.3518, abs=1e-3)
    assert result["measured_wheels"][2]["Wh32_slip_up"] is None


def test_climb_that_never_starts_is_exit_code_1(terrain: Terrain) -> None:
    assert terrain("climb", "--slope-deg", "5", "--mass-kg", "3000", "--json") == 1
    result = json.loads(terrain.out)
    assert result["limits"][0]["climbable_deg"] is None
    assert result["slopes"][0]["slip_up"] is None
    assert "level ground" in terrain.error


def test_out_writes_one_page_that_needs_nothing_else_and_exact_numbers(
    terrain: Terrain, tmp_path: Path
) -> None:
    assert terrain("traverse", "--slope-deg", "10,20", "--out", "t", "--json") == 0
    rows = json.loads(terrain.out)
    assert sorted(path.name for path in (tmp_path / "t").iterdir()) == ["report.html", "traverse.csv"]
    with (tmp_path / "t" / "traverse.csv").open() as file:
        written = list(csv.DictReader(file))
    assert [float(row["slip_angle_deg"]) for row in written] == [row["slip_angle_deg"] for row in rows]
    page = (tmp_path / "t" / "report.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 2
    assert "http:" not in page.replace("http://www.w3.org", "")
    assert "https:" not in page


def test_papers_writes_both_papers_figures(terrain: Terrain, tmp_path: Path) -> None:
    assert terrain("papers", "--out", "p", "--json") == 0
    assert len(json.loads(terrain.out)) == 20
    names = ["limits.csv", "measured_wheels.csv", "report.html", "traverse.csv"]
    assert sorted(path.name for path in (tmp_path / "p").iterdir()) == names
    assert "Wh32_slip_up" in (tmp_path / "p" / "measured_wheels.csv").read_text()
    page = (tmp_path / "p" / "report.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 6
    assert "33.8" in page


def test_out_that_cannot_be_written_is_told(terrain: Terrain, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    assert terrain("wheel", "--out", "taken") == 2
    assert "taken" in terrain.error


def test_plates_alone_give_modulus_and_exponent(terrain: Terrain, shared_data: Path, tmp_path: Path) -> None:
    data = str(shared_data / "cmu_single_wheel")
    assert terrain("fit", data, "--plates-only", "--json", "--out", "sand") == 0
    fitted = {row["name"]: row for row in json.loads(terrain.out)["fitted"]}
    exponent = fitted["plate_exponent"]
    assert exponent["lower"] < exponent["value"] < exponent["upper"]
    assert 1.31 < exponent["value"] < 1.61
    assert (
        terrain("fit", data, "--plates-only", "--json", "--soil", str(tmp_path / "sand" / "soil.toml")) == 0
    )
    assert json.loads(terrain.out)["fitted"][1] == exponent


def test_wheel_tests_tell_chosen_numbers(terrain: Terrain, shared_data: Path, tmp_path: Path) -> None:
    data = str(shared_data / "cmu_single_wheel")
    assert terrain("fit", data, "--free", "slide_number", "--json", "--out", "sand") == 0
    result = json.loads(terrain.out)
    assert [row["name"] for row in result["fitted"]] == ["slide_number"]
    assert result["cells"] == 63
    names = sorted(path.name for path in (tmp_path / "sand").iterdir())
    assert names == ["cells.csv", "report.html", "soil.csv", "soil.toml"]
    assert terrain("fit", data, "--free", "colour") == 2
    assert "'colour'" in terrain.error


def test_default_traverse_takes_less_than_two_seconds_and_no_compiler() -> None:
    words = "import sys; sys.argv = ['rover-hil', 'terrain', 'traverse', '--json']\n"
    program = (
        f"{words}from rover_hil.app.app import main\n"
        "try:\n    main()\n"
        "finally:\n    assert not {'numba', 'matplotlib'} & set(sys.modules)\n"
    )
    clock = SystemClock()
    start_ns = clock.now_ns()
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)) == 5
    # Generous, for a busy machine; an idle one takes half a second.
    assert seconds(clock.now_ns() - start_ns) < 8.0


def test_a_fitted_soil_is_read_by_every_command_and_its_marks_are_told(
    terrain: Terrain, shared_data: Path, tmp_path: Path
) -> None:
    data = str(shared_data / "cmu_single_wheel")
    assert terrain("fit", data, "--plates-only", "--json", "--out", "sand") == 0
    rows = {row["name"]: row for row in json.loads(terrain.out)["not_fitted"]}
    assert rows["density_kg_m3"]["reason"] == "not fitted: the number of cmu_sand_blind"
    assert "plate_exponent" not in rows
    text = (tmp_path / "sand" / "soil.toml").read_text()
    assert "friction_angle_deg = 29.0  # not fitted: of cmu_sand_blind\n" in text
    for arguments in (
        ["wheel", "--wheel", "cmu_smooth", "--slip", "0.2", "--slip-angle-deg", "0"],
        ["traverse", "--slope-deg", "5", "--roll-deg", "5"],
        ["climb", "--slope-deg", "5"],
    ):
        assert terrain(*arguments, "--soil", "sand/soil.toml", "--json") == 0
        assert "density_kg_m3, friction_angle_deg" in terrain.error
        assert "not fitted, they are those of cmu_sand_blind" in terrain.error
        fitted = json.loads(terrain.out)
    # The library's soil has rounded numbers of the same plates, and of the same books.
    assert terrain("climb", "--slope-deg", "5", "--soil", "cmu_sand", "--json") == 0
    book = json.loads(terrain.out)
    assert terrain.error == ""
    slips = [result["slopes"][0]["slip_up"] for result in (fitted, book)]
    assert slips[0] == pytest.approx(slips[1], rel=0.1)


def test_numbers_of_wheel_tests_are_not_marked(terrain: Terrain, shared_data: Path, tmp_path: Path) -> None:
    data = str(shared_data / "cmu_single_wheel")
    assert terrain("fit", data, "--free", "shear_modulus_m", "--json", "--out", "sand") == 0
    names = [row["name"] for row in json.loads(terrain.out)["not_fitted"]]
    assert "shear_modulus_m" not in names
    assert "plate_modulus_pa" not in names
    assert terrain("wheel", "--soil", "sand/soil.toml", "--slip", "0.2", "--slip-angle-deg", "0") == 0
    assert "shear_modulus_m" not in terrain.error
    assert "friction_angle_deg" in terrain.error


def test_every_missing_number_has_a_reason_on_the_terminal(terrain: Terrain) -> None:
    assert terrain("climb", "--slope-deg", "40") == 0
    assert "slope deg 40: the slope is steeper than the soil's angle of friction" in terrain.out
    assert terrain("wheel", "--slip", "0.1", "--slip-angle-deg", "0", "--load-n", "5000") == 1
    assert "load n 5000 and slip 0.1 and slip angle deg 0: the wheel sinks to its axle" in terrain.out
    assert terrain("climb", "--slope-deg", "5", "--mass-kg", "3000", "--json") == 1
    reason = json.loads(terrain.out)["limits"][0]["reason"]
    assert reason == "on level ground already the soil cannot bear the rover: its wheels sink to the axles"


SOIL = """source = "a book"
cohesion_pa = 500.0
friction_angle_deg = 30.0
density_kg_m3 = 1500.0
shear_modulus_m = 0.02
greatest_stress = [0.4, 0.15]
exit_polynomial = [0.0, 0.0, 0.0]
[pressure]
law = "bekker"
k_c_pa_m = {k_c}
k_phi_pa = {k_phi}
exponent = 1.0
"""


def test_a_negative_modulus_counts_with_the_other_at_the_size_of_the_wheel(
    terrain: Terrain, tmp_path: Path
) -> None:
    """The contact is longer than the wheel is wide, so that both soils have the same sum there: 1 MPa/m."""
    (tmp_path / "negative.toml").write_text(SOIL.format(k_c=-50e3, k_phi=2e6))
    (tmp_path / "sum.toml").write_text(SOIL.format(k_c=0.0, k_phi=1e6))
    (tmp_path / "narrow.toml").write_text('source = "me"\nradius_m = 0.25\nwidth_m = 0.05\n')
    found = []
    for soil in ("negative.toml", "sum.toml"):
        arguments = ["--load-n", "200", "--slip", "0,0.3", "--slip-angle-deg", "0", "--json"]
        assert terrain("wheel", "--wheel", "narrow.toml", "--soil", soil, *arguments) == 0
        found.append(json.loads(terrain.out))
    for negative, positive in zip(*found, strict=True):
        assert negative["sinkage_m"] == pytest.approx(positive["sinkage_m"], rel=1e-9)
        assert negative["drawbar_n"] == pytest.approx(positive["drawbar_n"], rel=1e-9)
    assert (
        terrain(
            "climb",
            "--slope-deg",
            "5",
            "--mass-kg",
            "40",
            "--wheel",
            "narrow.toml",
            "--soil",
            "negative.toml",
        )
        == 0
    )
    (tmp_path / "thin.toml").write_text('source = "me"\nradius_m = 0.25\nwidth_m = 0.02\n')
    assert terrain("climb", "--wheel", "thin.toml", "--soil", "negative.toml") == 2
    assert terrain.error.startswith(
        "rover-hil: k_c and k_phi of the soil together are -5e+05 Pa/m^n at the width of 0.02 m"
    )
