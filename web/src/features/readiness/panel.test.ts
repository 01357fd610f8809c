import { expect, test } from 'vitest';
import { ApiClient } from '../../api/client';
import { ReadinessPanel } from './panel.svelte';

test('the mode can be switched while a check is running', async () => {
  const readinessPanel = new ReadinessPanel();
  const requests: string[] = [];
  let endCheck = (): void => undefined;
  const api = new ApiClient('p', undefined, async (path) => {
    requests.push(path.replace('/api/v1', ''));
    if (path.endsWith('/readiness/check')) await new Promise<void>((resolve) => (endCheck = resolve));
    return Response.json({});
  });
  const check = readinessPanel.check(api, '1');
  await readinessPanel.switchMode(api, '1', 'hold');
  expect(requests).toEqual(['/vehicles/1/readiness/check', '/vehicles/1/mode']);
  expect([readinessPanel.isChecking('1'), readinessPanel.isSwitching('1')]).toEqual([true, false]);
  endCheck();
  await check;
  expect(readinessPanel.isChecking('1')).toBe(false);
});
