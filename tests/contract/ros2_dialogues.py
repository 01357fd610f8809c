"""Recorded ROS 2 dialogues of a real PX4, and their replay to the simulated vehicle in simulated time."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from tests.support.dds_recordings import FOLDERS
from tests.support.dds_samples import base_name
from tests.support.ros2_vehicle import Ros2Vehicle
from vehicle_sim.external_modes.arming_checks import REQUEST_IDS
from vehicle_sim.external_modes.slots import FIRST_MODE, name_hash
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.px4_version import V1_16, Px4Version
from vehicle_sim.ros2.messages import MESSAGES
from vehicle_sim.ros2.topics import COMMAND, COMMAND_ACK, SERVICE_REQUEST, topics_of

RECORDINGS_FOLDER = FOLDERS["1.16"] / "dialogues"
CHECK_REQUEST, CHECK_REPLY = "/fmu/out/arming_check_request", "/fmu/in/arming_check_reply"
REGISTER_REPLY, FORMAT_RESPONSE = "/fmu/out/register_ext_component_reply", "/fmu/out/message_format_response"
MODE_COMPLETED = "/fmu/out/mode_completed"
VEHICLE_STATUS, FAILSAFE_FLAGS = "/fmu/out/vehicle_status", "/fmu/out/failsafe_flags"
REQUEST_PERIOD_S = 0.3138  # of the arming check requests, by the recorder's clock
DELIBERATE_DELAY_S = 0.05
"""A reply that was sent later than this after its request was delayed on purpose."""
GCS = (255, 190)
PAUSE_S, LONGEST_PAUSE_S = 1.5, 60.0
"""Time after a dialogue without a recorded pause, and the longest recorded pause that is replayed."""
MAX_EARLY_S = 0.25
TOLERANCE_S = 0.7
"""PX4 publishes `vehicle_status` at 2 Hz and `failsafe_flags` at 1.8 Hz."""
STATE_FIELDS = (
    "arming_state", "nav_state", "nav_state_user_intention", "failsafe", "executor_in_charge",
    "failsafe_defer_state", "pre_flight_checks_pass",
)  # fmt: skip
MASK = "valid_registrations_mask"
SELECTABLE_MODES = "can_set_nav_states_mask"
FLAG_FIELDS = ("offboard_control_signal_lost", "manual_control_signal_lost")
EVENT_FIELDS = {
    COMMAND_ACK: ("command", "result", "target_system", "target_component"),
    REGISTER_REPLY: ("name", "success", "arming_check_id", "mode_id", "mode_executor_id",
                     "px4_ros2_api_version"),
    FORMAT_RESPONSE: ("topic_name", "success", "message_hash", "protocol_version"),
}  # fmt: skip
COMPARED_TOPICS = {*EVENT_FIELDS, CHECK_REQUEST, VEHICLE_STATUS, FAILSAFE_FLAGS, MODE_COMPLETED}

Dialogue = dict[str, Any]


def load_dialogues(groups: tuple[str, ...]) -> list[Dialogue]:
    """The dialogues of these groups, sorted by boot and, within a boot, in recorded order."""
    found: list[Dialogue] = []
    for group in groups:
        path = RECORDINGS_FOLDER / f"{group}.jsonl"
        if path.exists():
            found += [json.loads(line) for line in path.read_text().splitlines()]
    sessions = list(dict.fromkeys(each["session"] for each in found))
    return sorted(found, key=lambda each: sessions.index(each["session"]))


def flat_fields(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields as numbers: null becomes NaN; arrays of messages are flattened."""
    flat: dict[str, Any] = {}
    for key, value in fields.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            for n, inner in enumerate(value):
                flat |= {f"{key}[{n}].{name}": each for name, each in inner.items()}
        elif isinstance(value, list):
            if value:
                flat[key] = [math.nan if each is None else each for each in value]
        else:
            flat[key] = math.nan if value is None else 0 if value == "now" else value
    return flat


def with_present_names(dialogue: Dialogue, px4: Px4Version) -> Dialogue:
    """A dialogue of v1.17 in the form of those of v1.16: topics without version, except those of a program of
    v1.16; single replies as streams; the time of a reply as its age."""
    wire_names = {topic.name: topic.base for topic in topics_of(px4).inputs}
    clocks_us = [
        each["fields"]["timestamp"] - each["dt_s"] * 1e6
        for each in dialogue["send"]
        if base_name(each["topic"]) == COMMAND and each["fields"].get("timestamp")
    ]
    sent: list[dict[str, Any]] = []
    streams: dict[Any, dict[str, Any]] = {}
    for each in dialogue["send"]:
        of_this_version = "layout" not in each
        topic = wire_names.get(each["topic"], each["topic"]) if of_this_version else each["topic"]
        fields = {**each.get("fields", {})}
        stamp_us = fields.pop("timestamp", 0)
        entry = each | {"topic": topic, "fields": fields}
        if base_name(str(topic)) == CHECK_REPLY:
            entry = {"count": 1, "until_dt_s": each["dt_s"], **entry}
            if stamp_us and clocks_us:
                entry["age_s"] = (clocks_us[0] - stamp_us) / 1e6 + each["dt_s"]
            stream = streams.setdefault((topic, fields.get("registration_id", 0)), entry)
            if stream is not entry:
                stream["count"] += entry["count"]
                stream["until_dt_s"] = entry["until_dt_s"]
                continue
        sent.append(entry)
    received = [
        each | {"topic": base_name(each["topic"])} if "topic" in each else each
        for each in dialogue["received"]
    ]
    return {"parameters": {}, **dialogue, "send": sent, "received": received}


@dataclass(frozen=True)
class TimedDialogue:
    """A dialogue, and its duration: the time until the next dialogue of the same boot begins."""

    dialogue: Dialogue
    duration_s: float
    replies_continue: bool = False
    """Whether the components that sent the last replies continue to reply until the next dialogue."""


def timed_dialogues(dialogues: list[Dialogue]) -> list[TimedDialogue]:
    """The dialogues with the times between them, calculated from the ids of the requests."""
    return [_timed_dialogue(each, after) for each, after in itertools.zip_longest(dialogues, dialogues[1:])]


def dialogue_parameters(dialogues: list[TimedDialogue], is_long: Callable[[str], bool]) -> list[Any]:
    """The dialogues as pytest parameters; only the long tests replay sessions for which `is_long` is true."""
    return [
        pytest.param(each, id=each.dialogue["id"], marks=pytest.mark.broad if is_broad else ())
        for each in dialogues
        for is_broad in (is_long(each.dialogue["session"]),)
    ]


def _timed_dialogue(dialogue: Dialogue, following: Dialogue | None) -> TimedDialogue:
    end_s = _last_time_s(dialogue)
    requests, next_requests = _requests(dialogue), _requests(following) if following else []
    if following is None or following["session"] != dialogue["session"] or not requests or not next_requests:
        return TimedDialogue(dialogue, end_s + PAUSE_S)
    (first_s, first_id), (last_s, last_id) = next_requests[0], requests[-1]
    duration_s = last_s + (first_id - last_id) % REQUEST_IDS * REQUEST_PERIOD_S - first_s
    if not end_s - REQUEST_PERIOD_S < duration_s < end_s + LONGEST_PAUSE_S:
        return TimedDialogue(dialogue, end_s + PAUSE_S)
    replies = _replies(following)
    replied = bool(replies) and replies[0]["fields"].get("request_id", 0) <= first_id
    return TimedDialogue(dialogue, max(duration_s, end_s + TOLERANCE_S), replied)


class _Responder:
    """Replies to arming check requests as one entry of a dialogue did."""

    def __init__(self, entry: dict[str, Any], requested: dict[int, float], continues: bool) -> None:
        kept = {name: entry[name] for name in ("age_s", "layout") if name in entry}
        self._fields, self.topic = flat_fields(entry["fields"]) | kept, entry["topic"]
        first_s = entry["dt_s"]
        delay_s = first_s - requested.get(entry["fields"].get("request_id", 0), first_s)
        self._delay_s = delay_s if delay_s > DELIBERATE_DELAY_S else 0.0
        self._from_s = first_s - self._delay_s - 0.1
        self._until_s = math.inf if continues else entry["until_dt_s"] - self._delay_s + 0.1
        self._remaining_count, self._last_id = entry["count"], 0

    def reply(self, at_s: float, request_id: int) -> tuple[float, dict[str, Any]] | None:
        """Time and fields of the reply; None: no reply at this time."""
        if not self._from_s <= at_s <= self._until_s:
            return None
        self._remaining_count, self._last_id = self._remaining_count - 1, request_id
        return at_s + self._delay_s, self._fields | {"request_id": request_id}

    def surplus_reply(self, at_s: float) -> dict[str, Any] | None:
        """A second reply to the last request, if the recording has more replies than requests."""
        if self._remaining_count <= 0 or at_s < self._until_s or not self._last_id:
            return None
        self._remaining_count = 0
        return self._fields | {"request_id": self._last_id}


class _Vehicle(Ros2Vehicle):
    """A vehicle that decodes only the compared topics."""

    def receive(self, topic: str, data: bytes) -> None:
        if topic in COMPARED_TOPICS:
            super().receive(topic, data)


class Ros2DialoguePlayer:
    """Replays dialogues in order; starts a new vehicle of this version of PX4 for each boot."""

    def __init__(self, px4: Px4Version = V1_16) -> None:
        self._px4 = px4
        self.vehicle = Ros2Vehicle(px4=px4)
        self._session = ""
        self.began_s = self._until_s = 0.0
        self._parser = FrameParser()
        self.modes: list[dict[str, Any]] = []
        """AVAILABLE_MODES received in this dialogue."""

    def play(self, timed_dialogue: TimedDialogue) -> None:
        """Replays one dialogue, and waits until the next dialogue of the same boot begins."""
        dialogue = timed_dialogue.dialogue
        if dialogue["session"] != self._session:
            self._session = dialogue["session"]
            namespaced = "ns1" in self._session
            self.vehicle = _Vehicle(
                parameters={"UXRCE_DDS_SYNCT": 0, **dialogue["parameters"]}, links=(("gcs", "gcs"),),
                first_instance=1 if namespaced else 0, px4=self._px4,
            )  # fmt: skip
            self._parser = FrameParser()
            self._boot()
        self._prepare(dialogue)
        _occupy_slots(dialogue, self.vehicle)
        self.modes = []
        self.began_s = self.vehicle.sim.time_s
        self._until_s = self.began_s + _last_time_s(dialogue) + TOLERANCE_S
        self._begin(dialogue)
        pending = sorted(_messages(dialogue), key=lambda each: each[0])
        responders = _responders(
            dialogue, continues=timed_dialogue.replies_continue or self._ends_with_landing(dialogue)
        )
        read_count = len(self.vehicle.received_messages)
        while not self._has_ended(now_s := self.vehicle.sim.time_s - self.began_s, timed_dialogue):
            for at_s, topic, fields in self.vehicle.received_messages[read_count:]:
                if topic == CHECK_REQUEST:
                    pending += _due_replies(responders, at_s - self.began_s, fields["request_id"])
            read_count = len(self.vehicle.received_messages)
            surplus_replies = [(each.topic, each.surplus_reply(now_s)) for each in responders]
            pending += [(now_s, topic, fields) for topic, fields in surplus_replies if fields is not None]
            due = [each for each in pending if each[0] <= now_s + 1e-6]
            pending = [each for each in pending if each[0] > now_s + 1e-6]
            for _, topic, fields in due:
                self._send(topic, fields)
            self._run(0.004)

    def _ends_with_landing(self, dialogue: Dialogue) -> bool:
        """Whether the dialogue ends with a landing, which may take longer than recorded."""
        return False

    def _has_ended(self, now_s: float, timed_dialogue: TimedDialogue) -> bool:
        """Whether the dialogue has ended."""
        return now_s >= timed_dialogue.duration_s

    def _boot(self) -> None:
        """Called after a boot."""

    def _prepare(self, dialogue: Dialogue) -> None:
        """Called before a dialogue."""

    def _begin(self, dialogue: Dialogue) -> None:
        """Called when a dialogue begins."""

    def _send(self, topic: str, fields: dict[str, Any]) -> None:
        if "age_s" in fields:
            sent_s = self.vehicle.sim.time_s - fields["age_s"]
            fields = {k: v for k, v in fields.items() if k != "age_s"} | {"timestamp": int(sent_s * 1e6)}
        if "layout" in fields:
            of_v1_16 = {k: v for k, v in fields.items() if k != "layout"}
            data = MESSAGES["1.16"]["ArmingCheckReply"].encode(of_v1_16)
            self.vehicle.send_bytes(topic, data + bytes(-len(data) % 4))
            return
        if topic in self.vehicle.message_types:
            self.vehicle.send(topic, fields)
            return
        numbers = {f"param{n + 1}": value for n, value in enumerate(fields.get("params", ()))}
        target = {"target_system": self.vehicle.sim.nodes[0].system_id, "target_component": 1}
        layout, payload = pack("COMMAND_LONG", command=fields["command"], **target, **numbers)
        self.vehicle.sim.feed(0, "gcs", frame_v2(layout, payload, 0, *GCS))

    def _run(self, seconds: float) -> None:
        self.vehicle.run(seconds)
        for message in self._parser.feed(self.vehicle.sim.drain(0, "gcs")):
            if message.name == "AVAILABLE_MODES":
                self.modes.append(message.values)

    def events(self, topic: str) -> list[tuple[Any, ...]]:
        """Messages that the vehicle published on an event topic."""
        messages = self.vehicle.all_fields(topic, self.began_s)
        return [tuple(message[name] for name in EVENT_FIELDS[topic]) for message in messages]

    def changes(self, topic: str, name: str) -> list[tuple[float, Any]]:
        """Time, and old and new value, of each change of a field."""
        received = [(at_s, each[name]) for at_s, t, each in self.vehicle.received_messages if t == topic]
        pairs = itertools.pairwise(received)
        changed = [(new[0], (old[1], new[1])) for old, new in pairs if new[1] != old[1]]
        return [(at_s - self.began_s, each) for at_s, each in changed if self.began_s < at_s < self._until_s]


def _occupy_slots(dialogue: Dialogue, vehicle: Ros2Vehicle) -> None:
    """Marks the slots as occupied that PX4 gave to other modes in unrecorded dialogues of this boot."""
    parameters = vehicle.sim.simulation.parameters[0]
    registered = [e for e in recorded_events(dialogue, REGISTER_REPLY) if e[1] and e[3] >= FIRST_MODE]
    if registered and name_hash(registered[0][0]) not in parameters.mode_hashes:
        for slot in range(registered[0][3] - FIRST_MODE):
            if parameters.mode_hashes[slot] == 0:
                parameters.store_mode_hash(slot, 1 + slot)


def _messages(dialogue: Dialogue) -> Iterator[tuple[float, str, dict[str, Any]]]:
    for sent in dialogue["send"]:
        topic = SERVICE_REQUEST if sent["topic"].endswith("vehicle_commandRequest") else sent["topic"]
        topic = topic[topic.find("/fmu/") :] if "/fmu/" in topic else topic
        if base_name(topic) == CHECK_REPLY:
            continue
        fields = sent.get("fields") or {}
        fields = flat_fields(fields) if topic.startswith("/fmu/") else fields
        fields.pop("writer_qos", None)
        for n in range(sent.get("count", 1)):
            at_s = sent["dt_s"] + n / sent.get("streamed_hz", 1)
            if at_s > -MAX_EARLY_S:  # earlier messages belong to the previous dialogue
                yield at_s, topic, fields_at(sent["setpoints"], at_s) if "setpoints" in sent else fields


def fields_at(setpoints: list[list[Any]], at_s: float) -> dict[str, Any]:
    """The fields of a stream that changes: each entry is valid until the next one."""
    started = [fields for begin_s, fields in setpoints if begin_s <= at_s or begin_s <= setpoints[0][0]]
    return flat_fields(started[-1])


def _requests(dialogue: Dialogue) -> list[tuple[float, int]]:
    """Time and id of the recorded arming check requests: the first ones and the last."""
    requests = _received(dialogue, "arming_check_request")
    return [(request["dt_s"], request["fields"]["request_id"]) for request in requests]


def _received(dialogue: Dialogue, topic: str) -> list[dict[str, Any]]:
    name = base_name(topic)
    return [each for each in dialogue["received"] if base_name(each.get("topic", "")).endswith(name)]


def _replies(dialogue: Dialogue) -> list[dict[str, Any]]:
    return [message for message in dialogue["send"] if base_name(message["topic"]) == CHECK_REPLY]


def _responders(dialogue: Dialogue, *, continues: bool) -> list[_Responder]:
    requests = {request_id: at_s for at_s, request_id in reversed(_requests(dialogue))}
    since_s = max(requests.values(), default=0.0) - REQUEST_PERIOD_S
    replies = _replies(dialogue)
    return [_Responder(reply, requests, continues and reply["until_dt_s"] > since_s) for reply in replies]


def _due_replies(
    responders: list[_Responder], at_s: float, request_id: int
) -> Iterator[tuple[float, str, dict[str, Any]]]:
    for responder in responders:
        reply = responder.reply(at_s, request_id)
        if reply is not None:
            yield reply[0], responder.topic, reply[1]


def _last_time_s(dialogue: Dialogue) -> float:
    times = [each["dt_s"] for each in dialogue["received"]] + [each["dt_s"] for each in dialogue["send"]]
    times += [message["until_dt_s"] for message in dialogue["send"] if "until_dt_s" in message]
    return max(times, default=0.0)


def recorded_events(dialogue: Dialogue, topic: str) -> list[tuple[Any, ...]]:
    """Messages that PX4 published on an event topic."""
    messages = _received(dialogue, topic)
    return [tuple(message["fields"][name] for name in EVENT_FIELDS[topic]) for message in messages]


def recorded_changes(dialogue: Dialogue, topic: str, name: str) -> list[tuple[float, Any]]:
    """Time, and old and new value, of each recorded change of a field."""
    samples = _received(dialogue, topic)
    return [(s["dt_s"], tuple(s["changed"][name])) for s in samples if name in s.get("changed", {})]


def bit_changes(changes: list[tuple[float, Any]]) -> list[tuple[int, bool, float]]:
    """Changes of a bit mask, sorted by bit: the bit, whether it is set, and the time.

    PX4 publishes `vehicle_status` at 2 Hz; which changes are in the same message depends on its phase.
    """
    found: list[tuple[int, bool, float]] = []
    before = changes[0][1][0] if changes else 0
    for at_s, (_, mask) in changes:
        changed = before ^ mask
        found += [(bit, bool(mask >> bit & 1), at_s) for bit in range(32) if changed >> bit & 1]
        before = mask
    return sorted(found, key=lambda each: (each[0], each[2]))


def completed_modes(messages: list[dict[str, Any]]) -> list[int]:
    """Completed modes in order; a landing is repeated until the vehicle is disarmed, and counts once."""
    return [state for state, _ in itertools.groupby(message["nav_state"] for message in messages)]


def recorded_completed_modes(dialogue: Dialogue) -> list[int]:
    """Completed modes in order, as PX4 published them."""
    return completed_modes([message["fields"] for message in _received(dialogue, MODE_COMPLETED)])


def recorded_modes(dialogue: Dialogue) -> list[dict[str, Any]]:
    """AVAILABLE_MODES as PX4 sent them: one recording has all entries, the others have entries 18 to 25."""
    return [message["fields"] for message in dialogue["received"] if message.get("msg") == "AVAILABLE_MODES"]


def compare(
    player: Ros2DialoguePlayer,
    dialogue: Dialogue,
    *,
    until_s: float = math.inf,
    ignored: frozenset[str] = frozenset(),
) -> list[str]:
    """Descriptions of the differences between the messages of PX4 and of the simulated vehicle.

    Args:
        until_s: the times of changes are compared until this time of the recording.
        ignored: fields that are not compared.
    """
    found: list[str] = []
    for topic in EVENT_FIELDS:
        simulated, recorded = player.events(topic), recorded_events(dialogue, topic)
        if topic == FORMAT_RESPONSE:
            simulated, recorded = map(_without_unset_fields, (simulated, recorded))
        if dialogue.get("received_total"):  # a part of a long recording
            rest = iter(simulated)
            if not all(each in rest for each in recorded):
                found.append(f"{topic}: {recorded} are not among {simulated}")
        elif simulated != recorded:
            found.append(f"{topic}: {simulated}, recorded {recorded}")
    for topic, names in ((VEHICLE_STATUS, STATE_FIELDS), (FAILSAFE_FLAGS, FLAG_FIELDS)):
        for name in (each for each in names if each not in ignored):
            simulated, recorded = player.changes(topic, name), recorded_changes(dialogue, topic, name)
            if [value for _, value in simulated] != [value for _, value in recorded]:
                found.append(f"{name}: {simulated}, recorded {recorded}")
            times = [(a, b) for (a, _), (b, _) in zip(simulated, recorded, strict=False)]
            shifted = [(a, b) for a, b in times if abs(a - b) > TOLERANCE_S and b < until_s]
            if shifted:
                found.append(f"{name} changed at {shifted} (simulated, recorded)")
    simulated = bit_changes(player.changes(VEHICLE_STATUS, SELECTABLE_MODES))
    recorded = bit_changes(recorded_changes(dialogue, VEHICLE_STATUS, SELECTABLE_MODES))
    if [each[:2] for each in simulated] != [each[:2] for each in recorded]:
        found.append(f"{SELECTABLE_MODES}: {simulated}, recorded {recorded}")
    else:
        pairs = zip(simulated, recorded, strict=True)
        if any(abs(a[2] - b[2]) > TOLERANCE_S and b[2] < until_s for a, b in pairs):
            found.append(f"{SELECTABLE_MODES} changed at {simulated}, recorded {recorded}")
    simulated, recorded = _simulated_masks(player, dialogue), recorded_masks(dialogue)
    if simulated != recorded:
        found.append(f"{MASK}: {simulated}, recorded {recorded}")
    simulated = completed_modes(player.vehicle.all_fields(MODE_COMPLETED, player.began_s))
    recorded = recorded_completed_modes(dialogue)
    if simulated != recorded:
        found.append(f"{MODE_COMPLETED}: {simulated}, recorded {recorded}")
    if _recorded_entries(player.modes, dialogue) != _recorded_entries(recorded_modes(dialogue), dialogue):
        found.append("AVAILABLE_MODES")
    return found


def _without_unset_fields(responses: list[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
    """PX4 leaves fields of a response unset if it does not know the topic or the protocol."""
    return [each if each[1] else (each[1], each[3]) for each in responses]


def recorded_masks(dialogue: Dialogue) -> list[int]:
    """The registrations that the recorded requests name as valid, without repetitions; v1.16 has none."""
    fields = [each["fields"] for each in _received(dialogue, CHECK_REQUEST)]
    return [key for key, _ in itertools.groupby(each[MASK] for each in fields if MASK in each)]


def _simulated_masks(player: Ros2DialoguePlayer, dialogue: Dialogue) -> list[int]:
    last_s = max((at_s for at_s, _ in _requests(dialogue)), default=0.0)
    masks = [
        fields[MASK]
        for at_s, topic, fields in player.vehicle.received_messages
        if topic == CHECK_REQUEST and MASK in fields and 0.0 < at_s - player.began_s < last_s + 0.1
    ]
    return [key for key, _ in itertools.groupby(masks)]


def _recorded_entries(modes: list[dict[str, Any]], dialogue: Dialogue) -> list[list[Any]]:
    """The compared fields of those AVAILABLE_MODES entries that were recorded."""
    recorded = {mode["mode_index"] for mode in recorded_modes(dialogue)}
    names = ("mode_index", "custom_mode", "properties", "mode_name")
    return [[mode[name] for name in names] for mode in modes if mode["mode_index"] in recorded]
