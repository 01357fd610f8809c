/** Name, shape and colour of a MAV_SEVERITY. */

export type Shape = 'dot' | 'triangle' | 'square';

export interface SeverityName {
  /** Name shown beside a message; empty for notice and info. */
  label: string;
  /** Name for details and screen readers; never empty. */
  fullName: string;
  tone: 'danger' | 'caution' | 'dim';
  shape: Shape;
}

const FULL_NAMES = ['Emergency', 'Alert', 'Critical', 'Error', 'Warning', 'Notice', 'Info', 'Debug'];
/** Notice and info: normal messages. */
const SEVERITIES_WITHOUT_LABEL = [5, 6];

export function severityName(severity: number): SeverityName {
  const fullName = FULL_NAMES[severity] ?? 'Info';
  const label = SEVERITIES_WITHOUT_LABEL.includes(severity) ? '' : fullName;
  if (severity <= 3) return { label, fullName, tone: 'danger', shape: 'square' };
  if (severity === 4) return { label, fullName, tone: 'caution', shape: 'triangle' };
  return { label, fullName, tone: 'dim', shape: 'dot' };
}
