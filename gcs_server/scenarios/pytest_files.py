"""Scenario files as tests of pytest: one for each flight."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_server.scenarios import report
from gcs_server.scenarios.results import FlightResult
from gcs_server.scenarios.run import Selected, fly
from gcs_server.scenarios.scenario import Cell, Scenario, is_scenario, load
from missions.errors import PlanError
from vehicle_sim.yaml_fields import FileProblem


class ScenarioFailed(Exception):
    """Something that must hold did not."""


class ScenarioFiles:
    """Collects scenario files, and writes their report.

    Args:
        folder: where the report is written; None: there is none.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self.results: list[FlightResult] = []

    def pytest_collect_file(self, file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
        """A scenario file is a collector of flights."""
        if not is_scenario(file_path):
            return None
        file: ScenarioFile = ScenarioFile.from_parent(parent, path=file_path)
        file.files = self
        return file

    def pytest_sessionfinish(self) -> None:
        """Writes the report of all flights."""
        if self._folder is not None and self.results:
            report.write(self.results, self._folder)


class ScenarioFile(pytest.File):
    """The flights of one scenario."""

    files: ScenarioFiles
    _scenario: Scenario
    _flown: dict[Cell, FlightResult]

    def collect(self) -> Iterator[ScenarioItem]:
        """One item for each combination of the matrix."""
        try:
            self._scenario = load(self.path)
        except FileProblem as problem:
            raise self.CollectError(str(problem)) from None
        self._flown = {}
        for cell in self._scenario.cells:
            item: ScenarioItem = ScenarioItem.from_parent(self, name=cell.text)
            item.cell = cell
            yield item

    def result(self, cell: Cell) -> FlightResult:
        """The result of a flight; the first one that is asked for flies all that are selected, because many
        flights in one simulation cost less."""
        if cell not in self._flown:
            selected = [each for each in self.session.items if isinstance(each, ScenarioItem)]
            # Each process of xdist runs only some of the items that it knows.
            one_by_one = hasattr(self.config, "workerinput")
            cells = (cell,) if one_by_one else tuple(each.cell for each in selected if each.parent is self)
            results = fly(Selected(self._scenario, cells))
            self.files.results += results
            self._flown |= {each.cell: each for each in results}
        return self._flown[cell]


class ScenarioItem(pytest.Item):
    """One flight."""

    cell: Cell

    def runtest(self) -> None:
        """Flies, and fails with what did not hold."""
        assert isinstance(self.parent, ScenarioFile)
        result = self.parent.result(self.cell)
        if not result.passed:
            raise ScenarioFailed("\n".join(report.failures(result)))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """What did not hold, without a traceback of this program."""
        if isinstance(excinfo.value, ScenarioFailed | PlanError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """How pytest names the flight."""
        return self.path, None, f"{self.path.name} [{self.name}]"
