import { expect, it } from 'vitest';
import { severityName } from '../../ui/severity';
import { filterMessages, ownWords } from './panel.svelte';

it('shows the severity of severe messages as a word, and hides debug messages', () => {
  expect(severityName(2)).toMatchObject({ label: 'Critical', tone: 'danger' });
  expect(severityName(6).label).toBe('');
  const message = (severity: number) => ({ key: `${severity}`, unix_s: 0, severity, kind: 'event', text: 'x' });
  expect(filterMessages([message(7), message(6), message(4)], 1).map((m) => m.severity)).toEqual([6]);
});

it('calls this page “you”, except in texts of the vehicle', () => {
  const words = (text: string, kind = 'control'): string => ownWords({ kind, text }, 'Page 12');
  expect(words('Page 12 has taken control of vehicle 1.')).toBe('You have taken control of vehicle 1.');
  expect(words('Interrupted by Page 12.')).toBe('Interrupted by you.');
  expect(words('Page 12', 'status_text')).toBe('Page 12');
  expect(words('Anna has taken control of vehicle 1.')).toBe('Anna has taken control of vehicle 1.');
});
