/** Offboard missions that are registered with PX4 as flight modes, as texts. Pure functions. */

import type { ConfirmationTexts } from '../../../app/actions/actions';
import type { components } from '../../../api/schema';
import type { Finding } from '../document/fixes';
import type { Mission } from './mission';
import { blockingErrorsText } from './mission-flight';

export type MissionMode = Readonly<components['schemas']['MissionModeStatus']>;
/** Longest name of a mode in PX4. */
export const MAX_NAME_LENGTH = 24;
/** Longest time for which PX4 may defer a failsafe [s]. */
const MAX_DEFERRAL_S = 120;
/** Printable ASCII characters without a space at the beginning or end. */
const NAME_PATTERN = /^[!-~]([ -~]{0,22}[!-~])?$/;

/** A name for the mode of a mission: printable ASCII characters, at most as long as PX4 permits. */
export function modeName(missionName: string): string {
  const ascii = missionName.normalize('NFKD').replace(/[^ -~]/g, '');
  return ascii.trim().slice(0, MAX_NAME_LENGTH).trim();
}

/** Parses the time for which PX4 may defer a failsafe, in whole seconds; empty text is 0 (never). Null: not valid. */
export function parseDeferral(text: string): number | null {
  const trimmedText = text.trim();
  if (!/^[0-9]{0,3}$/.test(trimmedText)) return null;
  const deferral_s = Number(trimmedText);
  return deferral_s <= MAX_DEFERRAL_S ? deferral_s : null;
}

/** Why the typed time is not valid; null: it is valid. */
export function deferralProblem(text: string): string | null {
  return parseDeferral(text) === null ? `Enter a whole number from 0 (never) to ${MAX_DEFERRAL_S}.` : null;
}

/**
 * Why a mission cannot be registered under this name; null: it can be registered.
 * @param blockingErrors errors that are not accepted; null: the mission has not been checked. A missing take-off is not
 *   counted as an error, because the mode of a mission without a take-off begins in the air.
 */
export function registerProblem(name: string, mission: Mission, blockingErrors: readonly Finding[] | null, modes: readonly MissionMode[]): string | null {
  if (!NAME_PATTERN.test(name)) return `The name of the mode must have 1 to ${MAX_NAME_LENGTH} ASCII characters.`;
  if (modes.some((mode) => mode.name === name && (mode.state === 'registered' || mode.state === 'registering')))
    return `A mode “${name}” is already registered. Remove it first, or choose another name.`;
  if (blockingErrors === null) return 'The mission has not been checked for this vehicle yet.';
  const takesOff = mission.steps?.[0]?.step === 'take_off';
  const errors = blockingErrors.filter((finding) => takesOff || finding.code !== 'takeoff_missing');
  if (errors.length === 0) return null;
  return blockingErrorsText(errors);
}

/** How the mission of a mode is started. */
function startText(mode: MissionMode): string {
  return mode.takes_off
    ? 'The vehicle takes off and starts the mission when it is armed in this mode on the ground.'
    : 'The mission starts when this mode is selected in flight.';
}

/** State of a mode as text. @param currentMode the vehicle's mode. */
export function modeText(mode: MissionMode, currentMode: string | null): { text: string; tone: 'ok' | 'dim' | 'caution' | 'danger' | 'target' } {
  switch (mode.state) {
    case 'registering':
      return { text: 'Being registered …', tone: 'dim' };
    case 'registered':
      if (mode.failsafe_deferred)
        return {
          text: `A failsafe has been triggered. PX4 defers it for at most ${mode.defer_failsafes_s} s, or until the vehicle leaves this mode.`,
          tone: 'danger',
        };
      if (!mode.ready) return { text: `Registered, but cannot be started now: ${mode.reason}`, tone: 'caution' };
      return mode.mode === currentMode ? { text: 'Selected', tone: 'target' } : { text: `Registered. ${startText(mode)}`, tone: 'ok' };
    default:
      return { text: mode.reason === '' ? 'Not registered' : `Not registered: ${mode.reason}`, tone: 'caution' };
  }
}

/** Whether the page can select the mode now: it is registered, and the vehicle is in another mode. */
export function canSelect(mode: MissionMode, currentMode: string | null): boolean {
  return mode.state === 'registered' && mode.mode !== null && mode.mode !== currentMode;
}

/** Whether the mode can be removed: not while the vehicle flies in it. */
export function canRemove(mode: MissionMode, currentMode: string | null, inAir: boolean): boolean {
  return mode.state !== 'registering' && !(inAir && mode.mode !== null && mode.mode === currentMode);
}

/** What arming does after the mode was selected on the ground. */
function armingText(mode: MissionMode): string {
  return mode.takes_off
    ? `The vehicle takes off and flies the mission “${mode.mission}”${versionText(mode)} as soon as somebody arms it in this mode.`
    : `PX4 does not arm in this mode, because the mission “${mode.mission}”${versionText(mode)} does not begin with a take-off. Take off first, then select the mode.`;
}

/** What selecting the mode does in flight. */
function inFlightText(mode: MissionMode): string {
  const missionEffect = mode.takes_off
    ? `continues the mission “${mode.mission}”${versionText(mode)} if it was suspended. Otherwise the vehicle holds, because the mission begins with a take-off.`
    : `flies the mission “${mode.mission}”${versionText(mode)} from its current position.`;
  return `Switches to the flight mode “${mode.name}”, and ${missionEffect} If the server fails or loses the connection to the vehicle, the vehicle returns (RTL) after about 1 s. Hold interrupts the mission; you can resume it.`;
}

function versionText(mode: MissionMode): string {
  return mode.version === null ? '' : ` (version ${mode.version})`;
}

export function selectTexts(mode: MissionMode, vehicleName: string, inAir: boolean): ConfirmationTexts {
  const deferralText =
    mode.defer_failsafes_s > 0
      ? ` During the mission, PX4 defers these failsafes for up to ${mode.defer_failsafes_s} s: lost ground station connection, lost manual control, low battery.`
      : '';
  if (!inAir)
    return {
      title: `Select “${mode.name}” for ${vehicleName}`,
      effect: `Switches to the flight mode “${mode.name}”. ${armingText(mode)}${deferralText}`,
      verb: 'Select',
      danger: false,
    };
  return {
    title: `Start “${mode.name}” with ${vehicleName}`,
    effect: `${inFlightText(mode)}${deferralText}`,
    verb: 'Start',
    danger: false,
  };
}
