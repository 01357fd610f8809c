/** Name, shape and colour of a MAV_SEVERITY. */

export type Shape = 'dot' | 'triangle' | 'square';

export interface SeverityName {
  /** Name shown beside a message; empty for notice and info. */
  word: string;
  /** Name for details and screen readers; never empty. */
  full: string;
  tone: 'danger' | 'caution' | 'dim';
  shape: Shape;
}

const FULL = ['Emergency', 'Alert', 'Critical', 'Error', 'Warning', 'Notice', 'Info', 'Debug'];
/** Notice and info. */
const WITHOUT_WORD = [5, 6];

export function severityName(severity: number): SeverityName {
  const full = FULL[severity] ?? 'Info';
  const word = WITHOUT_WORD.includes(severity) ? '' : full;
  if (severity <= 3) return { word, full, tone: 'danger', shape: 'square' };
  if (severity === 4) return { word, full, tone: 'caution', shape: 'triangle' };
  return { word, full, tone: 'dim', shape: 'dot' };
}
