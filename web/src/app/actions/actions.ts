/** The vehicle actions: names, confirmation texts, reasons why an action is not possible, and API requests. */

import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import { distanceText as knownDistanceText, heightText } from '../../ui/format';
import type { VehicleFacts } from '../../vehicle/facts';
import type { StreamStart } from '../../vehicle/setpoint';

/** `land_now` works even if another client has control of the vehicle; `land` does not. */
export type ActionName = 'arm' | 'disarm' | 'takeoff' | 'land' | 'rtl' | 'hold' | 'land_now' | 'kill' | 'force_control' | 'offboard_start' | 'goto';

/** Values for the confirmation texts. Null: unknown, unless the field's description says otherwise. */
export interface ActionFacts {
  vehicleId: string;
  vehicleName: string;
  armed: boolean;
  inAir: boolean;
  /** The vehicle reports that it is on the ground. False also if the vehicle reports no landed state. */
  onGround?: boolean;
  alt_home_m: number | null;
  homeDistance_m: number | null;
  mode: string;
  streaming: boolean;
  takeoffAlt_home_m: number;
  battery_percent: number | null;
  /** The other client that has control; null if this page may command the vehicle. */
  controlHolder?: string | null;
  /** RTL_RETURN_ALT; null until the parameter has been read. */
  returnAlt_home_m?: number | null;
}

/** Target of "Go here". Distance and time are from the vehicle's position when the menu was opened. */
export interface GotoTarget {
  lat_deg: number;
  lon_deg: number;
  alt_home_m: number;
  distance_m: number;
  /** Null if the vehicle's cruise speed is not known. */
  time_s: number | null;
  /** Called when the vehicle has accepted or refused the request. */
  onResult?: (accepted: boolean) => void;
}

export interface ConfirmationTexts {
  title: string;
  effect: string;
  /** Label of the slider. */
  verb: string;
  danger: boolean;
}

const OFFBOARD_ENDS = ' Offboard ends.';

function distanceText(distance_m: number | null): string {
  return distance_m === null ? 'an unknown distance' : knownDistanceText(distance_m);
}

function altitudeText(facts: ActionFacts): string {
  return facts.alt_home_m === null ? 'an unknown altitude' : `${heightText(facts.alt_home_m)} above home`;
}

/** The altitude and distance of the return flight, as far as known. */
function returnText(facts: ActionFacts): string {
  const alt_m = facts.returnAlt_home_m ?? null;
  if (alt_m === null) return `Climbs to the return altitude, flies ${distanceText(facts.homeDistance_m)} back`;
  if (facts.alt_home_m !== null && facts.alt_home_m >= alt_m)
    return `Stays at ${heightText(facts.alt_home_m)} above home, flies ${distanceText(facts.homeDistance_m)} back`;
  return `Climbs to the return altitude, ${heightText(alt_m, 0)} above home (lower near home), flies ${distanceText(facts.homeDistance_m)} back`;
}

/** What the vehicle does when it is armed in its present mode. */
function armText({ mode, streaming }: ActionFacts): string {
  if (streaming) return 'A setpoint stream is running: if the vehicle is in Offboard, it flies to the setpoint as soon as it is armed.';
  if (mode === 'offboard') return 'The vehicle is in Offboard: as soon as it is armed, it flies to the setpoints of any other program that sends them.';
  if (mode === 'mission') return 'The vehicle is in Mission mode: as soon as it is armed, it takes off and flies the mission stored on it.';
  if (mode === 'takeoff' || mode === 'vtol_takeoff') return 'The vehicle is in Take off mode: it takes off as soon as it is armed.';
  if (mode.startsWith('external_'))
    return 'The vehicle is in an external flight mode, which another program or a mission provides: it can take off and fly as soon as it is armed.';
  return 'The motors start on the ground. The vehicle disarms automatically if it does not take off.';
}

/** What the vehicle does when it receives the command to disarm. */
function disarmText({ inAir, onGround = false }: ActionFacts): string {
  if (inAir) return 'The vehicle reports that it is in the air, so it will not disarm.';
  return onGround
    ? 'The vehicle is on the ground. The motors stop.'
    : 'The vehicle does not report that it is on the ground. PX4 refuses to disarm in the air.';
}

/** What a new stream does to a vehicle on the ground; an empty text if the vehicle is in the air. */
function streamOnGroundText({ armed, inAir }: ActionFacts): string {
  if (inAir) return '';
  return armed
    ? ' The vehicle is armed on the ground: it can take off immediately.'
    : ' The vehicle is disarmed and does not take off now. If it is armed before the setpoint expires, it flies to the setpoint.';
}

/** The confirmation's texts; null for an action without confirmation (Hold), and for `goto` without a target. */
export function confirmationTexts(
  action: ActionName,
  facts: ActionFacts,
  target: GotoTarget | null = null,
  streamStart: StreamStart | null = null,
): ConfirmationTexts | null {
  const offboardEnds = facts.streaming ? OFFBOARD_ENDS : '';
  const name = facts.vehicleName;
  switch (action) {
    case 'hold':
      return null;
    case 'arm':
      return {
        title: `Arm ${name}`,
        effect: armText(facts),
        verb: 'Arm',
        danger: false,
      };
    case 'disarm':
      return {
        title: `Disarm ${name}`,
        effect: disarmText(facts),
        verb: 'Disarm',
        danger: false,
      };
    case 'takeoff':
      return {
        title: `Take off: ${name}`,
        effect: `${facts.armed ? 'Climbs' : 'Arms, climbs'} to ${heightText(facts.takeoffAlt_home_m)} above home and holds there.${facts.battery_percent === null ? '' : ` Battery ${facts.battery_percent} %.`}`,
        verb: 'Take off',
        danger: false,
      };
    case 'land':
      return {
        title: `Land ${name}`,
        effect: `Descends from ${altitudeText(facts)} at its current position, ${distanceText(facts.homeDistance_m)} from home, and disarms.${offboardEnds}`,
        verb: 'Land',
        danger: false,
      };
    case 'rtl':
      return { title: `Return: ${name}`, effect: `${returnText(facts)} and lands.${offboardEnds}`, verb: 'Return', danger: false };
    case 'goto':
      return target === null
        ? null
        : {
            title: `Send ${name} here`,
            effect: `Flies ${distanceText(target.distance_m)} to this position at ${heightText(target.alt_home_m)} above home${target.time_s === null ? '' : ` in about ${Math.round(target.time_s)} s`} and holds there. The vehicle is at ${altitudeText(facts)} now.${offboardEnds}`,
            verb: 'Go',
            danger: false,
          };
    case 'offboard_start':
      if (streamStart !== null)
        return {
          title: `Start Offboard: ${name}`,
          effect: `The server starts a setpoint stream: ${streamStart.text}.${streamOnGroundText(facts)} Hold ends the stream.`,
          verb: 'Start',
          danger: false,
        };
      return {
        title: `Start Offboard: ${name}`,
        effect: `The server streams the vehicle’s current position as the setpoint${facts.inAir ? ': the vehicle holds this position' : ''}. You can move the setpoint in steps in the Offboard card.${streamOnGroundText(facts)} Hold ends the stream.`,
        verb: 'Start',
        danger: false,
      };
    case 'land_now':
      return {
        title: `Land ${name} now`,
        effect: `Like Land, but works even if another client has control. Descends from ${altitudeText(facts)} at its current position and disarms.${offboardEnds}`,
        verb: 'Land now',
        danger: false,
      };
    case 'force_control':
      return {
        title: `Take control of ${name} by force`,
        effect: `${facts.controlHolder ?? 'The controlling client'} loses control and is notified. The vehicle keeps doing what it does now.`,
        verb: 'Take control',
        danger: true,
      };
    case 'kill':
      return {
        title: `Stop motors of ${name}`,
        effect: facts.inAir
          ? `The vehicle will fall from ${altitudeText(facts)}. Nothing slows it down.`
          : 'Motors stop immediately. If the vehicle is in the air it will fall.',
        verb: 'Stop motors',
        danger: true,
      };
  }
}

/** Sends the request of an action. @param despite codes of the findings that a person has accepted, for `arm` and `goto`. */
export function sendAction(
  api: ApiClient,
  action: Exclude<ActionName, 'offboard_start'>,
  facts: ActionFacts,
  target: GotoTarget | null = null,
  despite: readonly string[] = [],
): Promise<Outcome<unknown>> {
  const id = facts.vehicleId;
  const params = ofVehicle(id);
  switch (action) {
    case 'arm':
      return api.post('/vehicles/{v}/arm', despite.length === 0 ? params : { ...params, body: { despite } });
    case 'takeoff':
      return api.post('/vehicles/{v}/takeoff', { ...params, body: { alt_home_m: facts.takeoffAlt_home_m } });
    case 'land_now':
      return api.post('/vehicles/{v}/land_now', { ...params, body: { confirm: `vehicle ${id} lands now` } });
    case 'force_control':
      return api.post('/vehicles/{v}/control/take', { ...params, body: { force: true } });
    case 'kill':
      return api.post('/vehicles/{v}/kill', { ...params, body: { confirm: `motors stop, vehicle ${id} falls` } });
    case 'goto': {
      if (target === null) throw new Error('goto needs a target');
      const { lat_deg, lon_deg, alt_home_m } = target;
      return api.post('/vehicles/{v}/goto', { ...params, body: { lat_deg, lon_deg, alt_home_m, ...(despite.length === 0 ? {} : { despite: [...despite] }) } });
    }
    default:
      return api.post(`/vehicles/{v}/${action}`, params);
  }
}

/**
 * Why an action is not possible now; null if it is possible. Hold, Stop motors and `force_control` are possible in every
 * state of a vehicle that is not replayed. Land now is possible while the connection is lost: like Hold and Stop motors, it is
 * sent anyway.
 */
export function reasonUnavailable(action: ActionName, facts: ActionFacts & { lost: boolean; replayed: boolean }): string | null {
  if (facts.replayed) return 'A replayed vehicle accepts no commands.';
  if (action === 'hold' || action === 'kill' || action === 'force_control') return null;
  if (facts.lost && action !== 'land_now') return 'No connection to the vehicle.';
  if (action === 'takeoff' && facts.inAir) return 'The vehicle is in the air.';
  if (action === 'goto' && !facts.inAir) return 'The vehicle is on the ground: take off first.';
  if ((action === 'land' || action === 'land_now' || action === 'rtl') && !facts.inAir && !facts.armed) return 'The vehicle is on the ground.';
  return null;
}

/** Name of each action for progress texts and refusals. */
export const ACTION_NAMES: Readonly<Record<ActionName, string>> = {
  arm: 'Arm',
  disarm: 'Disarm',
  takeoff: 'Take off',
  land: 'Land',
  rtl: 'Return',
  hold: 'Hold',
  land_now: 'Land now',
  force_control: 'Take control',
  kill: 'Stop motors',
  offboard_start: 'Offboard',
  goto: 'Go here',
};

/** Reads the values for the confirmation texts from a vehicle's present state. */
export function actionFacts(facts: VehicleFacts, takeoffAlt_home_m: number): ActionFacts {
  return {
    vehicleId: facts.id,
    vehicleName: facts.name,
    armed: facts.status?.value.armed ?? false,
    inAir: facts.inAir,
    onGround: facts.status?.value.landed_state === 'on_ground',
    alt_home_m: facts.globalPosition?.value.alt_home_m ?? null,
    homeDistance_m: facts.homeDistance_m,
    mode: facts.status?.value.mode ?? '',
    streaming: facts.offboard?.streaming ?? false,
    takeoffAlt_home_m,
    battery_percent: facts.battery?.value.remaining_percent ?? null,
  };
}
