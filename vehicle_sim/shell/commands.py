"""The console commands of one vehicle, and the names of all modules of PX4's build."""

from __future__ import annotations

from collections.abc import Callable

from vehicle_sim.commands.command import Handler
from vehicle_sim.logger.logger import Logger
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import LAYOUTS
from vehicle_sim.sensors.suite import Driver
from vehicle_sim.shell.console import Command, Console
from vehicle_sim.shell.flight import CommanderCommand, FailureCommand, GimbalCommand
from vehicle_sim.shell.listener import ListenerCommand
from vehicle_sim.shell.parameters import ParamCommand
from vehicle_sim.shell.status import (
    DriverCommand,
    LoggerCommand,
    MavlinkCommand,
    ModuleCommands,
    ver_command,
)
from vehicle_sim.topics.states import States

_MODULE_NAMES = (
    "actuator_test airship_att_control airspeed_selector attitude_estimator_q battery_simulator bsondump "
    "camera_feedback camera_trigger cdev_test commander control_allocator controllib_test dataman dyn ekf2 "
    "failure fake_gps fake_imu fake_magnetometer flight_mode_manager fw_att_control "
    "fw_autotune_attitude_control fw_pos_control fw_rate_control gimbal gps gyro_calibration hello hrt_test "
    "land_detector landing_target_estimator led_control list_files list_tasks listener load_mon "
    "local_position_estimator logger mag_bias_estimator manual_control mavlink mavlink_tests "
    "mc_att_control mc_autotune_attitude_control mc_hover_thrust_estimator mc_pos_control mc_rate_control "
    "msp_osd navigator param payload_deliverer perf pwm_out_sim px4_mavlink_debug px4_simple_app rc_tests "
    "rc_update replay rover_ackermann rover_differential rover_mecanum rover_pos_control sd_bench "
    "send_event sensor_agp_sim sensor_airspeed_sim sensor_baro_sim sensor_gps_sim sensor_mag_sim sensors "
    "shutdown simulator_mavlink simulator_sih sleep system_power_simulator system_time "
    "temperature_compensation tests tone_alarm tune_control uorb uorb_tests uuv_att_control "
    "uuv_pos_control uxrce_dds_client ver vtol_att_control work_item_example work_queue wqueue_test"
)
BUILT_IN: tuple[str, ...] = tuple(_MODULE_NAMES.split())
"""The modules that `help` lists on PX4 v1.16 in simulation. The console prints an error for a module without
an entry in `Shell.commands`."""


class Shell:
    """Creates consoles for one vehicle.

    `unsaved_names` returns the names of the parameters that are not saved yet.
    """

    def __init__(
        self,
        context: Context,
        unsaved_names: Callable[[], frozenset[str]],
        inject_failure: Handler,
        logger: Logger,
        states: States,
    ) -> None:
        autopilot, view, autopilot_id = context.autopilot, context.view, context.autopilot_id
        listener, modules = ListenerCommand(view, states), ModuleCommands(view)
        mavlink = MavlinkCommand(context.links, lambda msg_id: LAYOUTS[msg_id].name, context.gcs_connected)
        self._view = view
        self.commands: dict[str, Command] = {
            "commander": CommanderCommand(autopilot).command,
            "ekf2": modules.ekf2,
            "failure": FailureCommand(autopilot, inject_failure, autopilot_id).command,
            "gimbal": GimbalCommand(autopilot, autopilot_id).command,
            "listener": listener.command,
            "logger": LoggerCommand(logger).command,
            "mavlink": mavlink.command,
            "param": ParamCommand(view.parameters, unsaved_names).command,
            "sensors": modules.sensors,
            "system_time": modules.system_time,
            "uorb": listener.uorb,
            "ver": ver_command(view.px4),
            **{driver.value: DriverCommand(view, driver).command for driver in Driver},
        }

    def console(self) -> Console:
        """Creates a console session."""
        return Console(self.commands, BUILT_IN, lambda: self._view.time_s)
