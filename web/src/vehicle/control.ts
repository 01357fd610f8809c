/** Who may command a vehicle, in words: the topic `control` as the page reads it. Pure. */

import type { components } from '../api/schema';

export type Control = components['schemas']['Control'];
export type ControlRequest = Control['requests'][number];

/** What needs no control: who sees danger stops it. */
const OPEN: ReadonlySet<string> = new Set(['hold', 'land_now', 'kill', 'force_control']);

export type Standing = 'yours' | 'others' | 'free' | 'unknown';

export function readControl(value: unknown): Control | null {
  return typeof value === 'object' && value !== null && Array.isArray((value as Control).requests) ? (value as Control) : null;
}

/** @param key this page's own; null until the server has told it. */
export function standing(control: Control | null, key: string | null): Standing {
  if (control === null || key === null) return 'unknown';
  if (control.holder === null) return 'free';
  return control.holder_key === key ? 'yours' : 'others';
}

/** The holder's name where it is another client; null: commands of this page are not in its way. */
export function otherHolder(control: Control | null, key: string | null): string | null {
  return standing(control, key) === 'others' ? (control?.holder ?? null) : null;
}

export function chipText(control: Control | null, key: string | null): string {
  switch (standing(control, key)) {
    case 'yours':
      return 'You have control';
    case 'others':
      return `${control?.holder ?? 'Another client'} has control`;
    case 'free':
      return 'Control is free';
    case 'unknown':
      return 'Control –';
  }
}

/** Why a command of this page would be refused, and what to do; null where it would not be. */
export function notYours(action: string, holder: string | null): { detail: string; remedy: string } | null {
  if (holder === null || OPEN.has(action)) return null;
  return {
    detail: `${holder} has control of this vehicle.`,
    remedy: 'Request control at the upper right (key C). Hold, Land now and Stop motors work without it.',
  };
}

/** Since when, as a time of day. */
export function sinceText(control: Control): string {
  return control.since_unix_s === null ? '' : new Date(control.since_unix_s * 1000).toLocaleTimeString([], { hour12: false });
}

/** This page's own request that waits for its answer. */
export function ownRequest(control: Control | null, key: string | null): ControlRequest | null {
  return control?.requests.find((one) => one.key === key) ?? null;
}

/** Whom this page is to answer: the first who asks, while it holds control. */
export function toAnswer(control: Control | null, key: string | null): ControlRequest | null {
  return standing(control, key) === 'yours' ? (control?.requests[0] ?? null) : null;
}

/** Whether another's control may be taken by force now; else the words why not yet. */
export function forceHint(control: Control, key: string | null, denied: boolean): string | null {
  const asked = ownRequest(control, key);
  if (!control.can_be_asked || denied) return null;
  if (asked === null) return `Request control first: ${control.holder ?? 'the holder'} is connected.`;
  return asked.answer_left_s > 0 ? `${Math.ceil(asked.answer_left_s)} s left to answer.` : null;
}

const WHO: Readonly<Record<string, string>> = {
  pilot: 'the RC pilot',
  station: 'another ground station',
  unknown: 'not this server',
  failsafe: 'the failsafe',
};

/** Who makes the vehicle fly its mode, where it is nobody of this server; null where there is nothing to add. */
export function outsideText(control: Control | null): string | null {
  const cause = control?.mode_cause ?? null;
  if (cause === null) return null;
  const who = WHO[cause.source];
  return who === undefined ? null : `by ${cause.who ?? who}`;
}
