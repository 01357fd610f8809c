"""The console commands `listener` and `uorb`, which show the topics that the simulator can log."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from vehicle_sim.shell.console import Arguments, Command, CommandFailed, Output, UsageError
from vehicle_sim.topics.arrays import ArrayTopic, array_topics, current_values
from vehicle_sim.topics.layout import Field, TopicLayout
from vehicle_sim.topics.states import States, StateTopic
from vehicle_sim.vehicle_view import VehicleView

PROFILES = 0b11
"""Bits of the logging profiles `default` and `replay`; their periods are used as periods of publication."""
GPS_PERIOD_US = 125_000
STEP_US = 4_000
"""Period of topics that no profile logs."""
MAX_SAMPLES = 10_000
LOG_HEADER_BYTES = 5
"""Header of a data message in a log, which is not part of the topic."""


@dataclass(frozen=True, slots=True)
class _Sample:
    """A topic's newest sample."""

    layout: TopicLayout
    period_us: int
    values: Mapping[str, Any]
    time_us: int


class ListenerCommand:
    """The commands `listener TOPIC [NUMBER] [-n NUMBER] [-r HZ] [-i INSTANCE]` and `uorb status|top`."""

    usage = "TOPIC [-n NUMBER] [-r HZ] [-i INSTANCE]"

    def __init__(self, view: VehicleView, states: States) -> None:
        self._view = view
        self._array_topics = {topic.layout.name: topic for topic in array_topics(view.px4.name)}
        self._state_topics = {topic.layout.name: topic for topic in states.topics}
        self.command = Command(self.run, self.usage)
        self.uorb = Command(self.run_uorb, "status | top")

    def run(self, arguments: Arguments) -> Output:
        """Runs `listener …`."""
        if not arguments:
            raise UsageError
        name, options = arguments[0], arguments[1:]
        number, hz, instance = 1, 0.0, 0
        if options and not options[0].startswith("-"):
            options = ["-n", *options]
        if len(options) % 2:
            raise UsageError(f"{options[-1]} needs a value")
        for option, text in zip(options[::2], options[1::2], strict=True):
            try:
                if option == "-n":
                    number = int(text)
                elif option == "-r":
                    hz = float(text)
                elif option == "-i":
                    instance = int(text)
                else:
                    raise UsageError(f"unknown: {option}")
            except ValueError:
                raise UsageError(f"{option} {text} is not a number") from None
        if not (1 <= number <= MAX_SAMPLES and 0.0 <= hz < math.inf):
            raise UsageError(f"-n takes 1 to {MAX_SAMPLES}, -r a rate")
        if name not in self._array_topics and name not in self._state_topics:
            raise CommandFailed(f"Topic {name} did not match any known topics\n")
        if instance:
            raise CommandFailed("never published\n")
        if number == 1:
            return f"\nTOPIC: {name}\n{self._sample_text(name)}\n"
        return self._repeat(name, number, hz)

    def _repeat(self, name: str, number: int, hz: float) -> Iterator[tuple[str, float]]:
        wait_s = 1.0 / hz if hz else self._sample(name).period_us / 1e6
        for n in range(number):
            text = f"\nTOPIC: {name} {n + 1}/{number}\n{self._sample_text(name)}\n"
            yield text, wait_s if n + 1 < number else 0.0

    def _sample(self, name: str) -> _Sample:
        now_us = self._view.time_boot_us()
        array_topic: ArrayTopic | None = self._array_topics.get(name)
        if array_topic is not None:
            period_ms = array_topic.period(PROFILES)
            if isinstance(period_ms, int):
                period_us = period_ms * 1000
            else:
                period_us = STEP_US if period_ms is None else GPS_PERIOD_US
            values = current_values(array_topic, self._view.simulation, self._view.row)
            time_us = now_us // period_us * period_us
            if array_topic.sampled:
                values["timestamp_sample"] = time_us
            return _Sample(array_topic.layout, period_us, values, time_us)
        state_topic: StateTopic = self._state_topics[name]
        period_us = (state_topic.every_ms or 1000) * 1000
        return _Sample(state_topic.layout, period_us, state_topic.read(), now_us // period_us * period_us)

    def _sample_text(self, name: str) -> str:
        sample = self._sample(name)
        age_s = (self._view.time_boot_us() - sample.time_us) / 1e6
        lines = [f" {name}\n    timestamp: {sample.time_us} ({age_s:.6f} seconds ago)\n"]
        for field in sample.layout.fields:
            if field.name == "timestamp":
                continue
            text = _field_text(field, sample.values.get(field.name, 0))
            if field.name == "timestamp_sample":
                text += f" ({sample.time_us - int(sample.values.get(field.name, 0))} us before timestamp)"
            lines.append(f"    {field.name}: {text}\n")
        return "".join(lines)

    def run_uorb(self, arguments: Arguments) -> str:
        """Runs `uorb status` or `uorb top`: lists the topics with their rates and sizes."""
        if arguments[:1] not in (["status"], ["top"]):
            raise UsageError
        lines = [f"{'TOPIC NAME':<38}INST  RATE SIZE\n"]
        for name in sorted((*self._array_topics, *self._state_topics)):
            sample = self._sample(name)
            size = sample.layout.dtype.itemsize - LOG_HEADER_BYTES
            lines.append(f"{name:<38}{0:>4} {1e6 / sample.period_us:>5.0f} {size:>4}\n")
        return "".join(lines)


def _field_text(field: Field, value: Any) -> str:
    if field.length:
        items = value if isinstance(value, list | tuple) else [value] * field.length
        return "[" + ", ".join(_scalar_text(field.type, item) for item in items) + "]"
    return _scalar_text(field.type, value)


def _scalar_text(field_type: str, value: Any) -> str:
    if field_type == "bool":
        return str(bool(value))
    if field_type == "float":
        return f"{float(value):.5f}"
    if field_type == "double":
        return f"{float(value):.6f}"
    return str(int(value))
