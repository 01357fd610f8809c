/** Texts about who may command a vehicle, from the topic `control`. Pure functions. */

import type { components } from '../api/schema';

export type Control = components['schemas']['Control'];
export type ControlRequest = Control['requests'][number];

/** Actions that need no control, so that every operator can stop a vehicle in danger. */
const ACTIONS_WITHOUT_CONTROL: ReadonlySet<string> = new Set(['hold', 'land_now', 'kill', 'force_control']);

/** Who has control. */
export type ControlState = 'this_page' | 'other_client' | 'free' | 'unknown';

export function readControl(value: unknown): Control | null {
  return typeof value === 'object' && value !== null && Array.isArray((value as Control).requests) ? (value as Control) : null;
}

/** @param key this page's key; null until the server has sent it. */
export function controlState(control: Control | null, key: string | null): ControlState {
  if (control === null || key === null) return 'unknown';
  if (control.holder === null) return 'free';
  return control.holder_key === key ? 'this_page' : 'other_client';
}

/** Name of another client that has control; null: this page may send commands. */
export function otherControlHolder(control: Control | null, key: string | null): string | null {
  return controlState(control, key) === 'other_client' ? (control?.holder ?? null) : null;
}

/** Text of the chip that shows who has control. */
export function chipText(control: Control | null, key: string | null): string {
  switch (controlState(control, key)) {
    case 'this_page':
      return 'You have control';
    case 'other_client':
      return `${control?.holder ?? 'Another client'} has control`;
    case 'free':
      return 'Control: nobody';
    case 'unknown':
      return 'Control: not known';
  }
}

/** Why this page may not send a command, and the remedy; null if it may. @param controlHolder the other client that has control. */
export function controlProblem(action: string, controlHolder: string | null): { detail: string; remedy: string } | null {
  if (controlHolder === null || ACTIONS_WITHOUT_CONTROL.has(action)) return null;
  return {
    detail: `${controlHolder} has control of this vehicle.`,
    remedy: 'Request control at the upper right (key C). Hold, Land now and Stop motors work without control.',
  };
}

/** Time of day at which the client got control. */
export function sinceText(control: Control): string {
  return control.since_unix_s === null ? '' : new Date(control.since_unix_s * 1000).toLocaleTimeString([], { hour12: false });
}

/** This page's request that waits for an answer; null if there is none. */
export function requestOfThisPage(control: Control | null, key: string | null): ControlRequest | null {
  return control?.requests.find((request) => request.key === key) ?? null;
}

/** The first request that this page must answer; null if there is none, or if this page does not have control. */
export function requestToAnswer(control: Control | null, key: string | null): ControlRequest | null {
  return controlState(control, key) === 'this_page' ? (control?.requests[0] ?? null) : null;
}

/** Why this page cannot take control by force yet; null if it can. */
export function forceHint(control: Control, key: string | null, denied: boolean): string | null {
  const request = requestOfThisPage(control, key);
  const holder = control.holder ?? 'The controlling client';
  if (!control.can_be_asked || denied) return null;
  if (request === null)
    return `${holder} is connected, so request control first. If ${control.holder ?? 'the controlling client'} does not answer, you can take control by force.`;
  return request.answer_left_s > 0 ? `${holder} has ${Math.ceil(request.answer_left_s)} s to answer.` : null;
}

const MODE_SOURCES: Readonly<Record<string, string>> = {
  pilot: 'the RC pilot',
  station: 'another ground station',
  unknown: 'an unknown source (not this server)',
  failsafe: 'a failsafe',
};

/** Who set the vehicle's mode, as text; null if this server set the mode, or if it is not known who did. */
export function externalModeText(control: Control | null): string | null {
  const cause = control?.mode_cause ?? null;
  if (cause === null) return null;
  const source = MODE_SOURCES[cause.source];
  return source === undefined ? null : `mode set by ${cause.who ?? source}`;
}
