/** Errors of a plan that a person has accepted, each for exactly this plan and vehicle. */

import type { Outcome } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { Finding } from '../document/fixes';
import type { Document } from '../document-kinds';

const keyOf = ({ code, text, place }: Finding): string => JSON.stringify([code, text, place]);
const isError = ({ severity }: Finding): boolean => severity === 'error';

export class AcceptedErrors {
  private acceptance = $state.raw<{ readonly of: Document | null; readonly vehicle: string | null; readonly keys: readonly string[] }>({
    of: null,
    vehicle: null,
    keys: [],
  });

  has(finding: Finding, of: Document, vehicle: string | null): boolean {
    return this.acceptance.of === of && this.acceptance.vehicle === vehicle && this.acceptance.keys.includes(keyOf(finding));
  }

  /** Any change of the plan withdraws all acceptances. */
  set(finding: Finding, of: Document, vehicle: string | null, accepted: boolean): void {
    const before = this.acceptance.of === of && this.acceptance.vehicle === vehicle ? this.acceptance.keys : [];
    const others = before.filter((key) => key !== keyOf(finding));
    this.acceptance = { of, vehicle, keys: accepted ? [...others, keyOf(finding)] : others };
  }

  /** Separates the errors that prevent the start (`open`) from the accepted ones (`despite`). */
  split(findings: readonly Finding[], of: Document, vehicle: string | null): { open: readonly Finding[]; despite: readonly Finding[] } {
    const errors = findings.filter(isError);
    return { open: errors.filter((one) => !this.has(one, of, vehicle)), despite: errors.filter((one) => this.has(one, of, vehicle)) };
  }
}

/** Errors that the server finds only at a start, because then it knows where all vehicles are and what they fly. */
export class StartErrors {
  private refusal = $state.raw<{ readonly of: Document; readonly vehicles: string; readonly problem: Problem } | null>(null);
  /** A person has accepted all of them. */
  accepted = $state(false);

  /** Keeps the errors of a refused start. Any change of the plan or of its vehicles withdraws the acceptance. */
  setOutcome(outcome: Outcome<unknown>, of: Document, vehicles: Readonly<Record<string, string>>): void {
    const found = !outcome.ok && outcome.problem.codes !== undefined;
    this.refusal = found ? { of, vehicles: JSON.stringify(vehicles), problem: outcome.problem } : null;
    this.accepted = false;
  }

  findings(of: Document, vehicles: Readonly<Record<string, string>>): readonly string[] {
    return this.appliesTo(of, vehicles) ? (this.refusal?.problem.reasons ?? []) : [];
  }

  /** The accepted codes, for the next start; empty if they are not accepted. */
  codes(of: Document, vehicles: Readonly<Record<string, string>>): readonly string[] {
    return this.accepted && this.appliesTo(of, vehicles) ? (this.refusal?.problem.codes ?? []) : [];
  }

  private appliesTo(of: Document, vehicles: Readonly<Record<string, string>>): boolean {
    return this.refusal?.of === of && this.refusal.vehicles === JSON.stringify(vehicles);
  }
}

export function findingCodes(findings: readonly Finding[]): string[] {
  return [...new Set(findings.map(({ code }) => code))];
}

export const findingText = ({ text, place }: Finding): string => (place.step === null ? text : `${place.step}: ${text}`);

/** Text for a confirmation, which lists each accepted error; empty if there are none. */
export function acceptedErrorsText(findings: readonly string[]): string {
  return findings.length === 0 ? '' : `You accepted ${findings.length} ${findings.length === 1 ? 'error' : 'errors'}: ${findings.join(' ')}`;
}
