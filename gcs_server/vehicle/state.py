"""A vehicle's newest frames, decoded into samples on demand."""

from __future__ import annotations

import heapq
import itertools
import logging
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import fields, replace

from gcs_server.clock import Clock
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, full_payload, known_frame
from gcs_server.vehicle import decoders, gimbal_decoder
from gcs_server.vehicle.gimbals import GimbalAddress, frames_by_gimbal
from gcs_server.vehicle.instances import ID_MASK, INSTANCE_OFFSET, Instances, active_instances, instance_of
from gcs_server.vehicle.numbers import Unusable
from gcs_server.vehicle.px4.modes import ModeNames
from gcs_server.vehicle.reducers import REDUCERS, FlightState
from gcs_server.vehicle.samples import Gimbal, GimbalReading, GlobalPosition, Home, Sample, Status
from missions.geodesy import distance_m

HISTORY_S = 300.0
PURGE_EVERY_S = 10.0
"""Period at which old frames are dropped [s]; looking for them at each call would cost as much as storing."""

_StoredFrame = tuple[float, int, float, bytes]
"""(stored_s, key, received_s, raw); keys: `instances.py`."""


class History:
    """Stores the newest frame of each message at each call of `store`.

    Args:
        msg_ids: the messages to store.
    """

    def __init__(self, msg_ids: Iterable[int]) -> None:
        self._msg_ids = frozenset(msg_ids)
        self._stored: dict[int, deque[_StoredFrame]] = {}
        self._next_purge_s = float("-inf")

    def store(self, latest: dict[int, Frame], now_s: float) -> None:
        """Stores new frames, and every `PURGE_EVERY_S` drops frames older than `HISTORY_S`.

        One older frame of each message stays stored, because it is the newest at the start of the history.
        """
        stored = self._stored
        for key, frame in latest.items():
            frames = stored.get(key)
            if frames is None:
                if key & ID_MASK not in self._msg_ids:
                    continue
                frames = stored[key] = deque()
            elif frames[-1][3] is frame.raw:
                continue
            frames.append((now_s, key, frame.received_monotonic_s, frame.raw))
        if now_s >= self._next_purge_s:
            self._next_purge_s = now_s + PURGE_EVERY_S
            self._purge(now_s - HISTORY_S)

    def _purge(self, before_s: float) -> None:
        for frames in self._stored.values():
            while len(frames) > 1 and frames[1][0] < before_s:
                frames.popleft()

    def frames(self, keys: tuple[int, ...]) -> Iterator[tuple[float, tuple[Frame | None, ...]]]:
        """(time [s], newest frame of each key at that time) for each time with a new frame; oldest first."""
        newest: dict[int, Frame] = {}
        stored = heapq.merge(*(self._stored.get(key, ()) for key in dict.fromkeys(keys)))
        for stored_s, simultaneous in itertools.groupby(stored, key=lambda item: item[0]):
            for _, key, received_s, raw in simultaneous:
                newest[key] = known_frame(raw, received_s)
            yield stored_s, tuple(map(newest.get, keys))


log = logging.getLogger(__name__)

LINK_LOST_AFTER_S = 3.5
"""Time without any message of the autopilot after which the connection is lost [s]. QGroundControl counts
only heartbeats. On a link with 20 % loss, however, three heartbeats in a row are lost every two minutes, and
a lost connection ends the setpoint stream."""
HEARTBEAT_OVERDUE_AFTER_S = 10.0
"""Time without a heartbeat after which the connection is lost [s], because only heartbeats report the armed
state."""

HEARTBEAT_ID, HOME_ID = d.MAVLINK_MSG_ID_HEARTBEAT, d.MAVLINK_MSG_ID_HOME_POSITION
SPECIAL_IDS = frozenset((*INSTANCE_OFFSET, *REDUCERS, HOME_ID))
"""Messages of the autopilot for which more is done than storing the newest frame."""
ATTITUDE_IDS = (d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, d.MAVLINK_MSG_ID_ATTITUDE)
TOPIC_MESSAGES: dict[str, tuple[int, ...]] = {
    "attitude": ATTITUDE_IDS,
    "gimbal": gimbal_decoder.IDS,
    **{topic: ids for topic, (ids, _) in decoders.DECODERS.items()},
}
"""The messages that contain each topic; their time is the time of the sample."""
EXTRA_MESSAGES: dict[str, tuple[int, ...]] = {"gimbal": ATTITUDE_IDS}
"""Further messages that the decoder of a topic needs."""
INPUT_MESSAGES: dict[str, tuple[int, ...]] = {
    topic: (*ids, *EXTRA_MESSAGES.get(topic, ())) for topic, ids in TOPIC_MESSAGES.items()
}
"""All messages that the decoder of each topic needs."""
TOPICS_OF_MESSAGE: dict[int, tuple[str, ...]] = {
    msg_id: tuple(topic for topic, ids in INPUT_MESSAGES.items() if msg_id in ids)
    for msg_id in {msg_id for ids in INPUT_MESSAGES.values() for msg_id in ids}
}
"""The topics that depend on each message."""
MAX_ATTITUDE_DELAY_S = 1.0
"""If one of the two attitude messages is older than the other by more than this, it is not used [s]."""
KEEPS_LAST_VALUE = frozenset({"home"})
"""Topics whose last valid value stays stored: limits refer to home, and one invalid message must not remove
the limits."""
HOME_CORRECTION_M = (0.9, 5.0)
"""Smallest and largest change of home's altitude in flight that count as a correction [m]. In the first two
minutes of a flight PX4 v1.17 corrects it by 1 to 1.8 m at once, and by 3.7 m in all; v1.16 sets home again at
the take-off, by up to 0.6 m (recorded)."""
HOME_MOVED_M = 1.0
"""Horizontal distance from which home is another place [m]."""
Frames = tuple[Frame | None, ...]
_StoredStatus = tuple[float, FlightState, float | None]
"""(time of storing, flight state, time at which the connection was lost; None: it was not lost) [s]."""


class SteadyHome:
    """The home to which altitudes refer, whose altitude is not corrected in flight.

    PX4 v1.17 corrects it, so that every altitude above home jumps while the vehicle hangs still, and a
    setpoint or limit above home would move it. From the first correction, the altitude stays what it was
    before, until the landing. A home at another place is used at once.
    """

    def __init__(self) -> None:
        self._home: Home | None = None
        self._received_s = float("-inf")
        self._in_flight = self._corrected = False

    def take(self, home: Home, received_s: float, armed_s: float, *, in_flight: bool) -> Home:
        """The home to use now; the origin of the local frame stays that of the newest home.

        Args:
            home: the vehicle's newest home.
            received_s: when it was received [s, monotonic].
            armed_s: when the vehicle was armed; PX4 sets home then.
            in_flight: whether the vehicle is in the air.
        """
        held, is_of_flight = self._home, self._received_s > armed_s
        self._home, self._received_s, self._in_flight = home, received_s, in_flight
        if held is None or not in_flight or not is_of_flight or _away_m(held, home) > HOME_MOVED_M:
            self._corrected = False
            return home
        change_m, (smallest_m, largest_m) = home.alt_amsl_m - held.alt_amsl_m, HOME_CORRECTION_M
        if abs(change_m) > largest_m:
            return home
        self._corrected = self._corrected or abs(change_m) > smallest_m
        if not self._corrected:
            return home
        position_ned_m = home.position_ned_m
        if position_ned_m is not None:
            position_ned_m = (*position_ned_m[:2], position_ned_m[2] + change_m)
        self._home = replace(home, alt_amsl_m=held.alt_amsl_m, position_ned_m=position_ned_m)
        return self._home

    def forget(self) -> None:
        """Uses the newest home as it is: a command has set it, so its altitude is no correction."""
        self._home, self._corrected = None, False

    def watch(self, position: GlobalPosition) -> GlobalPosition:
        """Notices a correction in the vehicle's newest position, which PX4 sends more often than home; see
        `altitude_above`."""
        if self._home is not None and self._in_flight:
            change_m = position.alt_amsl_m - position.alt_home_m - self._home.alt_amsl_m
            smallest_m, largest_m = HOME_CORRECTION_M
            self._corrected = self._corrected or smallest_m < abs(change_m) <= largest_m
        return self.altitude_above(position)

    def altitude_above(self, position: GlobalPosition) -> GlobalPosition:
        """The position with its altitude above this home once PX4 has corrected its own in flight."""
        if self._home is None or not (self._in_flight and self._corrected):
            return position
        return replace(position, alt_home_m=round(position.alt_amsl_m - self._home.alt_amsl_m, 3))


def _away_m(first: Home, second: Home) -> float:
    return distance_m(first.lat_deg, first.lon_deg, second.lat_deg, second.lon_deg)


class VehicleState:
    """State of one vehicle. Only `take` changes it; samples are decoded and cached when they are read.

    Args:
        component_id: component id of the autopilot. Frames of other components are ignored, except frames of
            gimbals.
        mode_names: names of the vehicle's external modes; None: no names.
    """

    def __init__(self, component_id: int, clock: Clock, mode_names: ModeNames | None = None) -> None:
        self._mode_names = mode_names or ModeNames()
        self.flight_state = FlightState()
        self._home = SteadyHome()
        self._armed_s = float("-inf")
        """When the vehicle was armed [s, monotonic]."""
        self.latest: dict[int, Frame] = {}
        """Newest frame of each (component, message, instance), by key (`instances.py`)."""
        self._instances = Instances(component_id)
        self.unusable: dict[str, str] = {}
        """Topics whose newest message was unusable when the topic was last read, with the reasons."""
        self._component_id = component_id
        self._clock = clock
        self._cache: dict[str, Sample | None] = {}
        self._decoded: set[str] = set()
        """Topics that were decoded and have no newer message."""
        self._inputs: set[int] = set()
        """Ids of messages that decoded topics depend on and that were not received again since then."""
        self._history = History({msg_id for ids in INPUT_MESSAGES.values() for msg_id in ids})
        self._received_s = float("-inf")
        """Time of the last heartbeat, or of the last message after it, if no gap was longer than
        `LINK_LOST_AFTER_S`."""
        self._statuses: deque[_StoredStatus] = deque()
        """The statuses of the last minutes."""

    def take(self, frame: Frame) -> bool:
        """Stores a frame; returns False if the frame is ignored, because another component sent it."""
        msg_id, from_autopilot = frame.msg_id, frame.component_id == self._component_id
        if not frame.known:  # storing all 16 million possible ids would fill the memory
            return from_autopilot
        key: int | None = msg_id
        if from_autopilot:
            now_s = frame.received_monotonic_s
            # only a heartbeat restores the link
            if now_s - self._received_s <= LINK_LOST_AFTER_S or msg_id == HEARTBEAT_ID:
                self._received_s = now_s
            if msg_id in SPECIAL_IDS:
                if msg_id in INSTANCE_OFFSET:
                    key = self._instances.key_of(frame)
                elif msg_id in REDUCERS:
                    was_armed = self.flight_state.armed
                    self.flight_state = REDUCERS[msg_id](self.flight_state, full_payload(frame), now_s)
                    if self.flight_state.armed and not was_armed:
                        self._armed_s = now_s
                else:
                    self.topic("home")  # decode the previous frame before the new one replaces it
        else:
            key = self._instances.key_of(frame)
        if key is None:
            return from_autopilot
        self.latest[key] = frame
        if msg_id in self._inputs:
            self._inputs.remove(msg_id)
            self._decoded.difference_update(TOPICS_OF_MESSAGE[msg_id])
        return True

    @property
    def link_lost(self) -> bool:
        """Whether the connection is lost, because no message or no heartbeat was received for too long."""
        return self._clock.monotonic_s() > self._lost_from_s()

    def _lost_from_s(self) -> float:
        return min(
            self._received_s + LINK_LOST_AFTER_S, self.flight_state.heartbeat_s + HEARTBEAT_OVERDUE_AFTER_S
        )

    def reason_lost(self) -> str:
        """Why the connection is lost, as text."""
        now_s = self._clock.monotonic_s()
        if self._received_s == float("-inf"):
            return "no message received"
        if now_s - self._received_s > LINK_LOST_AFTER_S:
            return f"no messages for {now_s - self._received_s:.1f} s"
        return f"no heartbeat for {now_s - self.flight_state.heartbeat_s:.0f} s"

    @property
    def mode(self) -> str:
        """Name of the current mode."""
        return self.flight_state.mode_name[0]

    def status(self) -> Status:
        """Current status of the vehicle."""
        return self._status(self._clock.monotonic_s(), self.flight_state, self._lost_since_s())

    def _status(self, at_s: float, flight_state: FlightState, lost_since_s: float | None) -> Status:
        name, label = self._mode_names.registered(flight_state.mode_name)
        return Status(
            armed=flight_state.armed,
            mode=name,
            mode_label=label,
            custom_mode=flight_state.custom_mode,
            intended_custom_mode=flight_state.intended_custom_mode,
            landed_state=flight_state.landed_state,
            system_status=flight_state.system_status,
            link_lost=lost_since_s is not None,
            last_heartbeat_age_s=(
                None
                if flight_state.heartbeat_s == float("-inf")
                else max(0.0, at_s - flight_state.heartbeat_s)
            ),
        )

    def _status_sample(
        self, at_s: float, flight_state: FlightState, lost_since_s: float | None
    ) -> Sample | None:
        status = self._status(at_s, flight_state, lost_since_s)
        return self._sample("status", status, None, _changed_s(flight_state, lost_since_s))

    def topic(self, name: str) -> Sample | None:
        """The newest sample of a topic; None: no sample, or the newest message is unusable.

        Raises:
            KeyError: there is no such topic.
        """
        if name in self._decoded:
            return self._cache[name]
        if name == "status":
            return self._status_sample(self._clock.monotonic_s(), self.flight_state, self._lost_since_s())
        keys = self._instances.keys(INPUT_MESSAGES[name])
        frames = tuple(map(self.latest.get, keys))
        self.unusable.pop(name, None)
        try:
            sample = self._decode(name, keys, frames)
        except Unusable as error:
            self.unusable[name] = str(error)
            sample = self._cache.get(name) if name in KEEPS_LAST_VALUE else None
        except Exception as error:  # a fault of this program affects only this topic
            if name not in self._cache or self._cache[name] is not None:
                log.exception("topic %s could not be decoded", name)
            self.unusable[name] = f"it could not be decoded ({type(error).__name__}: {error})"
            sample = None
        if sample is not None and isinstance(sample.value, Home):
            flight = self.flight_state
            in_flight = flight.armed and flight.landed_state != "on_ground"
            received_s = sample.received_monotonic_s
            home = self._home.take(sample.value, received_s, self._armed_s, in_flight=in_flight)
            sample = replace(sample, value=home)
        elif sample is not None and isinstance(sample.value, GlobalPosition):
            sample = replace(sample, value=self._home.watch(sample.value))
        self._cache[name] = sample
        self._decoded.add(name)
        self._inputs.update(INPUT_MESSAGES[name])
        return sample

    def home_was_set(self) -> None:
        """Called when the vehicle has reported a home that a command has set."""
        self._home.forget()
        self._decoded.discard("home")

    def newest(self, msg_id: int, component_id: int | None, instance: int | None) -> Frame | None:
        """The newest frame of a message from a component and instance. By default the autopilot's frame,
        or else the frame of the lowest component and instance."""
        for key in self._instances.keys((msg_id,)):
            frame = self.latest.get(key)
            if (
                frame is not None
                and component_id in (None, frame.component_id)
                and instance in (None, instance_of(key))
            ):
                return frame
        return None

    def senders(self, msg_id: int) -> frozenset[int]:
        """Components that have sent a message."""
        frames = (self.latest.get(key) for key in self._instances.keys((msg_id,)))
        return frozenset(frame.component_id for frame in frames if frame is not None)

    def gimbals(self) -> tuple[GimbalAddress, ...]:
        """The connected gimbals, the autopilot's first."""
        keys = self._instances.keys(gimbal_decoder.IDS)
        frames = {key: self.latest[key] for key in keys if key in self.latest}
        return tuple(address for address, _ in frames_by_gimbal(frames, self._component_id))

    def topic_received_s(self, name: str) -> float | None:
        """Time of reception of the topic's newest sample [s, monotonic]; None: no sample. For
        the status this is much faster than `topic`, which creates a new sample at each call.
        """
        if name == "status":
            changed_s = _changed_s(self.flight_state, self._lost_since_s())
            return None if changed_s == float("-inf") else changed_s
        sample = self._cache[name] if name in self._decoded else self.topic(name)
        return None if sample is None else sample.received_monotonic_s

    def store_history(self) -> None:
        """Stores new frames for `history`, without decoding; called at up to 4 Hz."""
        now_s = self._clock.monotonic_s()
        self._history.store(self.latest, now_s)
        statuses, lost_since_s = self._statuses, self._lost_since_s()
        if not statuses or statuses[-1][1] is not self.flight_state or statuses[-1][2] != lost_since_s:
            statuses.append((now_s, self.flight_state, lost_since_s))
            while statuses[0][0] < now_s - HISTORY_S:
                statuses.popleft()

    def history(self, topics: tuple[str, ...], since_unix_s: float) -> list[Sample]:
        """Samples not older than `since_unix_s`, oldest first."""
        now_s = self._clock.monotonic_s()
        since_s = max(since_unix_s - self._clock.unix_s() + now_s, now_s - HISTORY_S)
        samples: list[Sample] = []
        for name in topics:
            if name == "status":
                past_samples = [self._status_sample(*stored) for stored in self._statuses]
            else:
                keys = self._instances.keys(INPUT_MESSAGES[name])
                history = self._history.frames(keys)
                past_samples = [
                    self._decode_past(name, keys, frames) for at_s, frames in history if at_s >= since_s
                ]
            samples += [s for s in past_samples if s is not None and s.received_monotonic_s >= since_s]
        return sorted(samples, key=lambda sample: sample.received_monotonic_s)

    def _lost_since_s(self) -> float | None:
        """Time at which the connection was lost [s, monotonic]; None: it is not lost."""
        return self._lost_from_s() if self.link_lost else None

    def _decode_past(self, name: str, keys: tuple[int, ...], frames: Frames) -> Sample | None:
        """A sample of the history; None if it cannot be decoded."""
        try:
            return self._decode(name, keys, frames)
        except Exception:
            return None

    def _decode(self, name: str, keys: tuple[int, ...], frames: Frames) -> Sample | None:
        frame_by_key = {key: frame for key, frame in zip(keys, frames, strict=True) if frame is not None}
        if not frame_by_key:
            return None
        if name != "gimbal" and len(keys) > len(INPUT_MESSAGES[name]):
            frame_by_key = active_instances(frame_by_key.items())
        message_ids = TOPIC_MESSAGES[name]
        topic_frames = [frame for frame in frame_by_key.values() if frame.msg_id in message_ids]
        if not topic_frames:
            return None
        payloads = {key: full_payload(frame) for key, frame in frame_by_key.items()}
        if name == "gimbal":
            decoded = self._gimbal(frame_by_key)
        elif name == "attitude":
            decoded = self._attitude(topic_frames, payloads)
        else:
            decoded = decoders.DECODERS[name][1](payloads)
        if decoded is None:
            return None
        received_s = max([f.received_monotonic_s for f in topic_frames])
        value = decoded[0]
        if isinstance(value, GlobalPosition):
            value = self._home.altitude_above(value)
        return self._sample(name, value, decoded[1], received_s)

    def _gimbal(self, frame_by_key: dict[int, Frame]) -> decoders.Decoded | None:
        """The first gimbal, with a list of all gimbals if there are several. A gimbal with unusable messages
        is omitted."""
        vehicle = {
            msg_id: full_payload(frame_by_key.pop(msg_id))
            for msg_id in ATTITUDE_IDS
            if msg_id in frame_by_key
        }
        readings: list[tuple[GimbalReading, float]] = []
        unusable: Unusable | None = None
        for address, frames in frames_by_gimbal(frame_by_key, self._component_id):
            payloads = {msg_id: full_payload(frame) for msg_id, frame in frames.items()}
            try:
                decoded = gimbal_decoder.gimbal(payloads | vehicle, address.component_id, address.device_id)
            except Unusable as error:
                unusable = error
            else:
                readings += [decoded] if decoded is not None else []
        if not readings:
            if unusable is not None:
                raise unusable
            return None
        first = {field.name: getattr(readings[0][0], field.name) for field in fields(GimbalReading)}
        return Gimbal(
            **first, gimbals=tuple(value for value, _ in readings) if len(readings) > 1 else ()
        ), readings[0][1]

    @staticmethod
    def _attitude(topic_frames: list[Frame], payloads: dict[int, bytes]) -> decoders.Decoded:
        """Selects one of two attitude messages: the quaternion, unless it is invalid or no longer
        received."""
        received_s = {f.msg_id: f.received_monotonic_s for f in topic_frames}
        quaternion_s, angles_s = [received_s.get(msg_id, float("-inf")) for msg_id in ATTITUDE_IDS]
        if angles_s - quaternion_s > MAX_ATTITUDE_DELAY_S:
            return decoders.attitude(payloads)
        try:
            return decoders.attitude_quaternion(payloads)
        except Unusable:
            if quaternion_s - angles_s > MAX_ATTITUDE_DELAY_S:
                raise
            return decoders.attitude(payloads)

    def _sample(
        self, name: str, value: object, time_boot_s: float | None, received_s: float
    ) -> Sample | None:
        if received_s == float("-inf"):
            return None
        unix_s = self._clock.unix_s() - (self._clock.monotonic_s() - received_s)
        return Sample(name, time_boot_s, unix_s, received_s, value)


def _changed_s(flight_state: FlightState, lost_since_s: float | None) -> float:
    """Time at which the status last changed, by a message or a lost connection."""
    message_s = max(flight_state.heartbeat_s, flight_state.mode_s, flight_state.landed_s)
    return message_s if lost_since_s is None else max(message_s, lost_since_s)
