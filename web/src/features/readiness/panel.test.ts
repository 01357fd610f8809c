import { expect, test } from 'vitest';
import { ApiClient } from '../../api/client';
import { readiness } from './panel.svelte';

test('a mode can be chosen while the check is still running', async () => {
  const requests: string[] = [];
  let answerCheck = (): void => undefined;
  const api = new ApiClient('p', undefined, async (path) => {
    requests.push(path.replace('/api/v1', ''));
    if (path.endsWith('/readiness/check')) await new Promise<void>((done) => (answerCheck = done));
    return Response.json({});
  });
  const check = readiness.check(api, '1');
  await readiness.choose(api, '1', 'hold');
  expect(requests).toEqual(['/vehicles/1/readiness/check', '/vehicles/1/mode']);
  expect([readiness.checking, readiness.choosing]).toEqual([true, false]);
  answerCheck();
  await check;
  expect(readiness.checking).toBe(false);
});
