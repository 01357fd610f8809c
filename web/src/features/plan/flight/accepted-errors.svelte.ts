/** Errors of a plan and errors of a start, which a person can accept. */

import type { Outcome } from '../../../api/client';
import type { Problem } from '../../../api/problems';
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

/**
 * Errors that the server finds only at a start, for example between the flights of different vehicles. A start is
 * identified by the document and a key, such as the vehicle of each role.
 */
export class StartErrors {
  private refusal = $state.raw<{ readonly document: Document; readonly startKey: string; readonly problem: Problem } | null>(null);
  /** Whether a person has accepted these errors. */
  accepted = $state(false);

  /** Stores the errors of a refused start for this document and key, and withdraws the acceptance of the previous errors. */
  setOutcome(outcome: Outcome<unknown>, document: Document, startKey: Readonly<Record<string, string>>): void {
    const hasErrors = !outcome.ok && outcome.problem.codes !== undefined;
    this.refusal = hasErrors ? { document, startKey: JSON.stringify(startKey), problem: outcome.problem } : null;
    this.accepted = false;
  }

  /** Texts of the errors that the server found at this start. */
  texts(document: Document, startKey: Readonly<Record<string, string>>): readonly string[] {
    return this.appliesTo(document, startKey) ? (this.refusal?.problem.reasons ?? []) : [];
  }

  /** The codes of the accepted errors, for the next start; empty if the errors are not accepted. */
  acceptedCodes(document: Document, startKey: Readonly<Record<string, string>>): readonly string[] {
    return this.accepted && this.appliesTo(document, startKey) ? (this.refusal?.problem.codes ?? []) : [];
  }

  private appliesTo(document: Document, startKey: Readonly<Record<string, string>>): boolean {
    return this.refusal?.document === document && this.refusal.startKey === JSON.stringify(startKey);
  }
}

export function findingCodes(findings: readonly Finding[]): string[] {
  return [...new Set(findings.map(({ code }) => code))];
}

export const findingText = ({ text, place }: Finding): string => (place.step === null ? text : `${place.step}: ${text}`);

/** Text for a confirmation that lists all accepted errors; empty if there are none. */
export function acceptedErrorsText(texts: readonly string[]): string {
  return texts.length === 0 ? '' : `You accepted ${texts.length} ${texts.length === 1 ? 'error' : 'errors'}: ${texts.join(' ')}`;
}
