/** Word, shape and colour of a MAV_SEVERITY. */

export type Shape = 'dot' | 'triangle' | 'square';

export interface SeverityName {
  /** Shown beside the text; empty for info. */
  word: string;
  /** Never empty, for details and screen readers. */
  full: string;
  tone: 'danger' | 'caution' | 'dim';
  shape: Shape;
}

const FULL = ['Emergency', 'Alert', 'Critical', 'Error', 'Warning', 'Notice', 'Info', 'Debug'];
const UNNAMED_SEVERITY = [5, 6];

export function severityName(severity: number): SeverityName {
  const full = FULL[severity] ?? 'Info';
  const word = UNNAMED_SEVERITY.includes(severity) ? '' : full;
  if (severity <= 3) return { word, full, tone: 'danger', shape: 'square' };
  if (severity === 4) return { word, full, tone: 'caution', shape: 'triangle' };
  return { word, full, tone: 'dim', shape: 'dot' };
}
