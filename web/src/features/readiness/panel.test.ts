import { expect, test } from 'vitest';
import { ApiClient } from '../../api/client';
import { readinessPanel } from './panel.svelte';

test('the mode can be switched while a check is running', async () => {
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
  expect([readinessPanel.checking, readinessPanel.switching]).toEqual([true, false]);
  endCheck();
  await check;
  expect(readinessPanel.checking).toBe(false);
});
