"""Units and files beside them that cannot be used: one sentence each, and nothing is left behind."""

import importlib
import zipfile
from pathlib import Path
from tempfile import gettempdir

import pytest

from drivers.errors import ConfigError
from sim_backends.fmu import unit
from sim_backends.fmu.example.__main__ import main
from sim_backends.fmu.example.build import HERE
from sim_backends.fmu.read import read_unit_model
from sim_backends.fmu.unit import open_unit
from tests.fmu_unit import TOML, needs_a_unit, unit_folder

pytestmark = needs_a_unit


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("unit")
    unit_folder(found)
    return found


def sentence(path: Path) -> str:
    """Return why a model cannot be made; nothing is left in the folder of temporary files."""
    before = set(Path(gettempdir()).glob("rover-hil-fmu-*"))
    with pytest.raises(ConfigError) as raised:
        read_unit_model(path)
    assert not set(Path(gettempdir()).glob("rover-hil-fmu-*")) - before
    assert "\n" not in str(raised.value)
    return str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "damping = {",
            "dampin = {",
            "parameters.dampin: axis.fmu has no variable 'dampin'; the closest is damping",
        ),
        (
            'variable = "angle"',
            'variable = "Angel"',
            "channels.encoder: axis.fmu has no variable 'Angel'; the closest is angle",
        ),
        (
            "voltage = {}",
            'volts = { variable = "speed" }',
            "inputs.volts: 'speed' is no input of the unit: it is output",
        ),
        (
            'variable = "friction"',
            'variable = "speed"',
            "effects.coulomb_friction.strength: 'speed' cannot be set",
        ),
        (
            'variable = "offset"',
            'variable = "damping"',
            "effects.push.strength: 'damping' is set by damping already",
        ),
        (
            "speed = {}",
            'speed = { unit = "deg/s" }',
            "signals.speed: unit is 'deg/s', but 'speed' of the FMU is in 'rad/s'",
        ),
        (
            "lower = 0.001, upper = 0.1",
            "lower = 0.1, upper = 0.001",
            "parameters.damping: lower = 0.1 is not below",
        ),
        (
            "lower = 0.001, upper = 0.1",
            "lower = 0.05, upper = 0.1",
            "parameters.damping: 0.02 is outside of 0.05 to 0.1",
        ),
        (
            'channel = "encoder"',
            'channel = "encode"',
            "run_parameters.first_angle: there is no channel 'encode'",
        ),
        (
            'releases = "inertia"',
            'releases = "mass"',
            "effects.wrong_inertia.releases: there is no parameter 'mass'",
        ),
        ('variable = "friction", ', "", "effects.coulomb_friction.strength.variable is missing"),
        ("size = 0.01, lower", "sizes = 0.01, lower", "effects.coulomb_friction.strength.size is missing"),
        (
            "sigma = 0.005",
            "sigma = -1.0",
            "channels.encoder.sigma: Input should be greater than or equal to 0",
        ),
        ("step_s = 0.04", "step_ms = 40", "step_ms is no key of this file"),
        (
            "lower = 0.001, upper = 0.1",
            'lower = 0.001, upper = 0.1, scatter_by = "unit"',
            "parameters.damping.scatter_by: there is no condition 'unit'; there are none",
        ),
        (
            "[signals]\nspeed",
            '[signals]\n"my speed"',
            "signals.my speed is no name: use letters, digits and _",
        ),
        (
            "[signals]\nspeed = {}",
            '[signals]\nvoltage = { variable = "speed" }',
            "two quantities are called 'voltage'",
        ),
        ("[signals]\nspeed = {}", '[fixed]\ndrag = "big"', "fixed.drag: 'big' is no value of type Real"),
        (
            "[signals]\nspeed = {}",
            "[fixed]\ndamping = 0.1",
            "fixed.damping: 'damping' is set by damping already",
        ),
    ],
)
def test_a_mistake_in_the_file(folder: Path, old: str, new: str, words: str) -> None:
    assert old in TOML
    path = folder / "axis.toml"
    path.write_text(TOML.replace(old, new, 1), "utf-8")
    assert words in sentence(path)
    assert sentence(path).startswith(str(path))


def changed(tmp_path: Path, old: str, new: str, *, version: int = 2) -> str:
    """Return what is wrong with a unit whose model description is changed."""
    path = unit_folder(tmp_path, version=version)
    description = (HERE / f"axis_fmi{version}.xml").read_text("utf-8")
    assert old in description
    with zipfile.ZipFile(tmp_path / "axis.fmu") as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    files["modelDescription.xml"] = description.replace(old, new).encode()
    with zipfile.ZipFile(tmp_path / "axis.fmu", "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return sentence(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('fmiVersion="2.0"', 'fmiVersion="1.0"', "is a unit of FMI 1.0: export it as FMI 2 or 3"),
        ('fmiVersion="2.0"', 'fmiVersion="7.0"', "is a unit of FMI 7.0: export it as FMI 2 or 3"),
        ("<CoSimulation", "<ModelExchange", "is a unit for model exchange only"),
        ("<fmiModelDescription", "<fmiModelDescription <", "the model description of"),
        ('modelIdentifier="axis"', 'modelIdentifier="axes"', "has no library for this kind of machine"),
    ],
)
def test_a_unit_that_cannot_be_used(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert words in changed(tmp_path, old, new)


def test_an_array_is_refused(tmp_path: Path) -> None:
    old = ' unit="N.m.s/rad" start="0.02"/>'
    new = ' unit="N.m.s/rad" start="0.02 0.02"><Dimension start="2"/></Float64>'
    assert "parameters.damping: 'damping' is an array" in changed(tmp_path, old, new, version=3)


def test_a_unit_for_another_machine_is_refused_with_what_it_has(tmp_path: Path) -> None:
    path = unit_folder(tmp_path)
    with zipfile.ZipFile(tmp_path / "axis.fmu", "w") as archive:
        archive.write(HERE / "axis_fmi2.xml", "modelDescription.xml")
        archive.writestr("binaries/win64/axis.dll", b"")
    assert "it has win64: export it for linux64" in sentence(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "there is no such file"),
        (b"no archive", "is no functional mock-up unit"),
        (b"", "is no functional mock-up unit"),
    ],
)
def test_a_file_that_is_no_unit(tmp_path: Path, content: bytes | None, words: str) -> None:
    (tmp_path / "axis.toml").write_text(TOML, "utf-8")
    if content is not None:
        (tmp_path / "axis.fmu").write_bytes(content)
    assert words in sentence(tmp_path / "axis.toml")


def test_an_archive_without_a_description_is_no_unit(tmp_path: Path) -> None:
    (tmp_path / "axis.toml").write_text(TOML, "utf-8")
    with zipfile.ZipFile(tmp_path / "axis.fmu", "w") as archive:
        archive.writestr("readme.txt", "hello")
    assert "it has no modelDescription.xml" in sentence(tmp_path / "axis.toml")


def test_a_file_outside_of_the_folder_is_not_written(tmp_path: Path) -> None:
    path = unit_folder(tmp_path)
    with zipfile.ZipFile(tmp_path / "axis.fmu", "a") as archive:
        archive.writestr("../../escaped-from-unit", "hello")
    model = read_unit_model(path)
    assert not (Path(model.workers.unit.place.folder).parents[1] / "escaped-from-unit").exists()
    model.workers.close()


def test_the_result_of_an_analysis_is_no_file_of_a_unit(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text('base = "axis.toml"\n', "utf-8")
    assert "is the result of an analysis: give it with --model" in sentence(tmp_path / "model.toml")


def test_without_fmpy_the_extra_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    assert sentence(folder / "axis.toml").endswith("install rover-hil[fmi]")


def test_the_example_reports_what_is_wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert main([]).startswith("usage: ")
    assert main([str(tmp_path / "axis.fmu")]) == ""
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "there is no C compiler" in main([str(tmp_path / "axis.fmu")])


def test_a_unit_that_unpacks_to_gigabytes_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limits of docs/reference/file_limits.md, here smaller ones: zeros pack to a thousandth."""

    def size_of(content: int, description: int = 100, files: int = 1) -> str:
        path = tmp_path / "bomb.fmu"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", b"x" * description)
            for number in range(files):
                archive.writestr(f"resources/{number}", bytes(content))
        with pytest.raises(ConfigError) as caught:
            open_unit(path)
        return str(caught.value)

    monkeypatch.setattr(unit, "UNIT_BYTES_FREE", 100_000)
    assert "3000100 bytes unpacked" in size_of(3_000_000)
    # Within the free part; refused only as it is no unit.
    assert "of FMI without a version" in size_of(90_000)
    monkeypatch.setattr(unit, "UNIT_DESCRIPTION_BYTES", 50)
    assert "100 bytes of modelDescription.xml, 50 are allowed" in size_of(10)
    monkeypatch.setattr(unit, "UNIT_FILES", 20)
    assert "31 files, 20 are allowed" in size_of(1, files=30)
