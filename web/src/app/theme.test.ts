import { expect, it, vi } from 'vitest';

it('is applied before its variables are read, as what draws itself may draw before the page’s frame', async () => {
  let systemChanges: (event: { matches: boolean }) => void = () => undefined;
  const dataset: Record<string, string> = { theme: 'light' };
  vi.stubGlobal('matchMedia', () => ({ matches: false, addEventListener: (_: string, listener: typeof systemChanges) => (systemChanges = listener) }));
  vi.stubGlobal('document', { documentElement: { dataset } });
  vi.stubGlobal('getComputedStyle', () => ({ getPropertyValue: (name: string) => ` ${name} of ${dataset['theme']} ` }));
  vi.doMock('./settings.svelte', () => ({ userSettings: { get: () => null } }));
  const { theme } = await import('./theme.svelte');
  expect(theme.variables()('--text')).toBe('--text of light');
  systemChanges({ matches: true });
  expect(theme.variables()('--text')).toBe('--text of dark');
});
