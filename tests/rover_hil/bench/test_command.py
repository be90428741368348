"""The command `bench` before its page is served."""

import sys

import pytest

from tests.rover_hil.command import Command, assert_one_sentence


def test_without_the_library_of_the_page_it_says_what_to_install(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "rover_hil.bench.server", raising=False)
    monkeypatch.setitem(sys.modules, "nicegui", None)
    assert command("bench", "robotino") == 2
    assert_one_sentence(command.error, "the page needs NiceGUI", "rover-hil[bench]")
