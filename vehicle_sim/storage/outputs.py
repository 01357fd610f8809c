"""The actuators document, which a ground station uses to configure motors and servos.

Function numbers and labels are PX4 v1.16's; the airframe is the simulated multirotor.
Format: MAVLink's actuators metadata schema, version 1.
"""

from __future__ import annotations

from typing import Any

OUTPUT_CHANNELS = 16
MOTOR_COUNT, SERVO_COUNT, PERIPHERAL_COUNT = 12, 8, 6
FIRST_MOTOR, FIRST_SERVO, FIRST_PERIPHERAL = 101, 201, 301
"""Function numbers of the first motor, servo and peripheral."""
FIXED_FUNCTIONS = {
    0: "Disabled", 1: "Constant Min", 2: "Constant Max", 400: "Landing Gear", 401: "Parachute",
    402: "RC Roll", 403: "RC Pitch", 404: "RC Throttle", 405: "RC Yaw", 406: "RC Flaps", 420: "Gimbal Roll",
    421: "Gimbal Pitch", 422: "Gimbal Yaw", 430: "Gripper", 440: "Landing Gear Wheel",
}  # fmt: skip


def actuators_document() -> dict[str, Any]:
    """The content of the actuators document."""
    functions = dict(FIXED_FUNCTIONS)
    functions |= {FIRST_MOTOR + n: f"Motor {n + 1}" for n in range(MOTOR_COUNT)}
    functions |= {FIRST_SERVO + n: f"Servo {n + 1}" for n in range(SERVO_COUNT)}
    functions |= {
        FIRST_PERIPHERAL + n: f"Peripheral via Actuator Set {n + 1}" for n in range(PERIPHERAL_COUNT)
    }
    return {
        "version": 1,
        "functions_v1": {str(number): {"label": functions[number]} for number in sorted(functions)},
        "mixer_v1": {
            "actuator-types": {
                "DEFAULT": {"values": {"min": -1, "max": 1, "default": -1}},
                "motor": {
                    "function-min": FIRST_MOTOR,
                    "function-max": FIRST_MOTOR + MOTOR_COUNT - 1,
                    "label-index-offset": 1,
                    "values": {"min": 0, "max": 1, "default-is-nan": True},
                },
                "servo": {
                    "function-min": FIRST_SERVO,
                    "function-max": FIRST_SERVO + SERVO_COUNT - 1,
                    "label-index-offset": 1,
                    "values": {"min": -1, "max": 1, "default": 0},
                },
            },
            "config": [_multirotor()],
        },
        "outputs_v1": [
            {
                "label": "SIM",
                "subgroups": [
                    {
                        "per-channel-parameters": [
                            {"name": "PWM_MAIN_FUNC${i}", "function": "function", "label": "Function"},
                            {
                                "name": "PWM_MAIN_REV",
                                "index-offset": -1,
                                "show-as": "bitset",
                                "label": "Reversed",
                            },
                        ],
                        "channels": [
                            {"label": f"Channel {n}", "param-index": n} for n in range(1, OUTPUT_CHANNELS + 1)
                        ],
                    }
                ],
            }
        ],
    }


def _multirotor() -> dict[str, Any]:
    positions = (("posx", "Position X", "PX"), ("posy", "Position Y", "PY"), ("posz", "Position Z", "PZ"))
    parameters: list[dict[str, Any]] = [
        {"function": function, "label": label, "name": f"CA_ROTOR${{i}}_{suffix}", "index-offset": 0}
        for function, label, suffix in positions
    ]
    parameters.append(
        {
            "function": "spin-dir",
            "label": "Direction CCW",
            "name": "CA_ROTOR${i}_KM",
            "show-as": "true-if-positive",
        }
    )
    motors = {
        "actuator-type": "motor", "count": "CA_ROTOR_COUNT", "group-label": "Motors", "required": True,
        "parameters": [], "per-item-parameters": parameters,
    }  # fmt: skip
    return {"option": "CA_AIRFRAME==0", "type": "multirotor", "title": "Multirotor", "actuators": [motors]}
