/** Errors of a plan that a person can accept. */

import { placeText } from '../offboard/place';
import type { Finding } from '../document/fixes';
import type { Document } from '../document-kinds';

const keyOf = ({ code, text, place }: Finding): string => JSON.stringify([code, text, place]);
const isError = ({ severity }: Finding): boolean => severity === 'error';

/** Errors of a plan that a person has accepted, for exactly one document and one vehicle. */
export class AcceptedErrors {
  private acceptance = $state.raw<{ readonly document: Document | null; readonly vehicle: string | null; readonly keys: readonly string[] }>({
    document: null,
    vehicle: null,
    keys: [],
  });

  has(finding: Finding, document: Document, vehicle: string | null): boolean {
    return this.acceptance.document === document && this.acceptance.vehicle === vehicle && this.acceptance.keys.includes(keyOf(finding));
  }

  /** Accepts an error, or withdraws its acceptance. Any change of the plan withdraws all acceptances. */
  set(finding: Finding, document: Document, vehicle: string | null, accepted: boolean): void {
    const keys = this.acceptance.document === document && this.acceptance.vehicle === vehicle ? this.acceptance.keys : [];
    const otherKeys = keys.filter((key) => key !== keyOf(finding));
    this.acceptance = { document, vehicle, keys: accepted ? [...otherKeys, keyOf(finding)] : otherKeys };
  }

  /** Separates the errors that prevent the start (`blocking`) from the accepted errors. */
  split(findings: readonly Finding[], document: Document, vehicle: string | null): { blocking: readonly Finding[]; accepted: readonly Finding[] } {
    const errors = findings.filter(isError);
    return { blocking: errors.filter((error) => !this.has(error, document, vehicle)), accepted: errors.filter((error) => this.has(error, document, vehicle)) };
  }
}

export function findingCodes(findings: readonly Finding[]): string[] {
  return [...new Set(findings.map(({ code }) => code))];
}

export const findingText = ({ text, place }: Finding): string => (place.step === null ? text : `${placeText(place.step)}: ${text}`);

/** Text for a confirmation that lists all accepted errors; empty if there are none. */
export function acceptedErrorsText(texts: readonly string[]): string {
  return texts.length === 0 ? '' : `You accepted ${texts.length} ${texts.length === 1 ? 'error' : 'errors'}: ${texts.join(' ')}`;
}

export class RoleAssignment {
  vehicles = $state.raw<Readonly<Record<string, string>>>({});

  choose(role: string, vehicle: string): void {
    this.vehicles = { ...this.vehicles, [role]: vehicle };
  }

  rename(old: string, name: string): void {
    const { [old]: vehicle = '', ...otherVehicles } = this.vehicles;
    this.vehicles = { ...otherVehicles, [name]: vehicle };
  }

  /** The vehicles of these roles; an empty text for a role without a vehicle. */
  forRoles(roles: readonly string[]): Record<string, string> {
    return Object.fromEntries(roles.map((role) => [role, this.vehicles[role] ?? '']));
  }
}
