import { expect, it } from 'vitest';
import { severityName } from '../../ui/severity';
import { filterMessages } from './panel.svelte';

it('shows the severity of severe messages as a word, and hides debug messages', () => {
  expect(severityName(2)).toMatchObject({ label: 'Critical', tone: 'danger' });
  expect(severityName(6).label).toBe('');
  const message = (severity: number) => ({ key: `${severity}`, unix_s: 0, severity, kind: 'event', text: 'x' });
  expect(filterMessages([message(7), message(6), message(4)], 1).map((m) => m.severity)).toEqual([6]);
});
