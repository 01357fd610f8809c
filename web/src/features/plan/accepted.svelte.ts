/** Errors of a plan that a person flies despite: each by name, of just this plan and vehicle. */

import type { Finding } from './fixes';
import type { Document } from './kinds';

const keyOf = ({ code, text, place }: Finding): string => JSON.stringify([code, text, place]);
const isError = ({ severity }: Finding): boolean => severity === 'error';

export class Accepted {
  private given = $state.raw<{ readonly of: Document | null; readonly vehicle: string | null; readonly keys: readonly string[] }>({
    of: null,
    vehicle: null,
    keys: [],
  });

  has(finding: Finding, of: Document, vehicle: string | null): boolean {
    return this.given.of === of && this.given.vehicle === vehicle && this.given.keys.includes(keyOf(finding));
  }

  /** After any change of the plan everything is asked anew. */
  set(finding: Finding, of: Document, vehicle: string | null, accepted: boolean): void {
    const before = this.given.of === of && this.given.vehicle === vehicle ? this.given.keys : [];
    const others = before.filter((key) => key !== keyOf(finding));
    this.given = { of, vehicle, keys: accepted ? [...others, keyOf(finding)] : others };
  }

  /** Errors that stand in the way, and those that are flown despite. */
  split(findings: readonly Finding[], of: Document, vehicle: string | null): { open: readonly Finding[]; despite: readonly Finding[] } {
    const errors = findings.filter(isError);
    return { open: errors.filter((one) => !this.has(one, of, vehicle)), despite: errors.filter((one) => this.has(one, of, vehicle)) };
  }
}

export function codesOf(findings: readonly Finding[]): string[] {
  return [...new Set(findings.map(({ code }) => code))];
}

/** For a confirmation: each of them by name; empty without any. */
export function despiteText(findings: readonly Finding[]): string {
  if (findings.length === 0) return '';
  const each = findings.map(({ text, place }) => (place.step === null ? text : `${place.step}: ${text}`));
  return `Despite ${findings.length === 1 ? 'an error' : `${findings.length} errors`}: ${each.join(' ')}`;
}
