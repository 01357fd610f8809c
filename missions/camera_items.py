"""Mission items for cameras, triggers and gimbals; see `items.py`. Camera 0 is all of them."""

from __future__ import annotations

from typing import Literal

from missions.items import Item, Unset


class TriggerDistance(Item):
    """Take a picture every so many metres from here on; 0 stops. `at_once` 1: the first one now."""

    COMMAND = 206
    SLOTS = ("distance_m", "shutter_ms", "at_once", "camera", 0.0, 0.0, 0.0)
    kind: Literal["trigger_distance"] = "trigger_distance"
    distance_m: Unset
    shutter_ms: Unset = 0.0
    at_once: Unset = 0.0
    camera: Unset = 0.0


class TriggerInterval(Item):
    """Set the least time between two pictures, in milliseconds."""

    COMMAND = 214
    SLOTS = ("interval_ms", "shutter_ms", "camera", 0.0, 0.0, 0.0, 0.0)
    kind: Literal["trigger_interval"] = "trigger_interval"
    interval_ms: Unset
    shutter_ms: Unset = 0.0
    camera: Unset = 0.0


class TriggerControl(Item):
    """Start (1) or stop (0) the camera trigger; -1 leaves each as it is."""

    COMMAND = 2003
    SLOTS = ("enable", "reset", "pause", "camera", 0.0, 0.0, 0.0)
    kind: Literal["trigger_control"] = "trigger_control"
    enable: Unset
    reset: Unset = 0.0
    pause: Unset = 0.0
    camera: Unset = 0.0


class PhotoStart(Item):
    """Take `count` pictures (0: until stopped), `interval_s` apart."""

    COMMAND = 2000
    SLOTS = ("camera", "interval_s", "count", "sequence", 0.0, 0.0, None)
    kind: Literal["photo_start"] = "photo_start"
    camera: Unset = 0.0
    interval_s: Unset = 0.0
    count: Unset = 1.0
    sequence: Unset = 0.0


class PhotoStop(Item):
    """Stop taking pictures."""

    COMMAND = 2001
    SLOTS = ("camera", None, None, None, 0.0, 0.0, None)
    kind: Literal["photo_stop"] = "photo_stop"
    camera: Unset = 0.0


class VideoStart(Item):
    """Start recording; `status_hz` is how often the camera reports on it."""

    COMMAND = 2500
    SLOTS = ("stream", "status_hz", "camera", None, 0.0, 0.0, None)
    kind: Literal["video_start"] = "video_start"
    stream: Unset = 0.0
    status_hz: Unset = 0.0
    camera: Unset = 0.0


class VideoStop(Item):
    """Stop recording."""

    COMMAND = 2501
    SLOTS = ("stream", "camera", None, None, 0.0, 0.0, None)
    kind: Literal["video_stop"] = "video_stop"
    stream: Unset = 0.0
    camera: Unset = 0.0


class CameraMode(Item):
    """`mode`: 0 pictures, 1 video, 2 survey pictures."""

    COMMAND = 530
    SLOTS = ("camera", "mode", None, None, 0.0, 0.0, None)
    kind: Literal["camera_mode"] = "camera_mode"
    camera: Unset = 0.0
    mode: Unset


class CameraZoom(Item):
    """`zoom_type` is CAMERA_ZOOM_TYPE: 0 step, 1 continuous, 2 percent, 3 focal length in mm, 4 degrees."""

    COMMAND = 531
    SLOTS = ("zoom_type", "value", "camera", None, 0.0, 0.0, None)
    kind: Literal["camera_zoom"] = "camera_zoom"
    zoom_type: Unset
    value: Unset
    camera: Unset = 0.0


class CameraFocus(Item):
    """`focus_type` is SET_FOCUS_TYPE: 0 step, 1 continuous, 2 percent, 3 metres, 4 to 6 automatic."""

    COMMAND = 532
    SLOTS = ("focus_type", "value", "camera", None, 0.0, 0.0, None)
    kind: Literal["camera_focus"] = "camera_focus"
    focus_type: Unset
    value: Unset
    camera: Unset = 0.0


class ControlVideo(Item):
    """The older way to send and record video."""

    COMMAND = 200
    SLOTS = ("camera", "transmission", "interval_s", "recording", 0.0, 0.0, 0.0)
    kind: Literal["control_video"] = "control_video"
    camera: Unset
    transmission: Unset = 0.0
    interval_s: Unset = 0.0
    recording: Unset = 0.0


class Digicam(Item):
    """The older way to take a picture (`shoot` 1)."""

    COMMAND = 203
    SLOTS = ("session", "zoom", "zoom_step", "focus_lock", "shoot", "command_id", "shot_id")
    kind: Literal["digicam"] = "digicam"
    session: Unset = 0.0
    zoom: Unset = 0.0
    zoom_step: Unset = 0.0
    focus_lock: Unset = 0.0
    shoot: Unset = 1.0
    command_id: Unset = 0.0
    shot_id: Unset = 0.0


class ObliqueSurvey(Item):
    """Take a picture every so many metres, the camera rolling from side to side, in whole degrees."""

    COMMAND = 260
    SLOTS = ("distance_m", "shutter_ms", "interval_ms", "positions", "roll_deg", "pitch_deg", 0.0)
    kind: Literal["oblique_survey"] = "oblique_survey"
    distance_m: Unset
    shutter_ms: Unset = 0.0
    interval_ms: Unset = 0.0
    positions: Unset = 0.0
    roll_deg: Unset = 0.0
    pitch_deg: Unset = 0.0


class GimbalPitchYaw(Item):
    """Point the gimbal: degrees and degrees per second, pitch positive up; None is left as it is.

    `flags` are GIMBAL_MANAGER_FLAGS: 16 yaw lock, 32 yaw from the vehicle's nose, 64 yaw from north.
    """

    COMMAND = 1000
    SLOTS = ("pitch_deg", "yaw_deg", "pitch_rate_deg_s", "yaw_rate_deg_s", "flags", 0.0, "gimbal_id")
    kind: Literal["gimbal_pitch_yaw"] = "gimbal_pitch_yaw"
    pitch_deg: Unset = None
    yaw_deg: Unset = None
    pitch_rate_deg_s: Unset = None
    yaw_rate_deg_s: Unset = None
    flags: Unset = 0.0
    gimbal_id: Unset = 0.0


class GimbalConfigure(Item):
    """Say who controls the gimbal: system and component ids; 0 nobody, -1 unchanged, -2 the sender."""

    COMMAND = 1001
    SLOTS = (
        "primary_system",
        "primary_component",
        "secondary_system",
        "secondary_component",
        0.0,
        0.0,
        "gimbal_id",
    )
    kind: Literal["gimbal_configure"] = "gimbal_configure"
    primary_system: Unset
    primary_component: Unset
    secondary_system: Unset = 0.0
    secondary_component: Unset = 0.0
    gimbal_id: Unset = 0.0


class MountConfigure(Item):
    """The older way to set up a camera mount; `mode` is MAV_MOUNT_MODE."""

    COMMAND = 204
    SLOTS = ("mode", "stabilize_roll", "stabilize_pitch", "stabilize_yaw", 0.0, 0.0, 0.0)
    kind: Literal["mount_configure"] = "mount_configure"
    mode: Unset = 2.0
    stabilize_roll: Unset = 0.0
    stabilize_pitch: Unset = 0.0
    stabilize_yaw: Unset = 0.0


class MountControl(Item):
    """The older way to point a camera mount: degrees; `mode` 2 is by angles."""

    COMMAND = 205
    SLOTS = ("pitch_deg", "roll_deg", "yaw_deg", 0.0, 0.0, 0.0, "mode")
    kind: Literal["mount_control"] = "mount_control"
    pitch_deg: Unset = 0.0
    roll_deg: Unset = 0.0
    yaw_deg: Unset = 0.0
    mode: Unset = 2.0
