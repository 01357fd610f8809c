"""Replays what a real PX4 does with plans (`px4/items`) to a simulated vehicle, on simulated time.

The recording machine was overloaded: messages came late and were sent twice. So the replay does not repeat
the recorded times of an upload: it answers each request of the vehicle with the recorded item. Messages after
an upload follow its acknowledgement after the recorded time.
"""

from __future__ import annotations

import csv
import itertools
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.contract.compare import EVENT_NAMES, same
from tests.contract.recordings import METRE_EAST_E7, METRE_NORTH_E7, Dialogue, parameters_in, python_value
from tests.contract.replay_vehicle import DO_SET_MODE, HOLD_CUSTOM_MODE, NAN, Received, Vehicle

Fields = dict[str, Any]
EXPLAINED_FILE = Path(__file__).resolve().parent / "explained_plans.tsv"
TARGET = {"target_system": 1, "target_component": 1}
HOME_E7 = (473977420, 85455940)
CANCELLED, MISSION_TYPE_ALL = 15, 255
STEP_S = 0.004
SLOW_AFTER_S = 5.0
STATE_SAMPLE_PERIOD_S = 1.1
ANSWER_WITHIN_S = 6.5
"""Longer than PX4's timeout of a transfer."""
TOLD_WITHIN_S = 0.33
"""The recording of an item lists what PX4 said within this time after its acknowledgement, and during the
download."""
PATTERNS = {
    "middle": "TW.WL", "first": ".TWL", "last": "TWL.", "alone": ".", "first_no_takeoff": ".WL",
    "last_no_land": "TW.",
}  # fmt: skip
"""The missions of items.jsonl: T take-off, W waypoint, L landing, and . the recorded item."""
PLACES_M = {"T": (0, 0), "L": (40, 20)}
"""North and east of home; the waypoints are at 20 m north, and at 40 m north and 10 m east."""
COMMANDS = {"T": 22, "W": 16, "L": 21}
ITEM_NAMES = ("MISSION_ITEM", "MISSION_ITEM_INT")
NOT_COMPARED_TEXTS = ("Preflight", "[logger]", "RTL: unsupported", "Mission download request ignored")
NOT_COMPARED_EVENTS = (
    "check_", "logger_", "commander_health", "commander_arming", "rtl_unsupported",
    "mavlink_mission_req_ignored",
)  # fmt: skip
"""The check of the whole vehicle, the log, rally points of earlier dialogues (every two seconds), and the
recording's own downloads."""
EVENT_LAYOUTS = {
    "navigator_mis_unsup_cmd": "<HH", "navigator_mis_takeoff_too_low": "<f", "commander_armed_by": "<B",
    "commander_disarmed_by": "<B", "mission_climb_before_start": "<f",
}  # fmt: skip
EVENT_TOLERANCES_M = {"navigator_mis_takeoff_too_low": 2.0, "mission_climb_before_start": 0.5}
"""The altitude of home has noise."""


@dataclass(slots=True)
class Answer:
    """What a vehicle did with a plan; compared field by field."""

    acks: list[Any] = field(default_factory=list[Any])
    requests: list[str] = field(default_factory=list[str])
    """I for MISSION_REQUEST_INT, F for MISSION_REQUEST, and the item's number; repeats of a request once."""
    told: list[str] = field(default_factory=list[str])
    """Texts and events, without those about the check of the whole vehicle."""
    arguments: dict[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])
    own_commands: list[Any] = field(default_factory=list[Any])
    reached: list[int] = field(default_factory=list[int])
    current: Any = None
    state: Fields = field(default_factory=dict[str, Any])
    stored: list[Fields] | None = None
    stored_id: int | None = None


# --- one item -----------------------------------------------------------------------------------------------


def mission_of(case: Fields) -> list[Fields]:
    """The mission that contains the recorded item."""
    waypoints = iter([(20, 0), (40, 10)])
    as_float = case["msg"] == "MISSION_ITEM"
    items: list[Fields] = []
    for seq, kind in enumerate(PATTERNS[case["mission"]]):
        if kind == ".":
            items.append({key: python_value(value) for key, value in case["item"].items()})
            continue
        north_m, east_m = next(waypoints) if kind == "W" else PLACES_M[kind]
        x, y = round(HOME_E7[0] + north_m * METRE_NORTH_E7), round(HOME_E7[1] + east_m * METRE_EAST_E7)
        items.append({
            "seq": seq, "frame": 3 if as_float else 6, "command": COMMANDS[kind], "current": 0,
            "autocontinue": 1, "param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": NAN,
            "x": x / 1e7 if as_float else x, "y": y / 1e7 if as_float else y,
            "z": 0.0 if kind == "L" else case["altitude_other_items"], "mission_type": 0,
        })  # fmt: skip
    return items


def item_differences(vehicle: Vehicle, case: Fields) -> list[str]:
    """Uploads and downloads the mission of a recorded item; the differences from PX4."""
    items, name = mission_of(case), case["msg"]
    vehicle.log.clear()
    ack = upload(vehicle, items, name)
    vehicle.run(TOLD_WITHIN_S)
    answer = answer_of(received(vehicle))
    recorded = [
        *(Received(each["dt_s"], "STATUSTEXT", {"text": each["text"]}) for each in case["texts"]),
        *(Received(each["dt_s"], "EVENT", {"decoded": each}) for each in case["events"]),
    ]
    expected = answer_of(recorded)
    expected.acks = [_ack_row(case["ack"])]
    expected.requests = _without_repeats(case["requests"])
    answer.acks = [_ack_row(ack)]
    if "downloaded" in case:
        changes = {each["seq"]: each for each in case["other_items_changed"]}
        expected.stored = [_changed(item, changes.get(item["seq"], {})) for item in items]
        expected.stored[case["item_seq"]] = {key: python_value(v) for key, v in case["downloaded"].items()}
        expected.stored_id = case["count_opaque_id"]
        answer.stored, answer.stored_id = download(vehicle, as_float=name == "MISSION_ITEM")
    elif ack is not None:
        end_transfer(vehicle, items)
    return differences(expected, answer)


def end_transfer(vehicle: Vehicle, items: list[Fields]) -> None:
    """Cancels a refused upload. After items of "all" types the recording cleared the mission."""
    vehicle.send("MISSION_ACK", {"type": CANCELLED, **TARGET})
    if any(item["mission_type"] == MISSION_TYPE_ALL for item in items):
        vehicle.send("MISSION_CLEAR_ALL", {"mission_type": 0, **TARGET})
    vehicle.run(0.02)


def _changed(item: Fields, change: Fields) -> Fields:
    return item | {key: python_value(value[1]) for key, value in change.items() if key != "seq"}


# --- transfers ----------------------------------------------------------------------------------------------


def upload(vehicle: Vehicle, items: list[Fields], name: str = "MISSION_ITEM_INT") -> Fields | None:
    """Uploads items as the vehicle requests them; the acknowledgement, None: none."""
    types = [item["mission_type"] for item in items]
    mission_type = max(set(types), key=types.count)  # one item may have a wrong type
    return _exchange(vehicle, items, name, {"count": len(items), "mission_type": mission_type, **TARGET})


def _exchange(
    vehicle: Vehicle, items: list[Fields], name: str, count_fields: Fields, answered: int | None = None
) -> Fields | None:
    """Uploads items.

    Args:
        vehicle: the vehicle.
        items: the items.
        name: MISSION_ITEM or MISSION_ITEM_INT.
        count_fields: fields of MISSION_COUNT.
        answered: number of requests that are answered; None: all.

    Returns:
        The acknowledgement; None: none within `ANSWER_WITHIN_S`, or not all requests are answered.
    """
    seen = len(vehicle.log)
    vehicle.send("MISSION_COUNT", count_fields)
    end_s, next_seq = vehicle.now_s + ANSWER_WITHIN_S, 0
    while vehicle.now_s < end_s:
        for _, link, message, fields in vehicle.log[seen:]:
            if link != "gcs":
                continue
            if message == "MISSION_ACK":
                return fields
            if message.startswith("MISSION_REQUEST") and fields["seq"] == next_seq:
                if answered is not None and next_seq >= answered:
                    return None
                vehicle.send(name, items[next_seq] | TARGET)
                next_seq += 1
        seen = len(vehicle.log)
        vehicle.run_to(vehicle.now_s + STEP_S, STEP_S)
    return None


def download(
    vehicle: Vehicle, mission_type: int = 0, *, as_float: bool = False
) -> tuple[list[Fields], int | None]:
    """The stored items, and the id of the plan."""
    seen, items, plan_id, count = len(vehicle.log), list[Fields](), None, None
    request = "MISSION_REQUEST" if as_float else "MISSION_REQUEST_INT"
    kind = {"mission_type": mission_type, **TARGET}
    vehicle.send("MISSION_REQUEST_LIST", kind)
    end_s = vehicle.now_s + ANSWER_WITHIN_S
    while vehicle.now_s < end_s and (count is None or len(items) < count):
        for _, link, message, fields in vehicle.log[seen:]:
            if link == "gcs" and message == "MISSION_COUNT":
                count, plan_id = fields["count"], fields["opaque_id"]
            elif link == "gcs" and message in ITEM_NAMES and fields["seq"] == len(items):
                items.append(fields)
            else:
                continue
            if len(items) < (count or 0):
                vehicle.send(request, {"seq": len(items), **kind})
        seen = len(vehicle.log)
        vehicle.run_to(vehicle.now_s + STEP_S, STEP_S)
    vehicle.send("MISSION_ACK", {"type": 0, **kind})
    vehicle.run(0.02)
    return items, plan_id


# --- dialogues ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Upload:
    """An upload in a dialogue; `items`: those that the recording contains, by number."""

    at_s: float
    count_fields: Fields
    items: dict[int, Fields]
    name: str
    recorded_ack_s: float | None

    @property
    def is_whole(self) -> bool:
        """Whether the recording contains every item."""
        return len(self.items) == self.count_fields["count"]


def steps_of(dialogue: Dialogue) -> Iterator[Upload | tuple[float, str, Fields]]:
    """The dialogue's uploads and its other messages, in order."""
    acks_s = iter([e["dt_s"] for e in dialogue["received"] if e["msg"] == "MISSION_ACK"])
    sends = dialogue["send"]
    for n, entry in enumerate(sends):
        fields = {key: python_value(value) for key, value in entry["fields"].items()}
        if entry["msg"] in ITEM_NAMES:
            continue
        if entry["msg"] != "MISSION_COUNT":
            if entry["msg"] == "MISSION_CLEAR_ALL":
                next(acks_s, None)
            yield entry["dt_s"], entry["msg"], fields
            continue
        rest = itertools.takewhile(lambda each: each["msg"] in ITEM_NAMES, sends[n + 1 :])
        items: dict[int, Fields] = {}
        name = "MISSION_ITEM_INT"
        for each in rest:
            name = each["msg"]
            items.setdefault(each["fields"]["seq"], {k: python_value(v) for k, v in each["fields"].items()})
        yield Upload(entry["dt_s"], fields, items, name, next(acks_s, None))


def new_vehicle() -> Vehicle:
    """A vehicle that has just booted and is ready to fly."""
    vehicle = Vehicle(1, {})
    vehicle.run(3.0)
    vehicle.run_until(vehicle.ready, 15)
    vehicle.run(2.5)
    return vehicle


def begins_on_ground(dialogue: Dialogue) -> bool:
    """Whether a dialogue begins on the ground."""
    return dialogue["state"]["landed_state"] == 1 and "in Mission" not in dialogue["precondition"].lower()


def dialogue_differences(vehicle: Vehicle, dialogue: Dialogue) -> list[str]:
    """Brings the vehicle to the starting state, replays a dialogue, and compares.

    A vehicle in flight cannot replay a dialogue that begins on the ground.
    """
    prepare(vehicle, dialogue)
    vehicle.log.clear()
    offset_s, is_exact = vehicle.now_s, True
    mission_type = 0
    for step in steps_of(dialogue):
        if not isinstance(step, Upload):
            at_s, name, fields = step
            vehicle.run_to(offset_s + at_s)
            vehicle.send(name, TARGET | fields)
            mission_type = fields.get("mission_type", mission_type)
            continue
        vehicle.run_to(offset_s + step.at_s)
        mission_type, count = step.count_fields["mission_type"], step.count_fields["count"]
        is_exact = is_exact and (step.is_whole or step.recorded_ack_s is None)
        is_broken = "broken" in dialogue["id"]
        answered = len(step.items) if is_broken else None
        items = _filled(step.items, count)
        ack = _exchange(vehicle, items, step.name, TARGET | step.count_fields, answered)
        if ack is not None and step.recorded_ack_s is not None:
            offset_s = vehicle.now_s - step.recorded_ack_s
    vehicle.run_to(offset_s + dialogue["window_s"])
    answer = answer_of(received(vehicle))
    mission = vehicle.autopilot.navigator.mission
    answer.current = mission.current if mission.count else 0, mission.count or 65535
    answer.state = state_at_end(vehicle, dialogue["state_after"])
    expected = answer_of([
        Received(e["dt_s"], e["msg"], {k: python_value(v) for k, v in e["fields"].items()} | _decoded(e))
        for e in dialogue["received"] if "link" not in e
    ])  # fmt: skip
    expected.state = {key: dialogue["state_after"].get(key) for key in answer.state}
    for each in (expected, answer):  # the kind of the first request is that of the dialogue before
        each.requests[:1] = [request[1:] for request in each.requests[:1]]
    if "received_total" in dialogue:  # the recording has the first and last messages
        answer.requests = [each for each in answer.requests if each in expected.requests]
    current = dialogue.get("mission_current_at_end")  # in other groups the mission of an earlier dialogue
    expected.current = None if current is None else (current["seq"], current["total"])
    if dialogue["window_s"] > SLOW_AFTER_S:
        _allow_slow_machine(expected, answer, received(vehicle), vehicle.states)
    if not is_exact:
        expected.acks = [row[:2] for row in expected.acks]
        answer.acks = [row[:2] for row in answer.acks]
    stored = dialogue.get("stored")
    if stored is not None and isinstance(stored.get("items"), list):
        as_float = any(item["msg"] == "MISSION_ITEM" for item in stored["items"])
        expected.stored = [{k: python_value(v) for k, v in item.items()} for item in stored["items"]]
        answer.stored, stored_id = download(vehicle, mission_type, as_float=as_float)
        if is_exact and (dialogue.get("ack") or {}).get("type") == 0:
            expected.stored_id, answer.stored_id = stored["opaque_id"], stored_id
        if len(answer.stored) == stored["count"] != len(expected.stored):  # the recording has first and last
            by_seq = {item["seq"]: item for item in answer.stored}
            answer.stored = [by_seq[item["seq"]] for item in expected.stored]
        if not is_exact:
            expected.stored = [{"seq": item["seq"]} for item in expected.stored]
    return differences(expected, answer)


def state_at_end(vehicle: Vehicle, recorded: Fields) -> Fields:
    """The state at the end. The recording sampled it at 1 Hz: each value of the last second counts."""
    from_s = vehicle.now_s - STATE_SAMPLE_PERIOD_S
    earlier = [state for at_s, state in vehicle.states if at_s <= from_s]
    recent = [state for at_s, state in vehicle.states if at_s > from_s]
    found = vehicle.state()
    for state in [*earlier[-1:], *recent]:
        found = {key: recorded[key] if state[key] == recorded.get(key) else found[key] for key in found}
    return found


def _allow_slow_machine(
    expected: Answer, answer: Answer, messages: list[Received], states: list[tuple[float, Fields]]
) -> None:
    """The recorded simulation ran slower than real time: in a long flight a vehicle may be further on."""
    answer.reached = answer.reached[: len(expected.reached)]
    currents = [(m.values["seq"], m.values["total"]) for m in messages if m.name == "MISSION_CURRENT"]
    if expected.current in currents:
        answer.current = expected.current
    begin_s = messages[0].dt_s
    if any(at_s >= begin_s and state == expected.state for at_s, state in states):
        answer.state = expected.state


def _decoded(entry: Fields) -> Fields:
    return {"decoded": entry["decoded"]} if "decoded" in entry else {}


# --- starting states ----------------------------------------------------------------------------------------

SEVEN_ITEMS = [22, 16, 178, 2000, 16, 177, 21]
SQUARE_M = ((0, 0), (12, 0), (12, 12), (0, 12), (0, 4))
"""Places of the plan "take-off, 3 waypoints, land", north and east of home."""


def square(alt_m: float) -> list[Fields]:
    """The plan "take-off, 3 waypoints, land"."""
    items = plan(22, 16, 16, 16, 21, alt_m=alt_m)
    for item, (north_m, east_m) in zip(items, SQUARE_M, strict=True):
        item["x"] = round(HOME_E7[0] + north_m * METRE_NORTH_E7)
        item["y"] = round(HOME_E7[1] + east_m * METRE_EAST_E7)
    return items


def plan(*commands: int, alt_m: float = 6.0, apart_m: float = 12.0) -> list[Fields]:
    """A mission to the north."""
    items: list[Fields] = []
    for seq, command in enumerate(commands):
        positioned = command in (16, 21, 22)
        items.append({
            "seq": seq, "frame": 6 if positioned else 2, "command": command, "current": int(seq == 0),
            "autocontinue": 1, "param1": 1.0 if command in (177, 178) else 0.0,
            "param2": 3.0 if command in (177, 178) else 0.0, "param4": NAN if positioned else 0.0,
            "x": round(HOME_E7[0] + seq * apart_m * METRE_NORTH_E7) if positioned else 0,
            "y": HOME_E7[1] if positioned else 0, "z": alt_m if command in (16, 22) else 0.0,
            "mission_type": 0,
        })  # fmt: skip
    return items


def prepare(vehicle: Vehicle, dialogue: Dialogue) -> None:
    """Brings the vehicle to the state in which a dialogue begins."""
    precondition, state = dialogue["precondition"], dialogue["state"]
    for parameter, value in ({"MIS_TKO_LAND_REQ": 0, "GF_ACTION": 2} | parameters_in(precondition)).items():
        if vehicle.sim.simulation.parameters[0].get(parameter) != value:
            vehicle.set_parameter(parameter, value)
    if "GF_ACTION" in precondition or "flying" in precondition:
        clear(vehicle, 1)
    vehicle.run(0.1)
    if "stored" in dialogue and dialogue["group"] != "mission_state":
        _store_earlier_plan(vehicle, dialogue)
    if dialogue["group"] == "mission_state":
        _prepare_mission(vehicle, dialogue)
    if state["landed_state"] == 1:
        if vehicle.commander.armed != state["armed"] or not vehicle.commander.landed:
            vehicle.put_on_ground(state["armed"], HOLD_CUSTOM_MODE)
        if vehicle.state()["custom_mode"] != state["custom_mode"]:
            vehicle.command(DO_SET_MODE, 1, state["custom_mode"] >> 16 & 0xFF, state["custom_mode"] >> 24)
    elif "flying in Hold" in precondition:
        if vehicle.commander.landed:
            vehicle.put_on_ground(False, HOLD_CUSTOM_MODE)
        vehicle.hover_in_hold()
    if "current item 4 set before" in precondition:
        vehicle.send("MISSION_SET_CURRENT", {"seq": 4, **TARGET})
    if precondition.startswith("armed on the ground") and not state["armed"]:
        vehicle.put_on_ground(True, HOLD_CUSTOM_MODE)  # the state was sampled before the arming
    vehicle.run(1.2)


def _store_earlier_plan(vehicle: Vehicle, dialogue: Dialogue) -> None:
    """Stores the plan that a refused or broken upload does not replace."""
    accepted = (dialogue.get("ack") or {}).get("type") == 0
    items = dialogue["stored"].get("items")
    if accepted or not isinstance(items, list) or not items:
        return
    mission_type = next(e["fields"]["mission_type"] for e in dialogue["send"])
    known = {item["seq"]: {k: python_value(v) for k, v in item.items() if k != "msg"} for item in items}
    whole = [item | {"mission_type": mission_type} for item in _filled(known, dialogue["stored"]["count"])]
    upload(vehicle, whole)
    vehicle.run(0.1)


def _filled(known: dict[int, Fields], count: int) -> list[Fields]:
    """All items of a plan of which the recording has the first and last: the nearest one for the others."""
    if not known:
        return []
    return [known[min(known, key=lambda k: abs(k - seq))] | {"seq": seq} for seq in range(count)]


def _prepare_mission(vehicle: Vehicle, dialogue: Dialogue) -> None:
    precondition, name = dialogue["precondition"], dialogue["id"]
    uploads = [step for step in steps_of(dialogue) if isinstance(step, Upload)]
    if "in Mission" in precondition or "mission interrupted" in precondition:
        base = plan(22, 16, 16, 16, 16, 16, 21, alt_m=6.3, apart_m=15.0)
        if name == "reupload_flying_identical" and uploads:
            base = list(uploads[0].items.values())
        _fly_mission(vehicle, base, dialogue)
        return
    if not vehicle.commander.landed:
        vehicle.put_on_ground(False, HOLD_CUSTOM_MODE)
    clear(vehicle)
    if "first plan stored" in precondition:
        upload(vehicle, plan(22, 16, 16, 16, 21))
        if uploads and "identical" in name:
            clear(vehicle)
            upload(vehicle, [uploads[-1].items[seq] for seq in sorted(uploads[-1].items)])
    elif "speed, image" in precondition or ("same plan" in precondition and "command" in name):
        upload(vehicle, plan(*SEVEN_ITEMS))
    elif "no mission" not in precondition and "MIS_TKO" not in precondition:
        told = [e["decoded"] for e in dialogue["received"] if "decoded" in e]
        climbs_m = [each["args"]["arg0"] for each in told if each["name"] == "mission_climb_before_start"]
        other = "another" in precondition
        upload(vehicle, plan(22, 16, 16, 21) if other else square((climbs_m or [6.2])[0]))
    vehicle.run(0.3)


def _fly_mission(vehicle: Vehicle, items: list[Fields], dialogue: Dialogue) -> None:
    vehicle.hover_in_hold()
    clear(vehicle)
    upload(vehicle, items)
    before = dialogue.get("mission_current_before_upload") or dialogue.get("mission_current_at_end") or {}
    sets_current = any(e["msg"] in ("MISSION_SET_CURRENT", "MISSION_CLEAR_ALL") for e in dialogue["send"])
    current = 3 if sets_current else before["seq"]
    vehicle.send("MISSION_SET_CURRENT", {"seq": current - 1, **TARGET})
    vehicle.command(DO_SET_MODE, 1, 4, 4)
    vehicle.run_until(lambda: vehicle.autopilot.navigator.mission.current == current, 30)


def clear(vehicle: Vehicle, mission_type: int = 0) -> None:
    """Clears the mission, the fence or the rally points."""
    vehicle.send("MISSION_CLEAR_ALL", {"mission_type": mission_type, **TARGET})
    vehicle.run(0.1)


# --- comparison ---------------------------------------------------------------------------------------------


def received(vehicle: Vehicle) -> list[Received]:
    """The messages on the link of the ground station."""
    return [Received(at_s, name, values) for at_s, link, name, values in vehicle.log if link == "gcs"]


def answer_of(messages: list[Received]) -> Answer:
    """What the messages say."""
    answer = Answer()
    chunks = ""
    for message in messages:
        values = message.values
        match message.name:
            case "MISSION_ACK":
                answer.acks.append((values["type"], values["mission_type"], values["opaque_id"]))
            case "COMMAND_ACK":
                answer.acks.append((values["command"], values["result"]))
            case "MISSION_REQUEST" | "MISSION_REQUEST_INT":
                answer.requests.append(f"{'I' if message.name.endswith('INT') else 'F'}{values['seq']}")
            case "MISSION_ITEM_REACHED":
                answer.reached.append(values["seq"])
            case "MISSION_CURRENT":
                answer.current = values["seq"], values["total"]
            case "COMMAND_LONG" if values.get("confirmation") == 0:
                answer.own_commands.append((values["command"], repr(values["param1"])))
            case "STATUSTEXT":
                chunks += values["text"].rstrip("\0")
                if len(values["text"].rstrip("\0")) == 50:
                    continue
                if not chunks.startswith(NOT_COMPARED_TEXTS):
                    answer.told.append(re.sub(r"-?\d+\.\d", "…", chunks.strip()))
                chunks = ""
            case "EVENT":
                _take_event(answer, values)
            case _:
                pass
    answer.requests = _without_repeats(answer.requests)
    answer.reached = _without_repeats(answer.reached)
    # An item that arrived late was sent twice. PX4 v1.16.0 acknowledges DO_SET_MODE twice, the build of these
    # recordings once.
    answer.acks = [
        ack
        for n, ack in enumerate(answer.acks)
        if ack not in answer.acks[max(0, n - 1) : n] or (len(ack) == 2 and ack[0] != DO_SET_MODE)
    ]
    answer.told = sorted(answer.told)
    return answer


def _take_event(answer: Answer, values: Fields) -> None:
    decoded = values.get("decoded")
    name = decoded["name"] if decoded else str(EVENT_NAMES.get(values["id"], values["id"]))
    if name.startswith(NOT_COMPARED_EVENTS):
        return
    answer.told.append(name)
    if name not in EVENT_LAYOUTS:
        return
    if decoded:
        answer.arguments[name] = tuple(decoded["args"].values())
    else:
        answer.arguments[name] = struct.unpack_from(EVENT_LAYOUTS[name], bytes(values["arguments"]))


def _ack_row(ack: Fields | None) -> Any:
    return None if ack is None else (ack["type"], ack["opaque_id"])


def _without_repeats(values: list[Any]) -> list[Any]:
    return [value for value, _ in itertools.groupby(values)]


def differences(expected: Answer, answer: Answer) -> list[str]:
    """The differences as text: field, PX4, simulator."""
    rows: list[str] = []
    for name in ("acks", "requests", "told", "own_commands", "reached", "current", "state", "stored_id"):
        real, simulated = getattr(expected, name), getattr(answer, name)
        is_compared = name in ("told", "own_commands") or real not in (None, [])
        if is_compared and real != simulated:
            rows.append(f"{name}: {real} | {simulated}")
    for event, real in expected.arguments.items():
        simulated = answer.arguments.get(event, ())
        if not same(list(real), list(simulated), EVENT_TOLERANCES_M.get(event)):
            rows.append(f"arguments of {event}: {real} | {simulated}")
    if expected.stored is not None and answer.stored is not None:
        if len(expected.stored) != len(answer.stored):
            rows.append(f"stored: {len(expected.stored)} items | {len(answer.stored)}")
        for item, simulated in zip(expected.stored, answer.stored, strict=False):
            rows += [
                f"item {item['seq']} {key}: {value} | {simulated[key]}"
                for key, value in item.items()
                if key in simulated and not same(value, simulated[key])
            ]
    return rows


def explained() -> dict[str, str]:
    """The known differences: dialogue → reason."""
    with EXPLAINED_FILE.open(encoding="utf-8", newline="") as file:
        rows = csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
        next(rows)
        return {dialogue: reason for dialogue, reason in rows}
