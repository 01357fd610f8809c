"""`gcs serve --px4 VERSION` chooses the version of PX4 that the simulated vehicles are."""

from pathlib import Path

import pytest

from gcs_server import cli
from gcs_server.settings import Settings


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Settings]:
    settings: list[Settings] = []

    def serve(given: Settings, _: object) -> int:
        settings.append(given)
        return 0

    monkeypatch.setattr(cli, "serve", serve)
    return settings


def test_the_simulator_gets_the_version_before_its_other_arguments(
    started: list[Settings], tmp_path: Path
) -> None:
    arguments = ["--sim", "2", "--px4", "1.17", "--sim-args", "--speed 2", "--data", str(tmp_path)]
    assert cli.main(arguments) == 0
    assert started[0].sim_args == ("--px4", "1.17", "--speed", "2")
    assert started[0].sim == 2


def test_a_real_px4_has_its_own_version(
    started: list[Settings], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["--sim", "px4", "--px4", "1.17", "--data", str(tmp_path)]) != 0
    assert "A real PX4 has its own version" in capsys.readouterr().err
    assert started == []
