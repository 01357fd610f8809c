"""Set-up of a gimbal: parameters, outputs, the state of PX4's gimbal module, and what is missing.

PX4 reads MNT_MODE_IN and MNT_MODE_OUT when its gimbal module starts, at boot or by `gimbal start` on its
console; at boot it starts the module unless MNT_MODE_IN is -1. Its state is taken from what the vehicle
sends: the gimbal manager's status needs an input by MAVLink, the attitude of the device only the module.
Without either, the console's `gimbal status` tells.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, TypeVar

from gcs_server.errors import GcsError, NoReply, NotYet
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.actuator_document import Output, output_name
from gcs_server.vehicle.param_review import label_of
from gcs_server.vehicle.param_table import Param
from gcs_server.vehicle.px4 import gimbal_parameters as px4
from gcs_server.vehicle.samples import Motors, OutputGroup, Sample
from gcs_server.vehicle.services.metadata import MetadataService
from gcs_server.vehicle.services.param_changes import ConfigurableVehicle, ParamChanges
from gcs_server.vehicle.services.shell import ShellService

REPORTED_WITHIN_S = 5.0
"""PX4 sends the manager's status every 2 s on a ground station's link [s]."""
CONSOLE_WAIT_S = 3.0
CONSOLE_TRIES = 4
OUTPUT_PORTS = {"MAIN": 0, "AUX": 1}
"""SERVO_OUTPUT_RAW.port by the name of a group of outputs."""
STATUS_ID = d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS
DEVICE_IDS = (d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS, d.MAVLINK_MSG_ID_MOUNT_ORIENTATION)

S = TypeVar("S")
ModuleState = Literal["input_mavlink", "input_none", "not_running", "unknown"]
MODULE_TEXTS: dict[ModuleState, str] = {
    "input_mavlink": "Running. Input: MAVLink.",
    "input_none": "Running, but Input: none. It takes no commands by MAVLink.",
    "not_running": "Not running.",
    "unknown": "The vehicle reports no gimbal: its module does not run, or has no input.",
}


class GimbalVehicle(ConfigurableVehicle, Protocol):
    """A vehicle with parameters, metadata and other services."""

    @property
    def metadata(self) -> MetadataService: ...
    def service(self, kind: type[S]) -> S: ...


@dataclass(frozen=True, slots=True)
class GimbalOutput:
    """One output of the vehicle, and its function."""

    name: str
    """As printed on boards, such as MAIN 7."""
    label: str
    """Group and channel in the vehicle's metadata."""
    function_param: str
    """Parameter of the function."""
    function: int
    function_label: str | None
    """Name of the function in the vehicle's metadata."""
    axis: Literal["roll", "pitch", "yaw"] | None
    """Axis of the gimbal that it drives; null: none."""
    reverse_param: str | None
    """Parameter with one bit for each reversed output; null: the output cannot be reversed."""
    reverse_bit: int
    """Bit of this output in `reverse_param`."""
    reversed: bool | None
    """Whether the output's direction is reversed; null: it cannot be."""
    pwm_us: int | None
    """Newest pulse [µs]; null: the vehicle reports none for this output."""


@dataclass(frozen=True, slots=True)
class SetupChange:
    """A parameter and the value that mends a finding."""

    name: str
    value: int


@dataclass(frozen=True, slots=True)
class SetupFinding:
    """Something that keeps the gimbal from working, and what mends it."""

    code: Literal["input_none", "not_started", "no_outputs", "prearm_off"]
    text: str
    """What is missing, and what it causes."""
    changes: tuple[SetupChange, ...]
    """Parameters that mend it; empty: a person must choose."""
    restarts: bool
    """Whether the gimbal module must be started again afterwards."""


@dataclass(frozen=True, slots=True)
class GimbalModule:
    """State of PX4's gimbal module."""

    state: ModuleState
    text: str
    console: str | None
    """Newest output of `gimbal status` on the vehicle's console; null: not asked."""


@dataclass(frozen=True, slots=True)
class GimbalSetup:
    """Everything that a gimbal's set-up needs."""

    settings: tuple[str, ...]
    """Names of the vehicle's parameters of the set-up, in the order in which a person sets them."""
    reverse_params: tuple[str, ...]
    """Names of the parameters that reverse outputs."""
    outputs: tuple[GimbalOutput, ...]
    outputs_problem: str | None
    """Why the outputs are not those of the vehicle's metadata; null: they are."""
    functions: dict[str, int]
    """Function of an output for each axis."""
    module: GimbalModule
    findings: tuple[SetupFinding, ...]
    waiting: tuple[str, ...]
    """Changed parameters that take effect only after a restart."""


class GimbalSetupService:
    """Set-up of the gimbals of one vehicle."""

    def __init__(self, vehicle: GimbalVehicle) -> None:
        self._vehicle = vehicle
        self._console: str | None = None
        self._console_state: ModuleState = "unknown"
        self._since_s = float("-inf")
        """Messages before this time are of an earlier run of the module [s, monotonic]."""
        self._read_outputs: tuple[str | None, tuple[Output, ...]] | None = None
        """Version of the firmware, and its outputs; None: not read from the vehicle's files."""

    async def read(self) -> GimbalSetup:
        """The set-up. Outputs are read from the vehicle's files, once for each firmware.

        Raises:
            NotYet: the parameters have not been read.
        """
        vehicle = self._vehicle
        await vehicle.params.describe()
        outputs, problem = await self._outputs()
        names = [*px4.SETTINGS, *(o.function_param for o in outputs), *_reverse_params(outputs)]
        values = await self._values(names)
        described = [self._described(each, values) for each in outputs if each.function_param in values]
        module = self.module()
        return GimbalSetup(
            settings=tuple(name for name in px4.SETTINGS if name in values),
            reverse_params=tuple(name for name in _reverse_params(outputs) if name in values),
            outputs=tuple(described),
            outputs_problem=problem,
            functions=dict(px4.FUNCTIONS),
            module=module,
            findings=findings(values, described, module.state),
            waiting=vehicle.service(ParamChanges).waiting(),
        )

    def module(self) -> GimbalModule:
        """State of the module: what the vehicle sends, or else what its console said."""
        state = self._reported() or self._console_state
        return GimbalModule(state, MODULE_TEXTS[state], self._console)

    async def ask(self) -> GimbalModule:
        """Asks the vehicle's console for `gimbal status`.

        Raises:
            Refused: the vehicle is armed, or its links carry no console.
            NoReply: no answer.
        """
        output, complete = await self._run("gimbal status")
        if not complete:
            raise NoReply(
                f"The console of vehicle {self._vehicle.id} did not end its answer to “gimbal status”.",
                deadline_s=CONSOLE_WAIT_S,
                remedy="Ask again; on a lossy link output may be missing.",
            )
        self._console = output.removeprefix("gimbal status\n").rsplit("\n", 1)[0]
        self._console_state = state_in(output)
        return self.module()

    async def start(self) -> GimbalModule:
        """Starts the gimbal module; one that runs is stopped first, so that it reads its parameters again.

        Raises:
            Refused: the vehicle is armed, or its links carry no console.
            NoReply: no answer.
        """
        await self.ask()
        if self._console_state != "not_running":
            await self._run("gimbal stop")
        await self._run("gimbal start")
        self._since_s = self._vehicle.clock.monotonic_s()
        self._vehicle.service(ParamChanges).took_effect(px4.MODULE_PREFIX)
        return await self.ask()

    # --- internal -------------------------------------------------------------------------------------

    async def _run(self, line: str) -> tuple[str, bool]:
        """Runs a line about the module, again if the link lost its echo: twice, none of them does harm."""
        shell = self._vehicle.service(ShellService)
        for _ in range(CONSOLE_TRIES - 1):
            with contextlib.suppress(NoReply):
                return await shell.run(line, wait_s=CONSOLE_WAIT_S)
        return await shell.run(line, wait_s=CONSOLE_WAIT_S)

    def _reported(self) -> ModuleState | None:
        if self._is_recent(STATUS_ID):
            return "input_mavlink"
        if self._vehicle.clock.monotonic_s() - self._since_s < REPORTED_WITHIN_S:
            return None  # the module has just started; its status comes less often than its attitude
        return "input_none" if any(self._is_recent(msg_id) for msg_id in DEVICE_IDS) else None

    def _is_recent(self, msg_id: int) -> bool:
        vehicle = self._vehicle
        newest = vehicle.newest_payload(msg_id, vehicle.identity.component_id)
        oldest_s = max(self._since_s, vehicle.clock.monotonic_s() - REPORTED_WITHIN_S)
        return newest is not None and newest[1] > oldest_s

    async def _outputs(self) -> tuple[tuple[Output, ...], str | None]:
        firmware = self._vehicle.identity.firmware
        if self._read_outputs is not None and self._read_outputs[0] == firmware:
            return self._read_outputs[1], None
        try:
            document = await self._vehicle.metadata.outputs()
            if document:
                self._read_outputs = firmware, tuple(document.values())
                return self._read_outputs[1], document.omission_text
            problem = "The vehicle's metadata names no outputs."
        except GcsError as error:
            problem = str(error)
        found = [(param.name, output_name(param.name)) for param in self._vehicle.params.all()]
        outputs = [Output(name, name, param) for param, name in found if name is not None]
        if not outputs:
            problem += " Read the parameters to see the outputs."
        return tuple(sorted(outputs, key=lambda o: (o.name.split()[0], int(o.name.split()[1])))), problem

    async def _values(self, names: Sequence[str]) -> dict[str, Param]:
        params = self._vehicle.params
        if params.list.state != "ready":
            missing = [name for name in dict.fromkeys(names) if params.known(name) is None]
            if missing:
                raise NotYet(
                    f"The parameters of vehicle {self._vehicle.id} have not been read yet.",
                    remedy="Read them first (POST …/params/refresh).",
                )
        return {name: param for name in names if (param := params.known(name)) is not None}

    def _described(self, output: Output, values: Mapping[str, Param]) -> GimbalOutput:
        function = int(values[output.function_param].value)
        mask = None if output.reverse_param is None else values.get(output.reverse_param)
        return GimbalOutput(
            name=output.name,
            label=output.label,
            function_param=output.function_param,
            function=function,
            function_label=label_of(self._vehicle.params.metadata_of(output.function_param), function),
            axis=next((axis for axis, number in px4.FUNCTIONS.items() if number == function), None),  # pyright: ignore[reportArgumentType]
            reverse_param=None if mask is None else output.reverse_param,
            reverse_bit=output.reverse_bit,
            reversed=None if mask is None else bool(int(mask.value) >> output.reverse_bit & 1),
            pwm_us=_pulse(output.name, self._vehicle.topic("motors")),
        )


def _pulse(name: str, sample: Sample | None) -> int | None:
    """Pulse of the output with this name (MAIN 7, AUX 1)."""
    group_name, _, number = name.partition(" ")
    motors = sample.value if sample is not None else None
    if not isinstance(motors, Motors) or not number.isdecimal() or group_name not in OUTPUT_PORTS:
        return None
    groups = motors.groups or (OutputGroup(0, motors.pwm_us),)
    pulses = next((g.pwm_us for g in groups if g.port == OUTPUT_PORTS[group_name]), ())
    return pulses[int(number) - 1] if 0 < int(number) <= len(pulses) else None


def _reverse_params(outputs: Sequence[Output]) -> list[str]:
    return sorted({o.reverse_param for o in outputs if o.reverse_param is not None})


def state_in(output: str) -> ModuleState:
    """State of the module in the output of `gimbal status`.

    >>> state_in("WARN  [gimbal] not running")
    'not_running'
    """
    if "not running" in output:
        return "not_running"
    return "input_mavlink" if "Input: Mavlink" in output else "input_none"


def findings(
    values: Mapping[str, Param], outputs: Sequence[GimbalOutput], state: ModuleState
) -> tuple[SetupFinding, ...]:
    """What keeps the gimbal from working with these parameters, the most important first. Pure."""
    found: list[SetupFinding] = []
    mode_in = values.get(px4.INPUT)
    if mode_in is None:
        return ()
    if mode_in.value not in px4.MAVLINK_INPUTS:
        found.append(
            SetupFinding(
                "input_none",
                "Input: none. The gimbal takes no commands by MAVLink, from this page or from a program, "
                f"because {px4.INPUT} is {mode_in.value:g}.",
                (SetupChange(px4.INPUT, px4.MAVLINK_INPUT),),
                True,
            )
        )
    elif state != "input_mavlink":
        found.append(
            SetupFinding(
                "not_started",
                f"{px4.INPUT} is set, but the gimbal module has not started with it: PX4 reads it when the "
                "module starts, or at a restart of the vehicle.",
                (),
                True,
            )
        )
    mode_out = values.get(px4.OUTPUT)
    if mode_out is not None and mode_out.value == px4.SERVO_OUTPUT:
        if not any(output.axis is not None for output in outputs):
            found.append(
                SetupFinding(
                    "no_outputs",
                    "No output drives an axis of the gimbal: choose one for roll, pitch or yaw.",
                    (),
                    False,
                )
            )
        prearm = values.get(px4.PREARM)
        if prearm is not None and prearm.value != px4.PREARM_ALWAYS:
            found.append(
                SetupFinding(
                    "prearm_off",
                    f"The servos move only while the vehicle is armed, because {px4.PREARM} is "
                    f"{prearm.value:g}. With {px4.PREARM_ALWAYS} (always) they also move while it is "
                    "disarmed, as do all other outputs that are not motors.",
                    (SetupChange(px4.PREARM, px4.PREARM_ALWAYS),),
                    False,
                )
            )
    return tuple(found)
