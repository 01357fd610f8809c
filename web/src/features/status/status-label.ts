/** The vehicle's mode and who commands it, as the text of the pill in the top bar. */

import type { Status } from '../../live/topics';
import { setpointsText } from '../../vehicle/setpoint-kinds';

export type Tone = 'ok' | 'target' | 'caution' | 'danger' | 'neutral';

export interface StatusLabel {
  title: string;
  /** Who commands the vehicle, or other details. */
  detail: string;
  tone: Tone;
}

export interface StatusFacts {
  status: Status | null;
  /** Age of the status [s]. */
  age_s: number;
  lost: boolean;
  /** The page has no connection to the server. */
  offline?: boolean;
  replayed: boolean;
  ready: boolean | null;
  /** Text about the RC pilot, ground station or failsafe that set the mode; null: this server set the mode, or it is not known. */
  externalModeText?: string | null;
  /** The active stream of this server. */
  stream: { type: string | null; rate_hz: number | null; client: string | null } | null;
}

interface ModeText {
  title: string;
  detail: string;
}

const MODE_TEXTS: Readonly<Record<string, ModeText>> = {
  hold: { title: 'Holding', detail: 'holds its position' },
  takeoff: { title: 'Taking off', detail: 'climbs by itself' },
  land: { title: 'Landing', detail: 'lands by itself' },
  precland: { title: 'Landing', detail: 'lands on a marker' },
  rtl: { title: 'Returning', detail: 'flies home by itself' },
  mission: { title: 'Mission', detail: 'flies the stored mission' },
  orbit: { title: 'Orbit', detail: 'circles by itself' },
  follow: { title: 'Follow', detail: 'follows a target' },
  position: { title: 'Position', detail: 'a pilot flies with position control' },
  altitude: { title: 'Altitude', detail: 'a pilot flies with altitude control' },
  stabilized: { title: 'Stabilized', detail: 'a pilot flies' },
  manual: { title: 'Manual', detail: 'a pilot flies' },
  acro: { title: 'Acro', detail: 'a pilot flies' },
};

/** Mode and commanding client, without the arming state. */
function modeText(status: Status, stream: StatusFacts['stream']): ModeText {
  if (status.mode === 'offboard') {
    if (stream === null) return { title: 'Offboard', detail: 'setpoints from another computer, not this server' };
    const rate = stream.rate_hz === null ? '' : `, ${Math.round(stream.rate_hz)} Hz`;
    return {
      title: 'Offboard',
      // The client is first: a narrow pill cuts off the end.
      detail: `from ${stream.client ?? 'this server'} · ${setpointsText(stream.type)}${rate}`,
    };
  }
  if (status.mode.startsWith('external_')) {
    const detail = stream === null ? 'an external mode of another program' : 'a mission of this server, as an external mode';
    return { title: status.mode_label || status.mode, detail };
  }
  return MODE_TEXTS[status.mode] ?? { title: status.mode_label || status.mode, detail: 'the vehicle’s own mode' };
}

/** Age of the newest heartbeat [s]: its age at the time of the status, plus the age of the status. */
export function heartbeatAge_s(status: Status, statusAge_s: number): number {
  return Math.max(0, (status.last_heartbeat_age_s ?? 0) + statusAge_s);
}

function seconds(age_s: number): string {
  return `${Math.round(age_s)} s`;
}

/** MAV_STATE_CRITICAL and MAV_STATE_EMERGENCY: PX4 reports them in each heartbeat during a failsafe. */
const FAILSAFE_STATES: readonly number[] = [5, 6];

/** Whether a failsafe has chosen the mode. The intended mode tells it too, but arrives later than the heartbeat. */
function isFailsafe(status: Status): boolean {
  const isOverruled = status.intended_custom_mode !== null && status.intended_custom_mode !== 0 && status.intended_custom_mode !== status.custom_mode;
  return status.armed && (isOverruled || FAILSAFE_STATES.includes(status.system_status));
}

export function statusLabel(facts: StatusFacts): StatusLabel {
  const { status } = facts;
  if (status === null) return { title: 'No vehicle state', detail: 'no telemetry yet', tone: 'neutral' };
  if (facts.lost) {
    const lastState = `last: ${status.mode_label}, ${status.armed ? 'armed' : 'disarmed'}`;
    if (facts.offline === true) return { title: 'No connection to the server', detail: lastState, tone: 'danger' };
    return { title: 'Connection lost', detail: `${seconds(heartbeatAge_s(status, facts.age_s))} ago · ${lastState}`, tone: 'danger' };
  }
  if (facts.replayed) return { title: 'Replay', detail: `${status.mode_label} · a recorded flight, no commands possible`, tone: 'neutral' };
  if (!status.armed) {
    const detail = `${status.mode_label} · disarmed`;
    if (facts.ready === true) return { title: 'Ready', detail, tone: 'ok' };
    if (facts.ready === false) return { title: 'Not ready', detail: `${detail} · press for the reasons`, tone: 'caution' };
    return { title: 'Disarmed', detail, tone: 'neutral' };
  }
  const modeLabel = modeText(status, facts.stream);
  if (isFailsafe(status)) return { title: `Failsafe: ${modeLabel.title}`, detail: 'the vehicle chose this mode itself', tone: 'danger' };
  if (status.landed_state === 'on_ground' && status.mode !== 'offboard') {
    return { title: 'Armed', detail: `on the ground, motors running · ${status.mode_label}`, tone: 'caution' };
  }
  if ((facts.externalModeText ?? null) !== null) return { title: modeLabel.title, detail: `${facts.externalModeText} · ${modeLabel.detail}`, tone: 'caution' };
  return { ...modeLabel, tone: status.mode === 'offboard' ? 'target' : 'ok' };
}
