"""A scenario: what is flown, in which conditions, and what must hold; errors in its YAML file name the line.

    format: offboard-gcs-scenario
    version: 1
    name: Figure-eight in wind
    mission: ../figure_eight.yaml
    matrix:
      winds: {calm: {}, west: {wind_ned_m_s: [0, 6, 0], gusts_m_s: 1}}
      faults:
        none: []
        gps lost: [{when: airborne, after_s: 30, gps: lost}]
      px4: ["1.16", "1.17"]
    must_hold:
      - {check: finishes, in_faults: [none]}
      - {check: stays_within, radius_m: 90}

A scenario is flown once in each combination of its matrix.
"""

from __future__ import annotations

import difflib
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import yaml
from pydantic import BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from gcs_server.scenarios.checks import AnyCheck, Energy, PythonCheck, function_of
from missions.dry_run.setup import WIND_MAX_M_S
from missions.errors import PlanError
from missions.formats import any_format
from missions.offboard.document import OffboardMission
from missions.plan import Plan
from missions.values import DisplayText, HomePosition, Model, Number
from vehicle_sim.parameters import Parameters, UnknownParameterError
from vehicle_sim.px4_version import VERSIONS
from vehicle_sim.script import Event, event_from_fields
from vehicle_sim.state import SimulationOrigin
from vehicle_sim.world.files import load_world
from vehicle_sim.world.world import World
from vehicle_sim.yaml_fields import Fields, FileProblem, parse_yaml, read_yaml

T = TypeVar("T", bound=Model)
VEHICLE = "vehicle"
"""Name of the only vehicle of a flight."""
FORMAT = "offboard-gcs-scenario"
MAX_FLIGHTS = 2000
MAX_SCENARIO_FILES = 500
SUFFIXES = (".yaml", ".yml")
Name = Annotated[DisplayText, Field(min_length=1, max_length=80)]
WindSpeed = Annotated[float, Field(ge=-WIND_MAX_M_S, le=WIND_MAX_M_S)]


class _Part(Model):
    model_config = ConfigDict(use_attribute_docstrings=True)


class Wind(_Part):
    """Wind of one flight."""

    wind_ned_m_s: tuple[WindSpeed, WindSpeed, WindSpeed] = (0.0, 0.0, 0.0)
    """Velocity of the air [m/s]: where the wind blows to."""
    gusts_m_s: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0
    """Standard deviation of the gusts on each horizontal axis [m/s]."""


def _version_name(value: Any) -> Any:
    """YAML reads an unquoted 1.17 as a number."""
    return f"{value:.2f}" if isinstance(value, float) else value


Version = Annotated[Literal["1.16", "1.17"], BeforeValidator(_version_name)]


class Matrix(_Part):
    """Conditions that are combined: one flight for each combination."""

    winds: Annotated[dict[Name, Wind], Field(min_length=1, max_length=50)] = Field(
        default_factory=lambda: {"calm": Wind()}
    )
    """Winds by name."""
    faults: Annotated[dict[Name, tuple[dict[str, Any], ...]], Field(min_length=1, max_length=50)] = Field(
        default_factory=lambda: dict[str, tuple[dict[str, Any], ...]](none=())
    )
    """Faults by name: events of a fault script (docs/how-to-write-a-fault-script.md)."""
    px4: Annotated[tuple[Version, ...], Field(min_length=1)] = ("1.17",)
    """Versions of PX4."""
    seeds: Annotated[tuple[Annotated[int, Field(ge=0, le=2**31)], ...], Field(min_length=1)] = (1,)
    """Seeds of sensor noise and gusts: the same seed gives the same flight."""


class Battery(_Part):
    """The battery at the start."""

    charge_percent: Annotated[float, Field(ge=1.0, le=100.0)] = 100.0
    """Charge [%]."""
    endurance_s: Annotated[float, Field(ge=10.0, le=100_000.0)] | None = None
    """Hover time from full to empty [s]; absent: as SIM_BAT_DRAIN says."""


_HOME = SimulationOrigin()


class ScenarioDocument(_Part):
    """A scenario file of version 1."""

    model_config = ConfigDict(title="Scenario")

    format: Literal["offboard-gcs-scenario"]
    version: Literal[1]
    name: Name
    """Shown in reports."""
    plan: str | None = None
    """A waypoint plan (this project's JSON, or a .plan of QGroundControl), beside this file."""
    mission: str | None = None
    """An offboard mission (YAML or JSON), beside this file."""
    python: Annotated[str, Field(pattern=r"^[^:]+\.py:[A-Za-z_]\w*$")] | None = None
    """`file.py:function`, beside this file: a coroutine that flies with the Python client. Its parameters are
    any of `vehicle`, `vehicles`, `gcs`, `station`, `clock`."""
    run: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    """A program of any language with its arguments, started in this file's folder. In the arguments are
    replaced: {port}, where the program hears the vehicle (as 14540); {vehicle_port}, to which it sends
    instead; {tcp_port} (as 5760); {url} of the server; {ros2_domain}."""
    speed: Annotated[float, Field(ge=0.1, le=20.0)] = 1.0
    """Simulated seconds in a real second, for `run`."""
    guard: bool = False
    """Whether the program of `run` flies through a guarded link instead of the vehicle's own port."""
    vehicles: Annotated[int, Field(ge=1, le=20)] = 1
    """Number of vehicles, for `python` and `run`; their names are 1, 2 … if there are several."""
    home: HomePosition = HomePosition(
        lat_deg=_HOME.lat_deg, lon_deg=_HOME.lon_deg, alt_amsl_m=_HOME.alt_amsl_m
    )
    """Where the first vehicle starts; all positions of the checks are from here."""
    yaw_ned_rad: Number = 0.0
    """Heading at the start [rad]."""
    starts_ne_m: dict[str, tuple[Number, Number]] = Field(default_factory=dict[str, tuple[Number, Number]])
    """North and east of the start of a mission's role from `home` [m]; default: its `start_ned_m`, or else a
    row to the east, 3 m apart."""
    world: str | None = None
    """A world of the simulator by name, or its file beside this one; absent: level ground, and the obstacles
    of the plan or mission."""
    parameters: dict[str, Number] = Field(default_factory=dict[str, Number])
    """PX4's parameters, set before boot."""
    battery: Battery = Battery()
    """The battery at the start."""
    time_limit_s: Annotated[float, Field(ge=1.0, le=3600.0)] | None = None
    """A flight that takes longer fails [s]; absent: twice the estimated time and 90 s."""
    matrix: Matrix | str = Matrix()
    """Conditions, or a file beside this one that contains them."""
    must_hold: Annotated[tuple[AnyCheck, ...], Field(min_length=1)]
    """What must hold in each flight."""

    @model_validator(mode="after")
    def _has_one_program(self) -> ScenarioDocument:
        programs = [name for name in PROGRAMS if getattr(self, name) is not None]
        if len(programs) != 1:
            given = " and ".join(programs) or "none"
            raise ValueError(f"needs one of {', '.join(PROGRAMS)}; it has {given}")
        return self


PROGRAMS = ("plan", "mission", "python", "run")
"""The kinds of programs, one of which a scenario has."""


def schema() -> dict[str, Any]:
    """The JSON Schema of a scenario file."""
    return ScenarioDocument.model_json_schema()


@dataclass(frozen=True, slots=True)
class Cell:
    """The conditions of one flight."""

    wind: str
    faults: str
    px4: str
    seed: int

    @property
    def text(self) -> str:
        """As in reports and file names."""
        return f"wind={self.wind}, faults={self.faults}, px4={self.px4}, seed={self.seed}"


@dataclass(frozen=True, slots=True)
class PythonProgram:
    """A coroutine that flies with the Python client, on simulated time."""

    file: Path
    function: str


@dataclass(frozen=True, slots=True)
class RunProgram:
    """A program in a process of its own, on paced time."""

    arguments: tuple[str, ...]
    folder: Path
    speed: float
    guard: bool

    @property
    def uses_server(self) -> bool:
        """Whether it flies through the server; otherwise the vehicle hears no ground station."""
        return self.guard or any("{url}" in each for each in self.arguments)


Program = Plan | OffboardMission | PythonProgram | RunProgram


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scenario that was read and checked, with the files that it names."""

    path: Path
    document: ScenarioDocument
    matrix: Matrix
    events: Mapping[str, tuple[Event, ...]]
    """The faults' events, by name."""
    program: Program
    world: World | None
    checks: tuple[AnyCheck, ...]

    @property
    def cells(self) -> list[Cell]:
        """The conditions of all flights."""
        matrix = self.matrix
        combined = itertools.product(matrix.winds, matrix.faults, matrix.px4, matrix.seeds)
        return [Cell(*each) for each in combined]

    def with_vehicles(self, count: int) -> Scenario:
        """The same scenario with another number of vehicles."""
        return replace(self, document=self.document.model_copy(update={"vehicles": count}))

    @property
    def vehicle_names(self) -> tuple[str, ...]:
        """Names of the vehicles of a flight: the mission's roles."""
        if isinstance(self.program, OffboardMission):
            return tuple(self.program.roles) or (VEHICLE,)
        count = self.document.vehicles
        return (VEHICLE,) if count == 1 else tuple(str(number + 1) for number in range(count))


def find(paths: Sequence[Path]) -> list[Path]:
    """The scenario files below folders, and the files themselves; in order of their names.

    Raises:
        FileProblem: there is none, or there are too many.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = sorted(path.rglob("*"))
            files += [each for each in found if is_scenario(each)]
        else:
            files.append(path)
    if not files:
        names = ", ".join(map(str, paths))
        raise FileProblem(f"{names}: no scenario here; a scenario begins with `format: {FORMAT}`")
    if len(files) > MAX_SCENARIO_FILES:
        raise FileProblem(f"{len(files)} scenarios; give folders with at most {MAX_SCENARIO_FILES}")
    return list(dict.fromkeys(files))


def is_scenario(path: Path) -> bool:
    """Whether a file says that it is a scenario."""
    try:
        return path.suffix in SUFFIXES and f"format: {FORMAT}" in path.read_text("utf-8", "replace")
    except OSError:
        return False


def load(path: Path) -> Scenario:
    """Reads a scenario and the files that it names.

    Raises:
        FileProblem: a file is invalid; the text names file, line, field and fix.
    """
    return _from_fields(read_yaml(path), path)


def from_value(value: Mapping[str, Any], path: Path) -> Scenario:
    """A scenario of plain values; files that it names are beside `path`, which errors name.

    Raises:
        FileProblem: a value is invalid.
    """
    return _from_fields(parse_yaml(yaml.safe_dump(_plain(value)), str(path)), path)


def _plain(value: Any) -> Any:
    """Values that YAML can write: lists instead of tuples."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def _from_fields(fields: Fields, path: Path) -> Scenario:
    document = _validated(ScenarioDocument, fields)
    matrix, matrix_fields = document.matrix, fields.mapping("matrix") if _is_inline(document) else None
    if isinstance(matrix, str):
        matrix_fields = read_yaml(path.parent / matrix)
        matrix = _validated(Matrix, matrix_fields)
    scenario = Scenario(
        path,
        document,
        matrix,
        _events(matrix, matrix_fields),
        _program(path, document, fields),
        None if document.world is None else _world(path, document.world),
        tuple(_beside(each, path.parent) for each in document.must_hold),
    )
    _check(scenario, fields)
    return scenario


def _is_inline(document: ScenarioDocument) -> bool:
    return "matrix" in document.model_fields_set and not isinstance(document.matrix, str)


def _validated(kind: type[T], fields: Fields) -> T:
    """The fields as a document.

    Raises:
        FileProblem: a field is missing, unknown or invalid.
    """
    value = fields.value()
    try:
        return kind.model_validate_json(json.dumps(value, default=str))
    except ValidationError as error:
        errors: list[dict[str, Any]] = [*map(dict, error.errors(include_url=False, include_input=False))]
        # A wrong name of a required field is two errors; the wrong name says more.
        first = next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])
        path = _path_in_file(first["loc"], value)
        message = str(first["msg"]).removeprefix("Value error, ").rstrip(".")[:300]
        raise fields.problem_at(path, f"{message}{_advice(first, path, kind)}") from None


def _path_in_file(location: Sequence[str | int], value: Any) -> list[str | int]:
    """The path in the file; Pydantic's location also contains the kinds of union members."""
    path: list[str | int] = []
    for part in location:
        is_key = isinstance(value, dict) and (part in value or part == location[-1])
        is_index = isinstance(value, list) and isinstance(part, int)
        if is_key or is_index:
            path.append(part)
            value = value.get(part) if isinstance(value, dict) else value[int(part)]
    return path


def _advice(error: Mapping[str, Any], path: Sequence[str | int], kind: type[Model]) -> str:
    """How to correct an error."""
    if error["type"] != "extra_forbidden" or not path:
        return "; add it" if error["type"] == "missing" else ""
    known = [*kind.model_fields] if len(path) == 1 else []
    similar = difflib.get_close_matches(str(path[-1]), known, 1)
    return f"; did you mean {similar[0]}?" if similar else "; remove it, or correct its name"


def _events(matrix: Matrix, fields: Fields | None) -> dict[str, tuple[Event, ...]]:
    """The events of all faults."""
    faults = None if fields is None else fields.mapping("faults")
    if faults is None:
        return {name: () for name in matrix.faults}
    return {name: tuple(event_from_fields(each) for each in faults.items(name)) for name in matrix.faults}


def _program(path: Path, document: ScenarioDocument, fields: Fields) -> Program:
    if document.python is not None:
        file, _, function = document.python.rpartition(":")
        _require_function(fields, ("python",), path.parent / file, function)
        return PythonProgram(path.parent / file, function)
    if document.run is not None:
        if document.guard and document.vehicles > 1:
            raise fields.problem_at(("guard",), "a guarded link has one vehicle; give vehicles: 1")
        return RunProgram(document.run, path.parent, document.speed, document.guard)
    key = "mission" if document.mission else "plan"
    name = str(document.mission or document.plan)
    try:
        data = (path.parent / name).read_bytes()
        program = any_format.read(any_format.recognise(data, name), data).plan
    except OSError as error:
        raise fields.problem(key, f"names {name}: {error.strerror}; name a file beside this one") from None
    except PlanError as error:
        raise FileProblem(f"{path.parent / name}: {error}") from None
    found = "mission" if isinstance(program, OffboardMission) else "plan"
    if found != key:
        raise fields.problem(key, f"names {name}, which is a {found}; write `{found}: {name}`")
    return program


def _world(path: Path, name: str) -> World:
    beside = path.parent / name
    return load_world(str(beside) if beside.is_file() else name)


def _beside(check: AnyCheck, folder: Path) -> AnyCheck:
    """A Python check with the path of its file."""
    if not isinstance(check, PythonCheck):
        return check
    return check.model_copy(update={"function": str(folder / check.function)})


def _check(scenario: Scenario, fields: Fields) -> None:
    """Checks what one field says of another.

    Raises:
        FileProblem: a name is not known.
    """
    document, names = scenario.document, scenario.vehicle_names
    _require_known(fields, ("starts_ne_m",), document.starts_ne_m, names, "vehicles")
    for index, check in enumerate(scenario.checks):
        place = ("must_hold", index)
        _require_known(fields, (*place, "in_faults"), check.in_faults or (), scenario.matrix.faults, "faults")
        vehicles = () if check.vehicle is None else (check.vehicle,)
        _require_known(fields, (*place, "vehicle"), vehicles, names, "vehicles")
        if isinstance(check, PythonCheck):
            file, _, function = check.function.rpartition(":")
            _require_function(fields, (*place, "function"), Path(file), function)
    drains = document.battery.endurance_s is not None or "SIM_BAT_DRAIN" in document.parameters
    if not drains and any(isinstance(check, Energy) for check in scenario.checks):
        raise fields.problem_at(
            ("must_hold",), "checks the energy, but nothing says how long a battery lasts; give "
            "battery: {endurance_s: …}, because PX4's own simulation drains to 50 % in a minute"
        )  # fmt: skip
    for px4 in scenario.matrix.px4:
        _require_parameters(fields, document.parameters, px4)
    count = len(scenario.cells)
    if count > MAX_FLIGHTS:
        raise fields.problem_at(("matrix",), f"gives {count} flights; at most {MAX_FLIGHTS} are flown")


def _require_known(fields: Fields, path: Sequence[str | int], given: Any, known: Any, noun: str) -> None:
    for name in given:
        if name not in known:
            raise fields.problem_at(path, f"names {name!r}; the {noun} are {', '.join(known)}")


def _require_function(fields: Fields, path: Sequence[str | int], file: Path, name: str) -> None:
    try:
        function_of(file, name)
    except ValueError as error:
        raise fields.problem_at(path, f"cannot be used: {error}") from None


def _require_parameters(fields: Fields, parameters: Mapping[str, float], px4: str) -> None:
    store = Parameters(px4=VERSIONS[px4])
    for name, value in parameters.items():
        try:
            store.set(name, _typed(store, name, value))
        except (UnknownParameterError, ValueError) as error:
            raise fields.problem_at(("parameters", name), f"cannot be set: {error}") from None


def _typed(store: Parameters, name: str, value: float) -> float | int:
    is_whole = name in store and store.type_of(name) == "INT32" and float(value).is_integer()
    return int(value) if is_whole else value


def for_rows(events: Sequence[Event], first_row: int, count: int) -> list[Event]:
    """Events of a scenario's vehicles (numbered from 1) as those of rows of a larger simulation, where a
    vehicle has the id row + 1."""
    numbers = tuple(range(1, count + 1))
    return [
        replace(each, vehicles=tuple(first_row + n for n in (each.vehicles or numbers) if n in numbers))
        for each in events
    ]
