/** What the parameters of a gimbal's set-up are for, in our words. */

const LABELS: Readonly<Record<string, string>> = {
  MNT_MODE_IN: 'Input: who commands the gimbal',
  MNT_MODE_OUT: 'Output: how the gimbal is connected',
  COM_PREARM_MODE: 'Servos move while disarmed',
  MNT_DO_STAB: 'Stabilised by the autopilot',
  MNT_MAV_SYSID: 'System id of a MAVLink gimbal',
  MNT_MAV_COMPID: 'Component id of a MAVLink gimbal',
  MNT_LND_P_MIN: 'Lowest pitch while landed',
  MNT_LND_P_MAX: 'Highest pitch while landed',
  MNT_RC_IN_MODE: 'RC sticks set',
  MNT_MAN_ROLL: 'RC channel for roll',
  MNT_MAN_PITCH: 'RC channel for pitch',
  MNT_MAN_YAW: 'RC channel for yaw',
  MNT_RATE_PITCH: 'Pitch rate by sticks',
  MNT_RATE_YAW: 'Yaw rate by sticks',
  MNT_RANGE_ROLL: 'Range of roll',
  MNT_RANGE_PITCH: 'Range of pitch',
  MNT_RANGE_YAW: 'Range of yaw',
  MNT_OFF_ROLL: 'Offset of roll',
  MNT_OFF_PITCH: 'Offset of pitch',
  MNT_OFF_YAW: 'Offset of yaw',
};

export const settingLabel = (name: string): string => LABELS[name] ?? name;
