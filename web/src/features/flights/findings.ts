/** What a log means, as the server finds it: loaded when the log is open. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';

type Schemas = components['schemas'];
export type Finding = Schemas['LogFinding'];
type NotJudged = Schemas['NotJudged'];
export type Findings = Schemas['FlightFindings'];

export type FindingsOrProblem = { readonly findings: Findings } | { readonly problem: Problem };

export async function loadFindings(api: ApiClient, id: string): Promise<FindingsOrProblem> {
  const response = await api.get('/flights/{f}/findings', { params: { path: { f: id } } });
  return response.ok ? { findings: response.value } : { problem: response.problem };
}

/** The findings of a log, and those of the flight beside its plan, by time. */
export function withFindings(answer: FindingsOrProblem | null, more: readonly Finding[]): FindingsOrProblem | null {
  if (answer === null || 'problem' in answer || more.length === 0) return answer;
  const findings = [...answer.findings.findings, ...more].sort((a, b) => a.begin_s - b.begin_s);
  return { findings: { ...answer.findings, findings } };
}

/** What could not be judged, by its reason: one line for all kinds that lack the same. */
export function missing(notJudged: readonly NotJudged[]): readonly { reason: string; titles: readonly string[] }[] {
  const titles = new Map<string, Set<string>>();
  for (const { reason, title } of notJudged) titles.set(reason, (titles.get(reason) ?? new Set()).add(title));
  return [...titles].map(([reason, set]) => ({ reason, titles: [...set] }));
}

/** Whether the vehicles of findings must be named: the log has several. */
export const severalVehicles = (findings: readonly Finding[]): boolean => new Set(findings.map(({ vehicle }) => vehicle)).size > 1;
