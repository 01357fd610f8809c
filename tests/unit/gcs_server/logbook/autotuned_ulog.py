"""Writes ULogs in which PX4's autotune runs, as its module publishes it every 0.1 s."""

import struct

from tests.unit.gcs_server.logbook.generated_ulogs import (
    MAGIC,
    START_US,
    message,
    parameter,
    sample,
    subscription,
    text_info,
)

TOPIC = "autotune_attitude_control_status"
FIELDS = "uint64_t timestamp;float kc;float ki;float kd;float att_p;uint8_t state;"
GAINS = {2: (0.12, 1.5, 0.02, 5.5), 4: (0.16, 1.25, 0.0, 6.5), 6: (0.25, 0.5, 0.01, 2.8)}
"""kc, ki, kd, att_p at the end of the roll, pitch and yaw step."""
COMPLETE = ((1, 3), (2, 60), (3, 21), (4, 70), (5, 21), (6, 80), (7, 21), (8, 1), (9, 1), (11, 20), (0, 1))
"""(state, number of samples) of PX4 up to v1.17 with MC_AT_APPLY 0."""
FROM_1_18 = {0: 0, 1: 1, 2: 3, 3: 4, 4: 6, 5: 7, 6: 9, 7: 10, 8: 11, 9: 12, 10: 13, 11: 14, 12: 15, 13: 16}


def autotuned_ulog(*runs, gains=GAINS, numbers=None, vehicle_type=1):
    """A log with runs of autotune, each as `COMPLETE`; `numbers` renumbers the states."""
    parts = [
        MAGIC + struct.pack("<Q", START_US),
        message("B", bytes(40)),
        message("F", f"{TOPIC}:{FIELDS}".encode()),
        message("F", b"vehicle_status:uint64_t timestamp;uint8_t nav_state;uint8_t arming_state;"
                     b"uint8_t vehicle_type;"),
        text_info("sys_name", "PX4"),
        parameter("MC_ROLLRATE_P", 0.15),
        subscription(0, 0, "vehicle_status"),
        subscription(1, 0, TOPIC),
        sample(0, struct.pack("<QBBB", START_US, 4, 2, vehicle_type)),
    ]  # fmt: skip
    t_us = START_US + 5_000_000
    for run in runs or (COMPLETE,):
        for state, count in run:
            for n in range(count):
                found = gains.get(state, (0.9, 9.0, 9.0, 9.0))
                last = n == count - 1
                values = found if last else tuple(1.3 * each for each in found)
                code = state if numbers is None else numbers[state]
                parts.append(sample(1, struct.pack("<Q4fB", t_us, *values, code)))
                t_us += 100_000
        t_us += 3_000_000
    parts.append(sample(0, struct.pack("<QBBB", t_us, 4, 2, vehicle_type)))
    return b"".join(parts)
