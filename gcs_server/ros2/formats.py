"""The layout of each topic of a vehicle, as the vehicle itself names it.

PX4 changes messages from version to version, with or without a new number in the topic's name, and bytes of
another layout decode to wrong values. So the server asks PX4 for the hash of each topic's layout
(`message_format_request`, PX4's own check between it and ROS 2 programs), and uses a topic only if it knows
the layout with this hash. PX4 v1.14 and older cannot answer. No I/O and no clock: the caller passes the time.

PX4 wants the name without version, and loses some of several simultaneous requests: they are asked one after
the other.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from gcs_server.links.base import DdsAddress, UnusableTopic
from gcs_server.ros2.external_mode import (
    CHECK_REPLY,
    CHECK_REQUEST,
    COMPLETED,
    CONTROLLERS,
    OVERRIDES,
    REGISTER,
    REGISTER_REPLY,
    UNREGISTER,
)
from gcs_server.ros2.inspection import Announcement
from gcs_server.ros2.message_types import (
    LAYOUTS,
    MESSAGES,
    VERSIONS,
    MessageType,
    Values,
    convert,
    versions_of,
)
from gcs_server.ros2.mode_executor import COMMAND as EXECUTOR_COMMAND
from gcs_server.ros2.mode_executor import MODE_COMPLETED
from gcs_server.ros2.topics import COMMAND, COMMAND_ACK, STATUS, TIMESYNC, parse_topic, ros_message

REQUEST: Final = "/fmu/in/message_format_request"
RESPONSE: Final = "/fmu/out/message_format_response"
PROTOCOL_VERSION: Final = 1
REPEAT_S: Final = 0.3
"""Time without an answer after which a request is repeated [s]; PX4 answers within 35 ms."""
ATTEMPTS: Final = 6
"""Requests of one topic after which its answer counts as missing. The topic is asked again later."""
SLOW_REPEAT_S: Final = 2.0
"""Period of requests once an answer counts as missing [s]."""
SILENT_S, PROBE_EVERY_S = 3.0, 1.0
"""Time without a vehicle status after which the vehicle is asked again, because another one may be there, and
the period of these requests [s]."""
MAX_NAME: Final = 50
"""Longest name in a request [characters]."""


class Use(NamedTuple):
    """How the server uses a topic."""

    type: str
    lost: str
    """The data or function that is not available without the topic."""


_MODES: Final = "flight modes of missions"
USED: Final[Mapping[str, Use]] = {
    STATUS: Use("VehicleStatus", "all data and commands of this vehicle"),
    "/fmu/out/home_position": Use("HomePosition", "home position"),
    TIMESYNC: Use("TimesyncStatus", "time since boot"),
    COMMAND: Use("VehicleCommand", "commands"),
    COMMAND_ACK: Use("VehicleCommandAck", "acknowledgements of commands"),
    "/fmu/out/vehicle_land_detected": Use("VehicleLandDetected", "landed state"),
    "/fmu/out/vehicle_attitude": Use("VehicleAttitude", "attitude"),
    "/fmu/out/vehicle_local_position": Use("VehicleLocalPosition", "local position"),
    "/fmu/out/vehicle_global_position": Use("VehicleGlobalPosition", "global position"),
    "/fmu/out/vehicle_odometry": Use("VehicleOdometry", "angular velocity"),
    "/fmu/out/failsafe_flags": Use("FailsafeFlags", "PX4's reasons for refused commands"),
    "/fmu/out/vehicle_gps_position": Use("SensorGps", "GPS data"),
    "/fmu/out/battery_status": Use("BatteryStatus", "battery state"),
    "/fmu/out/position_setpoint_triplet": Use("PositionSetpointTriplet", "the vehicle's target"),
    "/fmu/in/offboard_control_mode": Use("OffboardControlMode", "Offboard mode"),
    "/fmu/in/trajectory_setpoint": Use("TrajectorySetpoint", "position, velocity and acceleration setpoints"),
    "/fmu/in/vehicle_attitude_setpoint": Use("VehicleAttitudeSetpoint", "attitude setpoints"),
    "/fmu/in/vehicle_rates_setpoint": Use("VehicleRatesSetpoint", "angular velocity setpoints"),
    "/fmu/in/vehicle_thrust_setpoint": Use("VehicleThrustSetpoint", "thrust and torque setpoints"),
    "/fmu/in/vehicle_torque_setpoint": Use("VehicleTorqueSetpoint", "thrust and torque setpoints"),
    "/fmu/in/actuator_motors": Use("ActuatorMotors", "motor setpoints"),
    "/fmu/in/actuator_servos": Use("ActuatorServos", "servo setpoints"),
    REGISTER: Use("RegisterExtComponentRequest", _MODES),
    UNREGISTER: Use("UnregisterExtComponent", _MODES),
    REGISTER_REPLY: Use("RegisterExtComponentReply", _MODES),
    CHECK_REQUEST: Use("ArmingCheckRequest", _MODES),
    CHECK_REPLY: Use("ArmingCheckReply", _MODES),
    COMPLETED: Use("ModeCompleted", "the end of a flight mode of a mission"),
    CONTROLLERS: Use("VehicleControlMode", _MODES),
    OVERRIDES: Use("ConfigOverrides", "deferred failsafes"),
    EXECUTOR_COMMAND: Use("VehicleCommand", "take-off and landing in a flight mode of a mission"),
    MODE_COMPLETED: Use("ModeCompleted", "take-off in a flight mode of a mission"),
}
"""Every topic that the server uses, in the order in which the layouts are asked. PX4 publishes its home only
when it changes, so that it is asked early."""
MAX_TOPICS: Final = 128
"""Maximum number of topics of one vehicle whose layouts are asked."""
MAX_ENDPOINTS: Final = 8000
"""Maximum number of writers and readers that are stored for a link."""
MAX_NAMED: Final = 3
"""Maximum number of topics that a vehicle's problem text names."""
REMEDY: Final = (
    "Use a PX4 whose layouts this server knows (v1.15 to v1.17), or connect the vehicle over MAVLink as well."
)


class TopicFormat(NamedTuple):
    """A topic whose layout the vehicle has confirmed; plain values, which are sent to other processes."""

    topic: str
    """Name without version."""
    name: str
    """The vehicle's name of the topic, without namespace."""
    type: str
    message_hash: int

    @property
    def message(self) -> MessageType:
        """The vehicle's layout."""
        return LAYOUTS[self.type, self.message_hash]

    def to_server(self, data: bytes) -> bytes:
        """A message of the vehicle in the layout that the server uses inside.

        Raises:
            MalformedMessage: the bytes are not a message of the vehicle's layout.
        """
        return convert(data, self.message, MESSAGES[self.type])

    def to_vehicle(self, data: bytes) -> bytes:
        """A message of the server in the vehicle's layout."""
        return convert(data, MESSAGES[self.type], self.message)


def formats_of(address: DdsAddress, topics: Container[str]) -> dict[str, TopicFormat]:
    """The formats of some of a vehicle's topics, by name without version."""
    return {each[0]: TopicFormat(*each) for each in address.formats if each[0] in topics}


def with_formats_of(address: DdsAddress, topics: Container[str]) -> DdsAddress:
    """The address with the formats of these topics only."""
    return replace(address, formats=tuple(formats_of(address, topics).values()))


def known_formats(version: str) -> dict[str, TopicFormat]:
    """The formats of a vehicle with this version of PX4, without versions in the topics' names."""
    types = VERSIONS[version]
    return {
        topic: TopicFormat(topic, topic, use.type, types[use.type].hash)
        for topic, use in USED.items()
        if use.type in types
    }


@dataclass(slots=True)
class _Question:
    """What is known about the layout of one topic inside PX4."""

    attempts: int = 0
    answered: bool = False
    message_hash: int | None = None
    """None: PX4 does not know the topic, or has not answered."""


class VehicleFormats:
    """The layouts of one vehicle's topics.

    Args:
        namespace: the vehicle's namespace; may be empty.
    """

    def __init__(self, namespace: str) -> None:
        self._namespace = namespace
        self._announced: dict[str, tuple[str, str]] = {}
        """The vehicle's name and type of each topic, by the name without version."""
        self._questions: dict[str, _Question] = {}
        """By the name inside PX4."""
        self._asked: str | None = None
        self._asked_s = float("-inf")
        self._heard = False
        self._other_protocol: int | None = None
        self.usable: Mapping[str, TopicFormat] = {}
        """The topics with a known layout, by name without version; replaced when it changes."""
        self.unusable: Mapping[str, UnusableTopic] = {}
        """Why each other topic that the server uses cannot be used, by name without version."""
        self._update()

    def announce(self, topics: Iterable[AnnouncedTopic]) -> None:
        """Sets the topics that the vehicle publishes or subscribes to."""
        announced: dict[str, tuple[str, str]] = {}
        for each in sorted(topics):
            known = each.base in USED or each.type in MESSAGES
            if known and (each.base in announced or len(announced) < MAX_TOPICS):
                announced[each.base] = each.name, each.type
        if announced != self._announced:
            self._announced = announced
            self._update()

    def reset(self) -> None:
        """Forgets all answers: another PX4 answers in this namespace."""
        self._questions.clear()
        self._asked, self._heard, self._other_protocol = None, False, None
        self._asked_s = float("-inf")
        self._update()

    def request(self, now_s: float, last_status_s: float) -> bytes | None:
        """The request that is due now; None: no request is due.

        Args:
            now_s: current time [s, monotonic].
            last_status_s: when the vehicle's last status arrived.
        """
        name = self._next_question(now_s, last_status_s)
        if name is None:
            return None
        question = self._questions.setdefault(name, _Question())
        question.attempts += 1
        self._asked, self._asked_s = name, now_s
        if question.attempts == ATTEMPTS:
            self._update()
        topic = next(each for each in self._topics() if _inside_px4(each) == name)
        text = topic.lstrip("/").encode()[:MAX_NAME].ljust(MAX_NAME, b"\0")
        fields = {"protocol_version": PROTOCOL_VERSION, "topic_name": tuple(text)}
        return MESSAGES["MessageFormatRequest"].encode(fields)

    def on_response(self, values: Values) -> None:
        """Handles a MessageFormatResponse, also one to another program."""
        self._heard = True
        if values["protocol_version"] != PROTOCOL_VERSION:
            self._other_protocol = values["protocol_version"]
            self._update()
            return
        name = bytes(values["topic_name"]).split(b"\0")[0].decode("ascii", "replace").rpartition("/")[2]
        if name not in self._questions:
            return
        message_hash = values["message_hash"] if values["success"] else None
        question = self._questions[name]
        changed = not question.answered or question.message_hash != message_hash
        question.answered, question.message_hash = True, message_hash
        if name == self._asked:
            self._asked = None
        if changed:
            self._update()

    @property
    def silent(self) -> bool:
        """Whether PX4 has not answered for so long that this counts as a problem."""
        status = self._questions.get(_inside_px4(STATUS))
        return not self._heard and status is not None and status.attempts >= ATTEMPTS

    def problems(self) -> list[str]:
        """The problem of this vehicle's layouts, if there is one."""
        if self._other_protocol is not None:
            return [
                f"{self._vehicle} answers in version {self._other_protocol} of the message format check, but "
                f"this server knows version {PROTOCOL_VERSION}. Not available: {USED[STATUS].lost}. {REMEDY}"
            ]
        if self.silent:
            return [
                f"{self._vehicle} does not answer {REQUEST}, so the layouts of its topics are not known "
                f"(PX4 v1.14 and older cannot answer). Not available: {USED[STATUS].lost}. The server asks "
                f"again every {SLOW_REPEAT_S:g} s. {REMEDY}"
            ]
        unusable = self.unusable
        texts = [unusable[t].text for t in USED if t in unusable and not unusable[t].awaited]
        if not texts:
            return []
        more = len(texts) - MAX_NAMED
        further = f" Further topics that are not used: {more}." if more > 0 else ""
        return [f"{'. '.join(texts[:MAX_NAMED])}.{further} {REMEDY}"]

    # --- inside -----------------------------------------------------------------------------------

    @property
    def _vehicle(self) -> str:
        return self._namespace or "The vehicle"

    def _topics(self) -> list[str]:
        """The topics to ask: those that the server uses, then those that it shows."""
        return [*USED, *(topic for topic in self._announced if topic not in USED)]

    def _next_question(self, now_s: float, last_status_s: float) -> str | None:
        since_s, status = now_s - self._asked_s, _inside_px4(STATUS)
        if not self._heard:
            return status if since_s >= (SLOW_REPEAT_S if self.silent else REPEAT_S) else None
        if now_s - last_status_s > SILENT_S and since_s >= PROBE_EVERY_S:
            return status
        if self._asked is not None and since_s < REPEAT_S:
            return None
        names = dict.fromkeys(_inside_px4(topic) for topic in self._topics() if topic in self._announced)
        questions = {name: self._questions.get(name, _Question()) for name in names}
        attempts = {name: each.attempts for name, each in questions.items() if not each.answered}
        name = min(attempts, key=lambda name: attempts[name], default=None)  # the first of the fewest
        if name is None or (attempts[name] >= ATTEMPTS and since_s < SLOW_REPEAT_S):
            return None
        return name

    def _update(self) -> None:
        usable: dict[str, TopicFormat] = {}
        unusable: dict[str, UnusableTopic] = {}
        for topic in self._topics():
            result = self._examine(topic)
            if isinstance(result, TopicFormat):
                usable[topic] = result
            elif topic in USED:
                unusable[topic] = result
        self.unusable = unusable
        if usable != self.usable:
            self.usable = usable

    def _examine(self, topic: str) -> TopicFormat | UnusableTopic:
        """The topic's format, or why it cannot be used."""
        name, dds_type = self._announced.get(topic, (topic, ""))
        use = USED.get(topic, Use(dds_type, "its values"))
        full_name = f"/{self._namespace}{name}" if self._namespace else name
        lost = f"Not available: {use.lost}"
        question = self._questions.get(_inside_px4(topic))
        if topic not in self._announced:
            return UnusableTopic(f"The vehicle has no topic {full_name}. {lost}", awaited=True)
        if dds_type != use.type:
            return UnusableTopic(f"{full_name} has the type {dds_type} instead of {use.type}. {lost}")
        if question is None or not question.answered:
            late = question is not None and question.attempts >= ATTEMPTS
            missing = "did not answer" if late else "has not answered yet"
            return UnusableTopic(f"PX4 {missing} which layout {full_name} has. {lost}", awaited=not late)
        if question.message_hash is None:
            return UnusableTopic(f"PX4 does not know the topic {full_name}. {lost}")
        if (use.type, question.message_hash) not in LAYOUTS:
            own = MESSAGES[use.type]
            return UnusableTopic(
                f"{full_name} has a layout that this server does not know: PX4 names it "
                f"{question.message_hash:08x}, this server knows {own.hash:08x} ({versions_of(own)}). {lost}"
            )
        return TopicFormat(topic, name, use.type, question.message_hash)


def _inside_px4(topic: str) -> str:
    """A topic's name inside PX4."""
    return topic.rpartition("/")[2]


class AnnouncedTopic(NamedTuple):
    """A topic that a vehicle publishes or subscribes to, without its namespace."""

    base: str
    """Name without version."""
    name: str
    type: str
    """Name of the type in px4_msgs; another type has its name in DDS."""


class AnnouncedTopics:
    """The topics of all vehicles of a link, from the announcements of their writers and readers."""

    def __init__(self) -> None:
        self._namespaces: dict[str, str] = {}
        """Namespace of each writer of an output and reader of an input."""
        self._topics: dict[str, dict[str, tuple[str, AnnouncedTopic]]] = {}
        """Participant and topic of these, by namespace."""

    def apply(self, each: Announcement) -> None:
        """Adds or removes a writer or reader; those of other programs are ignored."""
        known_namespace = self._namespaces.pop(each.key, None)
        if known_namespace is not None:
            del self._topics[known_namespace][each.key]
        parsed = None if each.topic is None else parse_topic(each.topic.name)
        if each.topic is None or parsed is None or len(self._namespaces) >= MAX_ENDPOINTS:
            return
        if each.publishes == parsed.base.startswith("/fmu/out/"):
            self._namespaces[each.key] = parsed.namespace
            topic = AnnouncedTopic(parsed.base, parsed.name, ros_message(each.topic.type))
            self._topics.setdefault(parsed.namespace, {})[each.key] = each.participant, topic

    def vehicles(self) -> list[str]:
        """The namespaces in which a vehicle's status is published."""
        return sorted(
            namespace
            for namespace, topics in self._topics.items()
            if any(topic.base == STATUS for _, topic in topics.values())
        )

    def of(self, namespace: str, participant: str | None) -> list[AnnouncedTopic]:
        """The topics of a participant in a namespace; None: of all participants."""
        topics = self._topics.get(namespace, {}).values()
        return [topic for owner, topic in topics if participant in (None, owner)]
