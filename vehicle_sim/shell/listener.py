"""The console commands `listener` and `uorb`, for the topics that the simulator can log."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from vehicle_sim.shell.console import Arguments, Command, CommandFailed, Output, Usage
from vehicle_sim.topics.arrays import ARRAY_TOPICS, ArrayTopic, current_values
from vehicle_sim.topics.layout import Field, TopicLayout
from vehicle_sim.topics.states import States, StateTopic
from vehicle_sim.vehicle_view import VehicleView

PROFILES = 0b11
"""Logging profiles (default and replay) whose periods count as the periods of publication."""
GPS_PERIOD_US = 125_000
STEP_US = 4_000
"""Period of topics that no profile logs."""
MAX_SAMPLES = 10_000


@dataclass(frozen=True, slots=True)
class _Sample:
    """A topic's newest sample."""

    layout: TopicLayout
    period_us: int
    values: Mapping[str, Any]
    time_us: int


class ListenerCommand:
    """The command `listener TOPIC [NUMBER] [-n NUMBER] [-r RATE] [-i INSTANCE]`."""

    usage = "TOPIC [-n NUMBER] [-r HZ] [-i INSTANCE]"

    def __init__(self, view: VehicleView, states: States) -> None:
        self._view = view
        self._arrays = {topic.layout.name: topic for topic in ARRAY_TOPICS}
        self._states = {topic.layout.name: topic for topic in states.topics}
        self.command = Command(self.run, self.usage)
        self.uorb = Command(self.run_uorb, "status | top")

    def run(self, arguments: Arguments) -> Output:
        """Runs `listener …`."""
        if not arguments:
            raise Usage
        name, rest = arguments[0], arguments[1:]
        number, hz, instance = 1, 0.0, 0
        if rest and not rest[0].startswith("-"):
            rest = ["-n", *rest]
        if len(rest) % 2:
            raise Usage(f"{rest[-1]} needs a value")
        for option, text in zip(rest[::2], rest[1::2], strict=True):
            try:
                if option == "-n":
                    number = int(text)
                elif option == "-r":
                    hz = float(text)
                elif option == "-i":
                    instance = int(text)
                else:
                    raise Usage(f"unknown: {option}")
            except ValueError:
                raise Usage(f"{option} {text} is not a number") from None
        if not (1 <= number <= MAX_SAMPLES and 0.0 <= hz < math.inf):
            raise Usage(f"-n takes 1 to {MAX_SAMPLES}, -r a rate")
        if name not in self._arrays and name not in self._states:
            raise CommandFailed(f"Topic {name} did not match any known topics\n")
        if instance:
            raise CommandFailed("never published\n")
        if number == 1:
            return f"\nTOPIC: {name}\n{self._show(name)}\n"
        return self._repeat(name, number, hz)

    def _repeat(self, name: str, number: int, hz: float) -> Iterator[tuple[str, float]]:
        wait_s = 1.0 / hz if hz else self._sample(name).period_us / 1e6
        for n in range(number):
            yield f"\nTOPIC: {name} {n + 1}/{number}\n{self._show(name)}\n", wait_s if n + 1 < number else 0.0

    def _sample(self, name: str) -> _Sample:
        now_us = self._view.time_boot_us()
        array: ArrayTopic | None = self._arrays.get(name)
        if array is not None:
            period = array.period(PROFILES)
            period_us = period * 1000 if isinstance(period, int) else GPS_PERIOD_US if period else STEP_US
            values = current_values(array, self._view.simulation, self._view.row)
            time_us = now_us // period_us * period_us
            if array.sampled:
                values["timestamp_sample"] = time_us
            return _Sample(array.layout, period_us, values, time_us)
        state: StateTopic = self._states[name]
        period_us = (state.every_ms or 1000) * 1000
        return _Sample(state.layout, period_us, state.read(), now_us // period_us * period_us)

    def _show(self, name: str) -> str:
        sample = self._sample(name)
        age_s = (self._view.time_boot_us() - sample.time_us) / 1e6
        out = [f" {name}\n    timestamp: {sample.time_us} ({age_s:.6f} seconds ago)\n"]
        for field in sample.layout.fields:
            if field.name == "timestamp":
                continue
            text = _text(field, sample.values.get(field.name, 0))
            if field.name == "timestamp_sample":
                text += f" ({sample.time_us - int(sample.values.get(field.name, 0))} us before timestamp)"
            out.append(f"    {field.name}: {text}\n")
        return "".join(out)

    def run_uorb(self, arguments: Arguments) -> str:
        """Runs `uorb status` or `uorb top`: lists the topics with their rates and sizes."""
        if arguments[:1] not in (["status"], ["top"]):
            raise Usage
        out = [f"{'TOPIC NAME':<38}INST  RATE SIZE\n"]
        for name in sorted((*self._arrays, *self._states)):
            sample = self._sample(name)
            size = sample.layout.dtype.itemsize - 5
            out.append(f"{name:<38}{0:>4} {1e6 / sample.period_us:>5.0f} {size:>4}\n")
        return "".join(out)


def _text(field: Field, value: Any) -> str:
    if field.length:
        items = value if isinstance(value, list | tuple) else [value] * field.length
        return "[" + ", ".join(_scalar(field.type, each) for each in items) + "]"
    return _scalar(field.type, value)


def _scalar(kind: str, value: Any) -> str:
    if kind == "bool":
        return str(bool(value))
    if kind == "float":
        return f"{float(value):.5f}"
    if kind == "double":
        return f"{float(value):.6f}"
    return str(int(value))
