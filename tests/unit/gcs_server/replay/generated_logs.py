"""Random telemetry logs from a seed: two vehicles that change modes and send texts."""

import random
import struct

from vehicle_sim.mavlink import generated_dialect as sim_dialect

BEGIN_US = 1_752_220_800_000_000
HOLD, OFFBOARD, RTL = 4 << 16 | 3 << 24, 6 << 16, 4 << 16 | 5 << 24
"""PX4's custom modes: main mode << 16 | sub mode << 24."""


def record(time_us, raw):
    return struct.pack(">Q", time_us) + raw


class FrameSource:
    """One system that packs messages with its own sequence numbers."""

    def __init__(self, system_id, component_id=1):
        self.mavlink = sim_dialect.MAVLink(None, system_id, component_id)

    def frame(self, message):
        raw = bytes(message.pack(self.mavlink))
        self.mavlink.seq = (self.mavlink.seq + 1) % 256
        return raw


def heartbeat(mode, *, armed=False, autopilot=12, mav_type=2):
    base_mode = 1 | (128 if armed else 0)
    return sim_dialect.MAVLink_heartbeat_message(mav_type, autopilot, base_mode, mode, 4 if armed else 3, 3)


def flight(seed=1, seconds=40, systems=(1, 7), begin_us=BEGIN_US):
    """(time [µs], frame) of each record of a random flight, in the order of a log."""
    rng = random.Random(seed)
    records = []
    station = FrameSource(255, 190)
    for system_id in systems:
        autopilot, gimbal = FrameSource(system_id), FrameSource(system_id, 154)
        mode, armed = HOLD, False
        for step in range(seconds * 10):
            at_us = begin_us + step * 100_000 + system_id * 1000
            boot_ms = 5000 + step * 100
            frames = []
            if step % 10 == 3:
                frames.append(autopilot.frame(heartbeat(mode, armed=armed)))
                frames.append(gimbal.frame(heartbeat(0, autopilot=8, mav_type=26)))
            if step == 25:
                frames.append(
                    autopilot.frame(
                        sim_dialect.MAVLink_home_position_message(
                            473977420, 85455940, 489_000 + system_id, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0, 0
                        )
                    )
                )
            if rng.random() < 0.02:
                mode, armed = rng.choice((HOLD, OFFBOARD, RTL)), rng.random() < 0.7
                frames.append(autopilot.frame(sim_dialect.MAVLink_current_mode_message(0, mode, mode)))
            if rng.random() < 0.03:
                text = f"note {system_id} at {step}".encode()
                frames.append(
                    autopilot.frame(sim_dialect.MAVLink_statustext_message(rng.randrange(3, 7), text, 0, 0))
                )
            frames.append(
                autopilot.frame(
                    sim_dialect.MAVLink_attitude_quaternion_message(
                        boot_ms, 1.0, 0.0, 0.0, rng.random(), 0.0, 0.0, 0.1
                    )
                )
            )
            frames.append(
                autopilot.frame(
                    sim_dialect.MAVLink_global_position_int_message(
                        boot_ms,
                        473977420 + step,
                        85455940,
                        489_000 + 100 * step,
                        100 * step,
                        0,
                        0,
                        0,
                        step * 10,
                    )
                )
            )
            if step % 20 == 0:
                frames.append(
                    autopilot.frame(sim_dialect.MAVLink_extended_sys_state_message(0, 2 if armed else 1))
                )
            records += [(at_us, raw) for raw in frames]
        records += [
            (begin_us + second * 1_000_000, station.frame(heartbeat(0, autopilot=8, mav_type=6)))
            for second in range(seconds)
        ]
    return sorted(records, key=lambda r: r[0])


def log_bytes(records):
    return b"".join(record(time_us, raw) for time_us, raw in records)
