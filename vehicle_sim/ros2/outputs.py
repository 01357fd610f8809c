"""Publications of one vehicle over ROS 2. The onboard log and the console read the same topics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.ros2.messages import MessageType
from vehicle_sim.ros2.topics import GIMBAL, STATUS, TIMESYNC, TRIPLET, Output, topics_of
from vehicle_sim.simulation import Simulation
from vehicle_sim.topics.arrays import ArrayTopic, array_topics
from vehicle_sim.topics.states import States, StateTopic
from vehicle_sim.topics.triplet import setpoint_type, triplet

TICK_US = 20_000
"""Period of the autopilot; state topics do not change more often."""
DDS_PROTOCOL = 2
"""TimesyncStatus.SOURCE_PROTOCOL_DDS."""
Publish = Callable[[str, bytes], None]


class _ArrayReader:
    """Reads one array topic of one vehicle into the values of a message."""

    def __init__(self, topic: ArrayTopic, message: MessageType) -> None:
        self._message = message
        self._values = message.blank()
        self._sources: list[tuple[Callable[[Simulation], Any], list[int]]] = []
        lengths = {field.name: field.length for field in message.flat}
        self._timestamp_sample_index = message.index.get("timestamp_sample") if topic.sampled else None
        for names, source in topic.sources.items():
            indices = [
                message.index[name] + n for name in names.split() for n in range(lengths[name] or 1)
            ]  # fmt: skip
            if callable(source):
                self._sources.append((source, indices))
                continue
            for index in indices:
                self._values[index] = source

    def read(self, simulation: Simulation, row: int, timestamp_us: int) -> bytes:
        """Reads the current values and encodes them as a message."""
        values = self._values
        values[0] = timestamp_us
        if self._timestamp_sample_index is not None:
            values[self._timestamp_sample_index] = timestamp_us
        for source, indices in self._sources:
            source_value = source(simulation)[row]
            if len(indices) == 1:
                values[indices[0]] = source_value
            else:
                for index, value in zip(indices, source_value.tolist(), strict=True):
                    values[index] = value
        return self._message.pack(values)


class _Schedule:
    """When an output is published: at `next_at_us`, or when its topic's key is not `published_key`."""

    def __init__(self, output: Output) -> None:
        self.output = output
        self.next_at_us = 0
        self.published_key: object = None
        self._published_at_us = -output.shortest_us

    def due(self, key: object, now_us: int, *, periodic: bool) -> bool:
        """Whether the topic is published now: because its key has changed, or because a period has ended.

        It is not published before its shortest period has ended; as in PX4, a topic that was quiet for longer
        may then be published twice in a shorter time.
        """
        shortest_us = self.output.shortest_us
        period_ended = periodic and now_us >= self.next_at_us
        if now_us < self._published_at_us + shortest_us or not (period_ended or key != self.published_key):
            return False
        self._published_at_us = max(self._published_at_us + shortest_us, now_us - shortest_us)
        self.published_key = key
        if period_ended:
            self._begin_period(now_us)
        return True

    def period_ended(self, now_us: int) -> bool:
        """Whether the period has ended; if so, the next period begins."""
        if now_us < self.next_at_us:
            return False
        self._begin_period(now_us)
        return True

    def _begin_period(self, now_us: int) -> None:
        """Periods end at multiples of their length."""
        every_us = self.output.every_us
        self.next_at_us = (now_us // every_us + 1) * every_us


class Outputs:
    """The publications of one vehicle.

    Args:
        autopilot: the vehicle's autopilot.
        states: the vehicle's state topics.
        publish: called with a topic's name and the message's bytes.
        offset_us: added to times since boot in `timestamp` and `timestamp_sample`.
        synchronized: whether the vehicle reports its time offset (`UXRCE_DDS_SYNCT`).
    """

    def __init__(
        self, autopilot: Autopilot, states: States, publish: Publish, offset_us: int, *, synchronized: bool
    ) -> None:
        self._autopilot, self._view = autopilot, autopilot.view
        self._publish, self._offset_us, self._synchronized = publish, offset_us, synchronized
        topics = topics_of(self._view.px4)
        outputs = topics.outputs
        arrays = {topic.layout.name: topic for topic in array_topics(self._view.px4.name)}
        state_topics = {topic.layout.name: topic for topic in states.topics}
        self._arrays = [
            (_Schedule(output), _ArrayReader(arrays[output.source], output.message))
            for output in outputs
            if output.source in arrays
        ]
        states_on_dds: list[tuple[_Schedule, StateTopic]] = [
            (_Schedule(output), state_topics[output.source])
            for output in outputs
            if output.source in state_topics
        ]
        self._fast_states = [pair for pair in states_on_dds if 0 < pair[0].output.every_us < TICK_US]
        self._states = [pair for pair in states_on_dds if pair not in self._fast_states]
        by_base = topics.output
        self._timesync, self._triplet = _Schedule(by_base[TIMESYNC]), _Schedule(by_base[TRIPLET])
        self._gimbal = _Schedule(by_base[GIMBAL]) if GIMBAL in by_base else None
        self._next_tick_at_us = 0

    def step(self, now_us: int) -> None:
        """Publishes the due topics; called after each simulation step."""
        simulation, row = self._view.simulation, self._view.row
        timestamp_us = now_us + self._offset_us
        for schedule, reader in self._arrays:
            if self._array_due(schedule, now_us):
                self._publish(schedule.output.name, reader.read(simulation, row, timestamp_us))
        for schedule, topic in self._fast_states:
            if schedule.period_ended(now_us):
                self._send(schedule.output, dict(topic.read()), now_us)
        if now_us >= self._next_tick_at_us:
            self._next_tick_at_us = (now_us // TICK_US + 1) * TICK_US
            self._publish_states(now_us)

    def _array_due(self, schedule: _Schedule, now_us: int) -> bool:
        if schedule.output.every_us > 0:
            return schedule.period_ended(now_us)
        count = self._view.simulation.sensors.gps_count
        if count == schedule.published_key:
            return False
        schedule.published_key = count
        return True

    def _publish_states(self, now_us: int) -> None:
        for schedule, topic in self._states:
            key = topic.key() if topic.key is not None else None
            if schedule.due(key, now_us, periodic=schedule.output.every_us > 0):
                values = dict(topic.read())
                if "timestamp_sample" in values:
                    values["timestamp_sample"] += self._offset_us
                self._send(schedule.output, values, now_us)
        if self._synchronized and now_us >= self._timesync.next_at_us:
            self._timesync.next_at_us = now_us + self._timesync.output.every_us
            self._publish_timesync(now_us)
        self._publish_triplet(now_us)
        if self._gimbal is not None and self._autopilot.gimbal.running and self._gimbal.period_ended(now_us):
            self._send(self._gimbal.output, self._gimbal_values(), now_us)

    def _send(self, output: Output, values: dict[str, Any], now_us: int) -> None:
        values["timestamp"] = now_us + self._offset_us
        if output.base == STATUS:
            self._autopilot.commander.external.on_status_published(values["can_set_nav_states_mask"])
        self._publish(output.name, output.message.encode(values))

    def _publish_timesync(self, now_us: int) -> None:
        values = {
            "source_protocol": DDS_PROTOCOL, "remote_timestamp": now_us + self._offset_us,
            "observed_offset": -self._offset_us, "estimated_offset": -self._offset_us,
        }  # fmt: skip
        self._send(self._timesync.output, values, now_us)

    def _gimbal_values(self) -> dict[str, Any]:
        gimbal = self._autopilot.gimbal
        rates = gimbal.rates
        return {
            "device_flags": int(gimbal.flags), "q": list(gimbal.device_quaternion()),
            "angular_velocity_x": rates.roll_rad_s, "angular_velocity_y": rates.pitch_rad_s,
            "angular_velocity_z": rates.yaw_rad_s, "gimbal_device_id": gimbal.device_id,
            "received_from_mavlink": gimbal.has_device,
        }  # fmt: skip

    def _publish_triplet(self, now_us: int) -> None:
        """Publishes the waypoint when it or its type changes, and while disarmed also periodically."""
        autopilot, waypoint = self._autopilot, self._autopilot.waypoint
        published = None if waypoint is None else (waypoint, setpoint_type(autopilot))
        if self._triplet.due(published, now_us, periodic=not autopilot.commander.armed):
            self._send(self._triplet.output, triplet(autopilot, now_us), now_us)
