"""Plays recorded dialogues to a simulated vehicle on a fake clock and collects what it answers."""

from __future__ import annotations

import itertools
import json
import math
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vehicle_sim.autopilot.announcer import Announcer, Event, StatusText
from vehicle_sim.autopilot.health import Report, announce
from vehicle_sim.fleet import VehicleSim
from vehicle_sim.mavlink.dialect import BY_NAME, LAYOUTS, pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.mavlink.rates import API

Dialogue = dict[str, Any]
TICK_S = 0.02
STREAM_EVERY_S = 0.05
STATE_SAMPLED_S = 1.1
"""The recordings took the state afterwards from messages at 1 Hz."""
HOLD, OFFBOARD = 0x3040000, 0x60000
NAN = math.nan

STATE_MESSAGES = frozenset(
    {"HEARTBEAT", "CURRENT_MODE", "EXTENDED_SYS_STATE", "MISSION_CURRENT", "GIMBAL_MANAGER_STATUS",
     "HOME_POSITION", "GIMBAL_DEVICE_ATTITUDE_STATUS"}
)  # fmt: skip
"""The recordings keep these when their content changed."""
LISTED_STREAMS = {"timesync": "TIMESYNC", "current_event_sequence": "CURRENT_EVENT_SEQUENCE"}
"""Streams that are part of the dialogues of these names."""
TELEMETRY = (frozenset(API) | {"SYSTEM_TIME"}) - STATE_MESSAGES - {"ORBIT_EXECUTION_STATUS"}
AIR_MISSION: list[dict[str, Any]] = [
    {"seq": n, "frame": frame, "command": command, "current": n == 0, "autocontinue": 1, "param4": math.nan,
     "x": x, "y": y, "z": z, "mission_type": 0}
    for n, (frame, command, x, y, z) in enumerate(
        ((6, 22, 473977420, 85455940, 10.0), (6, 16, 473979220, 85455940, 10.0),
         (6, 16, 473979220, 85458600, 12.0), (2, 20, 0, 0, 0.0))
    )
]  # fmt: skip
"""The recorded vehicle carried some mission in these groups: here up, two waypoints, back."""
ECHOES = ("POSITION_TARGET_LOCAL_NED", "ATTITUDE_TARGET", "LOCAL_POSITION_NED")
REQUESTED_MODES = {
    "altctl": (2, 0), "acro": (5, 0), "offboard": (6, 0), "mission": (4, 4), "rtl": (4, 5), "land": (4, 6),
    "takeoff": (4, 2), "termination": (10, 0), "orbit": (3, 1), "follow": (4, 8), "precland": (4, 9),
    "manual": (1, 0), "posctl": (3, 0), "stabilized": (7, 0), "hold": (4, 3),
}  # fmt: skip
GO_ON = ("in fact armed", "commanded", "running", "sent while", "timed out just before", "flying in RTL",
         "was sent for", "is still open", "battery draining")  # fmt: skip
"""Words of preconditions that only what came before can have made."""


@dataclass(frozen=True, slots=True)
class Heard:
    """One message of the vehicle; `dt_s` since the dialogue's first message."""

    dt_s: float
    name: str
    values: dict[str, Any]


@dataclass(slots=True)
class Answer:
    """What the simulator did in one dialogue."""

    heard: list[Heard] = field(default_factory=list)
    before: dict[str, Heard] = field(default_factory=list)  # type: ignore[arg-type]
    """Newest sample of each state message before the dialogue."""
    after: list[Heard] = field(default_factory=list)
    """State messages of the second after it: the recordings sampled some of them at 1 Hz."""
    set_before: frozenset[str] = frozenset()
    """Parameters that earlier dialogues set: PX4 sends those along that it has not saved yet."""
    reports: list[list[Heard]] = field(default_factory=list)
    """The arming reports that were true at some time: PX4 tells them by its own clock."""
    states: list[dict[str, Any]] = field(default_factory=list)
    """Armed, custom_mode and landed_state at times near the end."""
    echo: dict[str, dict[str, Any]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)


def load(path: Path) -> list[Dialogue]:
    """The dialogues of one group."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def sessions(folder: Path) -> Iterator[tuple[str, list[Dialogue]]]:
    """Groups, cut where the recording changed the vehicle: each began at a boot and kept its order."""
    for path in sorted(folder.glob("*.jsonl")):
        parts = itertools.groupby(load(path), key=lambda d: d.get("vehicle_system_id"))
        for number, (_, dialogues) in enumerate(parts):
            yield f"{path.stem}-{number}", list(dialogues)


def tells_of_logs(dialogues: list[Dialogue]) -> bool:
    """Whether something in a session is said of the onboard log, or asked of it."""
    return any(
        each["msg"].startswith("LOG_") or "logger" in json.dumps(each)
        for dialogue in dialogues
        for each in (*dialogue["send"], *dialogue["received"])
    )


def value_of(value: Any) -> Any:
    """A recorded value as Python has it."""
    if value is None:
        return NAN
    if value in ("inf", "-inf"):
        return float(value)
    return [value_of(each) for each in value] if isinstance(value, list) else value


class Vehicle:
    """One simulated vehicle and the station that talks to it."""

    def __init__(
        self, system_id: int, parameters: dict[str, float], *, heartbeats: bool = True, log: bool = False
    ) -> None:
        self.parameters = parameters
        self.heartbeats = heartbeats
        self.sim = VehicleSim(first_instance=system_id - 1, parameters=parameters, log=log)
        self.system_id = system_id
        self.autopilot = self.sim.autopilots[0]
        self.commander = self.autopilot.commander
        self.wanted = {layout.id for name, layout in BY_NAME.items() if name not in TELEMETRY - {"PING"}}
        self.log: list[tuple[float, str, str, dict[str, Any]]] = []
        self.last: dict[tuple[str, str], tuple[float, dict[str, Any]]] = {}
        self.reports: list[list[Heard]] = []
        """Arming reports that were true, each as it would be told, the newest last."""
        self._told: Report | None = None
        self.states: list[tuple[float, dict[str, Any]]] = []
        """Armed, mode and landed state, and when they became so."""
        self.counts: dict[int, int] = {}
        self._skip_unheard()
        self._parsers = {name: FrameParser() for name in ("gcs", "api")}
        self._sequence = 0
        self._beat_s = 0.0
        self.background: dict[str, Any] | None = None
        """Set points streamed besides what a dialogue sends."""
        self._stream_s = 0.0

    @property
    def now_s(self) -> float:
        return self.sim.time_s

    @property
    def height_m(self) -> float:
        return -float(self.sim.simulation.truth.position_ned_m[0, 2])

    @property
    def speed_m_s(self) -> float:
        return math.sqrt(sum(v * v for v in self.sim.simulation.truth.velocity_ned_m_s[0].tolist()))

    def _skip_unheard(self) -> None:
        """Streams that no dialogue looks at are not built: they are most of the work."""
        telemetry = self.sim.nodes[0].context.telemetry
        build = telemetry.payload
        telemetry.payload = lambda msg_id: build(msg_id) if msg_id in self.wanted else None  # type: ignore[method-assign]

    def send(self, name: str, fields: dict[str, Any], via: str = "gcs", src: tuple[int, int] = (255, 190)):
        layout, payload = pack(name, **fields)
        self._sequence = (self._sequence + 1) & 0xFF
        self.sim.feed(0, via, frame_v2(layout, payload, self._sequence, *src))

    def command(self, number: int, *values: float) -> None:
        fields = {f"param{n + 1}": value for n, value in enumerate(values)}
        fields |= {"target_system": self.system_id, "target_component": 1, "command": number}
        self.send("COMMAND_LONG", fields)

    def set_parameter(self, name: str, value: float) -> None:
        """PARAM_SET in the form the parameter's type asks for."""
        integer = self.sim.simulation.parameters[0].type_of(name) == "INT32"
        raw = struct.pack("<i", int(value)) if integer else struct.pack("<f", value)
        fields = {"target_system": self.system_id, "target_component": 1, "param_id": name,
                  "param_value": struct.unpack("<f", raw)[0], "param_type": 6 if integer else 9}  # fmt: skip
        self.send("PARAM_SET", fields)

    def run_to(self, end_s: float, tick_s: float = TICK_S) -> None:
        while self.now_s < end_s - 1e-6:
            if self.heartbeats and self.now_s >= self._beat_s:
                self.send("HEARTBEAT", {"type": 6, "autopilot": 8, "mavlink_version": 3})
                self._beat_s = self.now_s + 1.0
            if self.background is not None and self.now_s >= self._stream_s:
                self.send("SET_POSITION_TARGET_LOCAL_NED", self.background, "api")
                self._stream_s = self.now_s + STREAM_EVERY_S
            self.sim.step(min(tick_s, max(end_s - self.now_s, 0.004)))
            self.collect()

    def run(self, seconds: float, each: Callable[[], None] | None = None, tick_s: float = TICK_S) -> None:
        end_s = self.now_s + seconds
        if each is None:
            self.run_to(end_s)
            return
        while self.now_s < end_s - 1e-6:
            each()
            self.run_to(min(end_s, self.now_s + tick_s), min(tick_s, TICK_S))

    def run_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        end_s = self.now_s + timeout_s
        while not condition() and self.now_s < end_s:
            self.run(0.1)
        return condition()

    def collect(self) -> None:
        state = self.state()
        if not self.states or state != self.states[-1][1]:
            self.states.append((self.now_s, state))
        report = self.commander.report
        if report is not self._told and report != self._told:
            self._told = report
            self.reports.append(_as_told(report))
        for via, parser in self._parsers.items():
            for frame in self.sim.frames(0, via):
                msg_id = frame[7] | frame[8] << 8 | frame[9] << 16
                if via == "gcs":
                    self.counts[msg_id] = self.counts.get(msg_id, 0) + 1
                if msg_id not in self.wanted:
                    continue
                for message in parser.feed(frame):
                    if (message.system_id, message.component_id) == (self.system_id, 1):
                        self._note(via, message.name, message.values)

    def _note(self, via: str, name: str, values: dict[str, Any]) -> None:
        self.log.append((self.now_s, via, name, values))
        self.last[via, name] = self.now_s, values

    def state(self) -> dict[str, Any]:
        commander = self.commander
        return {
            "armed": commander.armed,
            "custom_mode": commander.custom_mode(),
            "landed_state": int(commander.landed_state()),
        }

    def ready(self) -> bool:
        return self.commander.report.armable(self.commander.intended)

    # --- starting states -------------------------------------------------------------------------------

    def fly(self) -> None:
        """To Hold at 10 m, from wherever it is."""
        if not self.commander.armed:
            self.run_until(self.ready, 15)
            self.command(176, 1, 4, 3)
            self.run(0.1)
            self.command(400, 1)
            self.run(0.1)
            self.command(22, -1, 0, 0, NAN, NAN, NAN, self.autopilot.home.alt_amsl_m + 10)
            self.run_until(lambda: self.state()["custom_mode"] == HOLD and self.height_m > 8.5, 40)
            self.run(3.0)
        elif self.state()["custom_mode"] != HOLD:
            self.command(176, 1, 4, 3)
            self.run(0.4)
        self.run_until(lambda: self.speed_m_s < 1.0, 8)

    def offboard(self) -> None:
        """To Offboard at 10 m, with a stream of set points."""
        if not 6 < self.height_m < 16:
            self.fly()
        self.stream(True)
        self.run(0.6)
        self.command(176, 1, 6)
        self.run(1.0)
        self.stream(False)

    def stream(self, on: bool) -> None:
        """A position 10 m up at 20 Hz."""
        self.background = {"target_system": self.system_id, "target_component": 1, "coordinate_frame": 1,
                           "type_mask": 2552, "z": -10.0} if on else None  # fmt: skip

    def ground(self, armed: bool, custom_mode: int) -> None:
        """On the ground: armed or not, in a mode."""
        if self.commander.armed != armed or (armed and self.state()["custom_mode"] != custom_mode):
            self.command(400, 0, 21196)
            self.run(0.1)
        self.run_until(self.ready, 4)
        if armed and not self.commander.armed:
            self.command(176, 1, 4, 3)
            self.run(0.1)
            self.command(400, 1)
            self.run(0.1)
        if self.state()["custom_mode"] != custom_mode:
            self.command(176, 1, custom_mode >> 16 & 0xFF, custom_mode >> 24)
            self.run(0.2)


SUMMARY, HEALTH = 27825120, 18691879
"""Event ids that open and close an arming report."""


class Player:
    """Replays one session in its order, on a new vehicle where the old one cannot be brought back."""

    def __init__(self, listen: tuple[str, ...] = (), *, log: bool = False) -> None:
        self._vehicle: Vehicle | None = None
        self._listen = listen
        """Streams to keep besides the usual."""
        self._log = log
        """Whether the vehicle writes onboard logs, which cost a seventh of a flight: `tells_of_logs`."""
        self._set_before: frozenset[str] = frozenset()
        self._cleared = False
        self._plan: list[dict[str, Any]] = []
        """The mission stored last, for a vehicle that has to be a new one."""

    @property
    def vehicle(self) -> Vehicle:
        """The one of the last dialogue."""
        assert self._vehicle is not None
        return self._vehicle

    def play(self, dialogue: Dialogue) -> Answer:
        """Bring about the starting state, send, listen."""
        vehicle = self._prepare(dialogue)
        words = dialogue["precondition"]
        if "with a 20 Hz position stream" in words:
            vehicle.stream(True)
            vehicle.run(0.3)
            vehicle.command(176, 1, 6)
            vehicle.run(0.2)
        else:
            vehicle.stream(False)
        changed = {} if _boots(words) or _sends(dialogue, "PARAM_SET") else _parameters(words)
        store = vehicle.sim.simulation.parameters[0]
        kept = {name: store.get(name) for name in changed if name in store}
        for name in kept:
            vehicle.set_parameter(name, changed[name])
        if kept:
            vehicle.stream(vehicle.state()["custom_mode"] == OFFBOARD)
            vehicle.run(2.5)
            vehicle.stream(False)
        kept = {name: value for name, value in kept.items() if not name.startswith("SIM_BAT_")}
        said = re.findall(r"(\w+) set to \S+ \(default (\S+)\)", words)
        kept |= {name: float(text) for name, text in said}
        try:
            answer = self._exchange(vehicle, dialogue)
            now_set = {e["fields"]["param_id"] for e in dialogue["send"] if e["msg"] == "PARAM_SET"}
            answer.set_before = self._set_before - now_set
            self._set_before |= now_set
            self._cleared |= _sends(dialogue, "MISSION_CLEAR_ALL")
            self._plan = _stored(dialogue) or self._plan
            return answer
        finally:
            for name, value in kept.items():
                store.set(name, value)

    def _prepare(self, dialogue: Dialogue) -> Vehicle:
        words, state = dialogue["precondition"], dialogue["state"]
        boot = _parameters(words) if _boots(words) else {}
        vehicle = self._vehicle
        flying = state.get("landed_state", 1) != 1 or "flying" in words
        lost = vehicle is not None and (
            vehicle.commander.terminated
            or (not flying and vehicle.height_m > 1.0)
            or (flying and not vehicle.commander.armed and vehicle.height_m > 1.0)
            or (flying and vehicle.commander.armed and vehicle.height_m < 4.0)
        )
        goes_on = any(each in words for each in GO_ON)
        if vehicle is None or vehicle.parameters != boot or (lost and not goes_on) or "right after" in words:
            heartbeats = "no GCS heartbeat" not in words
            vehicle = self._vehicle = Vehicle(
                dialogue.get("vehicle_system_id") or 1, boot, heartbeats=heartbeats, log=self._log
            )
            vehicle.wanted |= {layout_id(name) for name in self._listen}
            vehicle.run(3.0)
            if "right after" in words:
                return vehicle
            if dialogue.get("group") in ("air", "fence") and not self._cleared:
                _upload(vehicle, AIR_MISSION)
            elif "stored" in words and self._plan:
                _upload(vehicle, self._plan)
            if "GPS_CTRL" not in words:
                vehicle.run_until(vehicle.ready, 15)
                vehicle.run(2.5)
            else:
                vehicle.run(12)
        _let_transfers_end(vehicle)
        if not goes_on:
            self._start(vehicle, dialogue)
        elif "3 s ago" in words:
            vehicle.run(0.95)
        if "stored" in words or "uploaded with" in words:
            _stock(vehicle, dialogue)
        return vehicle

    def _start(self, vehicle: Vehicle, dialogue: Dialogue) -> None:
        words, state = dialogue["precondition"], dialogue["state"]
        if "in Offboard at" in words:
            vehicle.offboard()
        elif "flying in Hold" in words:
            vehicle.fly()
        elif "armed on the ground, Hold" in words and not words.startswith("disarmed"):
            vehicle.ground(True, HOLD)
        else:
            asked = re.search(r"mode (\w+) requested", words)
            chosen = "Manual mode chosen" in words
            vehicle.ground(state["armed"], HOLD if asked or "Hold mode" in words else state["custom_mode"])
            if asked or chosen:
                main, sub = REQUESTED_MODES[asked.group(1)] if asked else (1, 0)
                vehicle.command(176, 1, main, sub)
                vehicle.run(0.6)
        gimbal = vehicle.autopilot.gimbal
        for owner in ((255, 190), (42, 99), (7, 8)):
            if f"{owner[0]}/{owner[1]} in control" in words or f"{owner[0]}/{owner[1]} primary" in words:
                gimbal.primary = owner
        if "nobody in control" in words:
            gimbal.primary = (0, 0)

    def _exchange(self, vehicle: Vehicle, dialogue: Dialogue) -> Answer:
        start_s, window_s = vehicle.now_s, dialogue["window_s"]
        vehicle.log.clear()
        vehicle.counts.clear()
        del vehicle.reports[:-1]
        via = dialogue["link"]
        extra = requested(dialogue) | {layout_id(name) for name in ECHOES if "echo_at_end" in dialogue}
        extra -= vehicle.wanted
        vehicle.wanted |= extra
        before = {
            name: Heard(0.0, name, vehicle.last[via, name][1])
            for name in STATE_MESSAGES
            if (via, name) in vehicle.last
        }
        for dt_s, link, name, fields, src in _script(dialogue, vehicle.system_id):
            if start_s + dt_s > vehicle.now_s + 0.006:
                vehicle.run_to(start_s + dt_s)
            if name == "REQUEST_EVENT" and any(e["msg"] == "EVENT" for e in dialogue["received"]):
                back = fields["last_sequence"] - fields["first_sequence"]
                newest = vehicle.autopilot.announcer.sequence
                fields = fields | {"first_sequence": newest - back, "last_sequence": newest}
            vehicle.send(name, fields, link, src)
        answer = Answer(before=before)
        vehicle.run_to(start_s + window_s)
        late_s = vehicle.now_s - STATE_SAMPLED_S
        earlier = [state for at_s, state in vehicle.states if at_s <= late_s]
        answer.states = earlier[-1:] + [state for at_s, state in vehicle.states if at_s > late_s]
        answer.reports = list(vehicle.reports)
        answer.counts = {LAYOUTS[i].name: n for i, n in vehicle.counts.items() if i in LAYOUTS}
        for name in ECHOES if "echo_at_end" in dialogue else ():
            if ("gcs", name) in vehicle.last:
                answer.echo[name] = vehicle.last["gcs", name][1]
        answer.heard = [
            Heard(t - start_s, n, v)
            for t, link, n, v in vehicle.log
            if link == via and (n != "PING" or v["target_system"] != 0)
        ]
        if any(each["msg"] in STATE_MESSAGES for each in dialogue["received"]):
            mark = len(vehicle.log)
            vehicle.run(2.1)
            answer.after = [
                Heard(t - start_s, n, v)
                for t, link, n, v in vehicle.log[mark:]
                if link == via and n in STATE_MESSAGES
            ]
        vehicle.wanted -= extra
        return answer


def _as_told(report: Report) -> list[Heard]:
    announcer, told = Announcer(lambda: 0), list[Heard]()

    def hear(item: StatusText | Event) -> None:
        if isinstance(item, Event):
            values = {"id": item.id, "log_levels": item.log_levels, "arguments": item.arguments}
            told.append(Heard(0.0, "EVENT", values))

    announcer.add_listener(hear)
    announce(report, announcer)
    return told


def _let_transfers_end(vehicle: Vehicle) -> None:
    """What the dialogue before left unfinished asks on for some seconds, which the recording waited for."""
    for _ in range(12):
        asked = [
            vehicle.last.get(("gcs", name), (-9.0,))[0] for name in ("MISSION_REQUEST_INT", "MISSION_REQUEST")
        ]
        if vehicle.now_s - max(asked) > 0.4:
            return
        vehicle.run(0.5)


def _stock(vehicle: Vehicle, dialogue: Dialogue) -> None:
    """Upload the plan that the recording downloads, where it is not the one left by the dialogue before."""
    counts = [e["fields"] for e in dialogue["received"] if e["msg"] == "MISSION_COUNT"]
    plan = [e["fields"] for e in dialogue["received"] if e["msg"] == "MISSION_ITEM_INT"]
    if not counts or len(plan) != counts[0]["count"]:
        return
    _upload(vehicle, plan, floats="floats" in dialogue["precondition"])
    vehicle.run(2.5)


def _stored(dialogue: Dialogue) -> list[dict[str, Any]]:
    """The mission that a dialogue uploads, where PX4 took it."""
    items = {e["fields"]["seq"]: e["fields"] for e in dialogue["send"] if e["msg"] == "MISSION_ITEM_INT"}
    took = any(e["msg"] == "MISSION_ACK" and e["fields"]["type"] == 0 for e in dialogue["received"])
    mission = [items[seq] for seq in sorted(items)]
    whole = [item["seq"] for item in mission] == list(range(len(mission)))
    return mission if took and whole and mission and mission[0]["mission_type"] == 0 else []


def _upload(vehicle: Vehicle, plan: list[dict[str, Any]], *, floats: bool = False) -> None:
    kind = plan[0]["mission_type"]
    target = {"target_system": vehicle.system_id, "target_component": 1, "mission_type": kind}
    vehicle.send("MISSION_COUNT", {"count": len(plan), **target})
    for item in plan:
        fields = {key: value_of(value) for key, value in item.items() if key != "target_system"}
        if floats:
            frame = {6: 3, 5: 0}.get(fields["frame"], fields["frame"])
            fields |= {"x": fields["x"] / 1e7, "y": fields["y"] / 1e7, "frame": frame}
        vehicle.send("MISSION_ITEM" if floats else "MISSION_ITEM_INT", fields | target)


def layout_id(name: str) -> int:
    """The number of a message."""
    return BY_NAME[name].id


def requested(dialogue: Dialogue) -> set[int]:
    """Ids of telemetry that is part of this dialogue: asked for by it, or listed by the recording."""
    ids = {
        int(entry["fields"]["param1"] or 0)
        for entry in dialogue["send"]
        if entry["msg"] == "COMMAND_LONG" and entry["fields"]["command"] == 512
    }
    ids |= {layout_id(name) for start, name in LISTED_STREAMS.items() if dialogue["id"].startswith(start)}
    return {msg_id for msg_id in ids if msg_id in LAYOUTS}


def _sends(dialogue: Dialogue, name: str) -> bool:
    return any(entry["msg"] == name for entry in dialogue["send"])


def _boots(words: str) -> bool:
    return "fresh boot" in words or "MNT_MODE_IN -1" in words


def _parameters(words: str) -> dict[str, float]:
    found = re.findall(r"\b([A-Z][A-Z0-9]*_[A-Z0-9_]+)(?: set to |=| )(-?\d+(?:\.\d+)?)", words)
    return {name: float(value) if "." in value else int(value) for name, value in found}


Sending = tuple[float, str, str, dict[str, Any], tuple[int, int]]


def _script(dialogue: Dialogue, system_id: int) -> list[Sending]:
    out: list[Sending] = []
    for entry in dialogue["send"]:
        if entry["msg"] not in BY_NAME:
            continue  # "stream stops"
        fields = {k: value_of(v) for k, v in entry["fields"].items()}
        fields = _wire(entry["msg"], fields, system_id)
        source = entry.get("src", (255, 190))
        link = entry.get("link", dialogue["link"])
        hz, duration_s = entry.get("streamed_hz", 0), entry.get("duration_s", 0)
        said = re.search(rf"{entry['msg']} .* at (\d+) Hz for (\d+) s", dialogue.get("note", ""))
        if said and entry is dialogue["send"][-1]:
            hz, duration_s = float(said.group(1)), float(said.group(2)) - entry["dt_s"]
        count = max(1, round(hz * duration_s))
        for n in range(count):
            dt_s = entry["dt_s"] + (n / hz if count > 1 else 0.0)
            out.append((dt_s, link, entry["msg"], fields, (source[0], source[1])))
    return sorted(out, key=lambda each: each[0])


def _wire(name: str, fields: dict[str, Any], system_id: int) -> dict[str, Any]:
    """Recorded fields in the form the dialect packs; set points without a target are for the vehicle."""
    if "target_system" in BY_NAME[name].fields:
        fields = {"target_system": system_id, "target_component": 1} | fields
    if name == "PARAM_SET" and ("int_value" in fields or fields.get("value") is not None):
        integer = fields.get("int_value", fields.get("value"))
        if isinstance(integer, int):
            fields["param_value"] = struct.unpack("<f", struct.pack("<I", integer & 0xFFFFFFFF))[0]
            fields.setdefault("param_type", 6)
        else:
            fields["param_value"], fields["param_type"] = integer, 9
    if name == "FILE_TRANSFER_PROTOCOL":
        p = fields["payload"]
        head = struct.pack(
            "<HBBBBBBI", p["seq_number"], p["session"], p["opcode"], p["size"], p["req_opcode"],
            p["burst_complete"], p["padding"], p["offset"],
        )  # fmt: skip
        fields["payload"] = list((head + bytes.fromhex(p["data_hex"])).ljust(251, b"\0"))
    if name == "SERIAL_CONTROL" and "text" in fields:
        raw = fields["text"].encode()
        fields["count"] = fields.get("count", len(raw))
        fields["data"] = list(raw.ljust(70, b"\0"))
    return {key: value for key, value in fields.items() if key in BY_NAME[name].fields}
