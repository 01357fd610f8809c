"""A vehicle's newest frames, and samples made of them on demand."""

from __future__ import annotations

from collections import deque

from gcs_server.clock import Clock
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, full_payload
from gcs_server.vehicle import decoders
from gcs_server.vehicle.history import HISTORY_S, History
from gcs_server.vehicle.modes import name_and_label
from gcs_server.vehicle.reducers import REDUCERS, Facts
from gcs_server.vehicle.samples import Sample, Status

LINK_LOST_AFTER_S = 3.5
"""As QGroundControl."""

ATTITUDE_IDS = (d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, d.MAVLINK_MSG_ID_ATTITUDE)
MADE_OF: dict[str, tuple[int, ...]] = {
    "attitude": ATTITUDE_IDS,
    **{topic: ids for topic, (ids, _) in decoders.DECODERS.items()},
}
ANY_COMPONENT = frozenset(decoders.GIMBAL_IDS)
"""Messages that a gimbal of its own may send in the vehicle's stead."""
ALSO_READS: dict[str, tuple[int, ...]] = {"gimbal": ATTITUDE_IDS}
READS: dict[str, tuple[int, ...]] = {
    topic: (*ids, *ALSO_READS.get(topic, ())) for topic, ids in MADE_OF.items()
}
Frames = tuple[Frame | None, ...]


class VehicleState:
    """Written by `take` alone; reading decodes and caches.

    Args:
        component_id: the autopilot's; other components' frames are not state (but gimbals').
    """

    def __init__(self, component_id: int, clock: Clock) -> None:
        self.facts = Facts()
        self.latest: dict[int, Frame] = {}
        """Newest frame of each message id."""
        self._component_id = component_id
        self._clock = clock
        self._cache: dict[str, tuple[Frames, Sample | None]] = {}
        self._history = History({msg_id for ids in READS.values() for msg_id in ids})
        self._statuses: deque[tuple[float, Facts, bool, Sample]] = deque()
        """(when kept, what it was made of, sample), of the last minutes."""

    def take(self, frame: Frame) -> bool:
        """Keeps a frame; False where it is another component's affair."""
        if frame.component_id != self._component_id and frame.msg_id not in ANY_COMPONENT:
            return False
        self.latest[frame.msg_id] = frame
        reducer = REDUCERS.get(frame.msg_id)
        if reducer is not None:
            self.facts = reducer(self.facts, full_payload(frame), frame.received_monotonic_s)
        return True

    @property
    def link_lost(self) -> bool:
        """No heartbeat for too long."""
        return self._clock.monotonic_s() - self.facts.heartbeat_s > LINK_LOST_AFTER_S

    def status(self) -> Status:
        """What the vehicle does, as of now."""
        facts = self.facts
        name, label = name_and_label(facts.custom_mode, facts.autopilot)
        return Status(
            armed=facts.armed,
            mode=name,
            mode_label=label,
            custom_mode=facts.custom_mode,
            intended_custom_mode=facts.intended_custom_mode,
            landed_state=facts.landed_state,
            system_status=facts.system_status,
            link_lost=self.link_lost,
            last_heartbeat_age_s=max(0.0, self._clock.monotonic_s() - facts.heartbeat_s),
        )

    def topic(self, name: str) -> Sample | None:
        """The newest sample of a topic; None before the first.

        Raises:
            KeyError: there is no such topic.
        """
        if name == "status":
            return self._sample(name, self.status(), None, max(self.facts.heartbeat_s, self.facts.mode_s))
        frames = self._frames(name)
        cached = self._cache.get(name)
        if cached is not None and cached[0] == frames:
            return cached[1]
        sample = self._decode(name, frames)
        self._cache[name] = (frames, sample)
        return sample

    def remember(self) -> None:
        """Called at up to 4 Hz: keeps what is new for `history`; decodes nothing."""
        now_s = self._clock.monotonic_s()
        self._history.keep(self.latest, now_s)
        statuses, lost = self._statuses, self.link_lost
        if not statuses or statuses[-1][1] is not self.facts or statuses[-1][2] != lost:
            sample = self.topic("status")
            if sample is not None:
                statuses.append((now_s, self.facts, lost, sample))
        while statuses and statuses[0][0] < now_s - HISTORY_S:
            statuses.popleft()

    def history(self, topics: tuple[str, ...], since_unix_s: float) -> list[Sample]:
        """Samples not older than `since_unix_s`, oldest first."""
        now_s = self._clock.monotonic_s()
        since_s = max(since_unix_s - self._clock.unix_s() + now_s, now_s - HISTORY_S)
        samples: list[Sample] = []
        for name in topics:
            if name == "status":
                made = [sample for *_, sample in self._statuses]
            else:
                past = self._history.frames(READS[name])
                made = [self._decode(name, frames) for kept_s, frames in past if kept_s >= since_s]
            samples += [s for s in made if s is not None and s.received_monotonic_s >= since_s]
        return sorted(samples, key=lambda sample: sample.received_monotonic_s)

    def _frames(self, name: str) -> Frames:
        return tuple(map(self.latest.get, READS[name]))

    def _decode(self, name: str, frames: Frames) -> Sample | None:
        present = [f for f in frames[: len(MADE_OF[name])] if f is not None]
        if not present:
            return None
        payloads = {f.msg_id: full_payload(f) for f in frames if f is not None}
        if name == "attitude":
            newest = max(present, key=lambda f: f.received_monotonic_s)
            quaternion = payloads.get(ATTITUDE_IDS[0])
            # the two come in pairs; the quaternion is preferred unless it has stopped
            stale = quaternion is None or newest.received_monotonic_s - present[0].received_monotonic_s > 1.0
            decoded = decoders.attitude(payloads) if stale else decoders.attitude_quaternion(payloads)
        else:
            decoded = decoders.DECODERS[name][1](payloads)
        if decoded is None:
            return None
        received_s = max(f.received_monotonic_s for f in present)
        return self._sample(name, decoded[0], decoded[1], received_s)

    def _sample(self, name: str, value: object, boot_s: float | None, received_s: float) -> Sample | None:
        if received_s == float("-inf"):
            return None
        unix_s = self._clock.unix_s() - (self._clock.monotonic_s() - received_s)
        return Sample(name, boot_s, unix_s, received_s, value)
