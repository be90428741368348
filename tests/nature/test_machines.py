from pathlib import Path

import numpy as np
import pytest

from tests.nature import machines
from tests.nature.machines import FAMILIES, make_case
from tests.nature.machines.tables import family_tables

FOLDER = Path(machines.__file__).parent


@pytest.mark.parametrize("family", FAMILIES)
def test_the_readme_has_the_tables_of_the_code(family: str) -> None:
    assert family_tables(FAMILIES[family]) in (FOLDER / "README.md").read_text("utf-8")


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_number_gives_the_same_case(family: str) -> None:
    first, again, other = (make_case(family, number) for number in (3, 3, 4))
    for run, same in zip(first.runs, again.runs, strict=True):
        for name, values in run.measured.items():
            assert np.array_equal(values, same.measured[name])
    channel = FAMILIES[family].channels[0].name
    assert not np.array_equal(first.runs[0].measured[channel][:100], other.runs[0].measured[channel][:100])


def test_nothing_here_imports_the_product() -> None:
    for path in FOLDER.glob("*.py"):
        text = path.read_text("utf-8")
        assert "import rover_hil" not in text, path
        assert "from rover_hil" not in text, path
        assert "sim_backends" not in text, path
