"""Writes MCAP files for tests, as `ros2 bag record` writes PX4's topics."""

import io

from mcap.writer import CompressionType, Writer

from gcs_server.ros2.message_types import CODES, MESSAGES

BEGIN_NS = 1_780_000_000_000_000_000
BOOT_US = 50_000_000
"""The vehicle's clock at the begin."""


def definition(message, package="px4_msgs"):
    """A type's definition as rosbag2 stores it: its fields, then those of each type in it."""
    parts, waiting, known = [], [message], set()
    while waiting:
        each = waiting.pop()
        if each.name in known:
            continue
        known.add(each.name)
        waiting += each.nested.values()
        head = "" if not parts else f"{'=' * 80}\nMSG: {package}/{each.name}\n"
        lines = ["# a comment", "uint8 SOME_CONSTANT = 3  # with a comment", ""]
        for field in each.fields:
            kind = field.type if field.type in CODES else f"{package}/{field.type}"
            lines.append(
                f"{kind}{f'[{field.length}]' if field.length else ''} {field.name}  # [m] what it is"
            )
        parts.append(head + "\n".join(lines) + "\n")
    return "".join(parts)


class Recording:
    """A recording that is being written."""

    def __init__(self, compression=CompressionType.ZSTD, chunk_size=20_000):
        self._file = io.BytesIO()
        self.writer = Writer(self._file, compression=compression, chunk_size=chunk_size)
        self.writer.start(profile="ros2")
        self._channels = {}

    def add(self, path, name, t_s, values, *, own_t_s=None, delay_s=0.01):
        """A message of PX4 at a time; `own_t_s`: what its timestamp says instead."""
        message = MESSAGES[name]
        channel = self._channels.get(path)
        if channel is None:
            schema = self.writer.register_schema(
                name=f"px4_msgs/msg/{name}", encoding="ros2msg", data=definition(message).encode()
            )
            channel = self.writer.register_channel(topic=path, message_encoding="cdr", schema_id=schema)
            self._channels[path] = channel
        stamp = BOOT_US + round((t_s if own_t_s is None else own_t_s) * 1e6)
        data = message.encode({"timestamp": stamp, **values})
        self.raw(channel, t_s + delay_s, data)

    def raw(self, channel, t_s, data):
        """Any message on a channel."""
        time_ns = BEGIN_NS + round(t_s * 1e9)
        self.writer.add_message(channel, log_time=time_ns, data=data, publish_time=time_ns)

    def channel(self, path, encoding, schema_encoding, schema):
        """A channel of any type."""
        number = self.writer.register_schema(name="some/Type", encoding=schema_encoding, data=schema)
        return self.writer.register_channel(topic=path, message_encoding=encoding, schema_id=number)

    def content(self):
        """The file."""
        self.writer.finish()
        return self._file.getvalue()


def flight(space="", system_id=7, recording=None, seconds=40):
    """A flight from arming at 5 s to landing at 30 s, in Position and then Hold."""
    recording = recording or Recording()
    for step in range(seconds * 10):
        t_s = step / 10
        is_armed = 5 <= t_s < 32
        climb = min(max(0.0, t_s - 6), 10.0) if t_s < 20 else max(0.0, 30.0 - t_s)
        out = f"{space}/fmu/out"
        status = {
            "arming_state": 2 if is_armed else 1,
            "nav_state": 2 if t_s < 20 else 4,
            "system_id": system_id,
        }
        position = {"x": t_s, "y": 0.5, "z": -climb, "vx": 1.0}
        recording.add(f"{out}/vehicle_status_v1", "VehicleStatus", t_s, status)
        recording.add(f"{out}/vehicle_local_position", "VehicleLocalPosition", t_s, position)
        recording.add(f"{out}/vehicle_attitude", "VehicleAttitude", t_s, {"q": (1.0, 0.0, 0.0, 0.0)})
        recording.add(f"{out}/vehicle_land_detected", "VehicleLandDetected", t_s, {"landed": climb == 0})
        place = {"lat": 47.0 + t_s * 1e-5, "lon": 8.0, "alt": 488.0 + climb}
        recording.add(f"{out}/vehicle_global_position", "VehicleGlobalPosition", t_s, place)
    return recording
