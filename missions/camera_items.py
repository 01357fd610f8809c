"""Mission items for cameras, triggers and gimbals; see `items.py`. Camera 0 means all cameras."""

from __future__ import annotations

from typing import Literal

from missions.items import Item, NumberOrNone


class TriggerDistance(Item):
    """Take a photo every `distance_m`; 0 stops the trigger. `at_once` 1: take the first photo
    immediately."""

    COMMAND = 206
    SLOTS = ("distance_m", "shutter_ms", "at_once", "camera", 0.0, 0.0, 0.0)
    kind: Literal["trigger_distance"] = "trigger_distance"
    distance_m: NumberOrNone
    shutter_ms: NumberOrNone = 0.0
    at_once: NumberOrNone = 0.0
    camera: NumberOrNone = 0.0


class TriggerInterval(Item):
    """Set the minimum time between two photos, in milliseconds."""

    COMMAND = 214
    SLOTS = ("interval_ms", "shutter_ms", "camera", 0.0, 0.0, 0.0, 0.0)
    kind: Literal["trigger_interval"] = "trigger_interval"
    interval_ms: NumberOrNone
    shutter_ms: NumberOrNone = 0.0
    camera: NumberOrNone = 0.0


class TriggerControl(Item):
    """Start (`enable` 1) or stop (0) the camera trigger; -1 leaves `enable`, `reset` or `pause` unchanged."""

    COMMAND = 2003
    SLOTS = ("enable", "reset", "pause", "camera", 0.0, 0.0, 0.0)
    kind: Literal["trigger_control"] = "trigger_control"
    enable: NumberOrNone
    reset: NumberOrNone = 0.0
    pause: NumberOrNone = 0.0
    camera: NumberOrNone = 0.0


class PhotoStart(Item):
    """Take `count` photos (0: until stopped), `interval_s` apart."""

    COMMAND = 2000
    SLOTS = ("camera", "interval_s", "count", "sequence", 0.0, 0.0, None)
    kind: Literal["photo_start"] = "photo_start"
    camera: NumberOrNone = 0.0
    interval_s: NumberOrNone = 0.0
    count: NumberOrNone = 1.0
    sequence: NumberOrNone = 0.0


class PhotoStop(Item):
    """Stop taking photos."""

    COMMAND = 2001
    SLOTS = ("camera", None, None, None, 0.0, 0.0, None)
    kind: Literal["photo_stop"] = "photo_stop"
    camera: NumberOrNone = 0.0


class VideoStart(Item):
    """Start recording; `status_hz` is the rate of the camera's status messages."""

    COMMAND = 2500
    SLOTS = ("stream", "status_hz", "camera", None, 0.0, 0.0, None)
    kind: Literal["video_start"] = "video_start"
    stream: NumberOrNone = 0.0
    status_hz: NumberOrNone = 0.0
    camera: NumberOrNone = 0.0


class VideoStop(Item):
    """Stop recording."""

    COMMAND = 2501
    SLOTS = ("stream", "camera", None, None, 0.0, 0.0, None)
    kind: Literal["video_stop"] = "video_stop"
    stream: NumberOrNone = 0.0
    camera: NumberOrNone = 0.0


class CameraMode(Item):
    """Set the camera mode: 0 photos, 1 video, 2 survey photos."""

    COMMAND = 530
    SLOTS = ("camera", "mode", None, None, 0.0, 0.0, None)
    kind: Literal["camera_mode"] = "camera_mode"
    camera: NumberOrNone = 0.0
    mode: NumberOrNone


class CameraZoom(Item):
    """Zoom. `zoom_type` is CAMERA_ZOOM_TYPE: 0 step, 1 continuous, 2 percent, 3 focal length in mm, 4
    degrees."""

    COMMAND = 531
    SLOTS = ("zoom_type", "value", "camera", None, 0.0, 0.0, None)
    kind: Literal["camera_zoom"] = "camera_zoom"
    zoom_type: NumberOrNone
    value: NumberOrNone
    camera: NumberOrNone = 0.0


class CameraFocus(Item):
    """Focus. `focus_type` is SET_FOCUS_TYPE: 0 step, 1 continuous, 2 percent, 3 metres, 4 to 6 automatic."""

    COMMAND = 532
    SLOTS = ("focus_type", "value", "camera", None, 0.0, 0.0, None)
    kind: Literal["camera_focus"] = "camera_focus"
    focus_type: NumberOrNone
    value: NumberOrNone
    camera: NumberOrNone = 0.0


class ControlVideo(Item):
    """Deprecated command to transmit and record video."""

    COMMAND = 200
    SLOTS = ("camera", "transmission", "interval_s", "recording", 0.0, 0.0, 0.0)
    kind: Literal["control_video"] = "control_video"
    camera: NumberOrNone
    transmission: NumberOrNone = 0.0
    interval_s: NumberOrNone = 0.0
    recording: NumberOrNone = 0.0


class Digicam(Item):
    """Deprecated command to take a photo (`shoot` 1)."""

    COMMAND = 203
    SLOTS = ("session", "zoom", "zoom_step", "focus_lock", "shoot", "command_id", "shot_id")
    kind: Literal["digicam"] = "digicam"
    session: NumberOrNone = 0.0
    zoom: NumberOrNone = 0.0
    zoom_step: NumberOrNone = 0.0
    focus_lock: NumberOrNone = 0.0
    shoot: NumberOrNone = 1.0
    command_id: NumberOrNone = 0.0
    shot_id: NumberOrNone = 0.0


class ObliqueSurvey(Item):
    """Take a photo every `distance_m` while the camera rolls from side to side; angles in whole degrees."""

    COMMAND = 260
    SLOTS = ("distance_m", "shutter_ms", "interval_ms", "positions", "roll_deg", "pitch_deg", 0.0)
    kind: Literal["oblique_survey"] = "oblique_survey"
    distance_m: NumberOrNone
    shutter_ms: NumberOrNone = 0.0
    interval_ms: NumberOrNone = 0.0
    positions: NumberOrNone = 0.0
    roll_deg: NumberOrNone = 0.0
    pitch_deg: NumberOrNone = 0.0


class GimbalPitchYaw(Item):
    """Point the gimbal: angles in degrees, rates in degrees per second, pitch positive up; None: unchanged.

    `flags` are GIMBAL_MANAGER_FLAGS: 16 yaw lock, 32 yaw relative to the nose, 64 yaw relative to north.
    """

    COMMAND = 1000
    SLOTS = ("pitch_deg", "yaw_deg", "pitch_rate_deg_s", "yaw_rate_deg_s", "flags", 0.0, "gimbal_id")
    kind: Literal["gimbal_pitch_yaw"] = "gimbal_pitch_yaw"
    pitch_deg: NumberOrNone = None
    yaw_deg: NumberOrNone = None
    pitch_rate_deg_s: NumberOrNone = None
    yaw_rate_deg_s: NumberOrNone = None
    flags: NumberOrNone = 0.0
    gimbal_id: NumberOrNone = 0.0


class GimbalConfigure(Item):
    """Set who controls the gimbal, by system and component id: 0 nobody, -1 unchanged, -2 the sender."""

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
    primary_system: NumberOrNone
    primary_component: NumberOrNone
    secondary_system: NumberOrNone = 0.0
    secondary_component: NumberOrNone = 0.0
    gimbal_id: NumberOrNone = 0.0


class MountConfigure(Item):
    """Deprecated command to configure a camera mount; `mode` is MAV_MOUNT_MODE."""

    COMMAND = 204
    SLOTS = ("mode", "stabilize_roll", "stabilize_pitch", "stabilize_yaw", 0.0, 0.0, 0.0)
    kind: Literal["mount_configure"] = "mount_configure"
    mode: NumberOrNone = 2.0
    stabilize_roll: NumberOrNone = 0.0
    stabilize_pitch: NumberOrNone = 0.0
    stabilize_yaw: NumberOrNone = 0.0


class MountControl(Item):
    """Deprecated command to point a camera mount, in degrees; `mode` is MAV_MOUNT_MODE (2: these angles)."""

    COMMAND = 205
    SLOTS = ("pitch_deg", "roll_deg", "yaw_deg", 0.0, 0.0, 0.0, "mode")
    kind: Literal["mount_control"] = "mount_control"
    pitch_deg: NumberOrNone = 0.0
    roll_deg: NumberOrNone = 0.0
    yaw_deg: NumberOrNone = 0.0
    mode: NumberOrNone = 2.0
