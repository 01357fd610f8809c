import { expect, test } from 'vitest';
import type { ApiClient } from '../../api/client';
import { readiness } from './panel.svelte';

test('a mode is chosen while the check is still on its way: what a pilot presses is never dropped', async () => {
  const asked: string[] = [];
  let answerCheck = (): void => undefined;
  const api = {
    post: async (path: string) => {
      asked.push(path);
      if (path.endsWith('/readiness/check')) await new Promise<void>((done) => (answerCheck = done));
      return { ok: true, body: {} };
    },
  } as unknown as ApiClient;
  const check = readiness.check(api, '1');
  await readiness.choose(api, '1', 'hold');
  expect(asked).toEqual(['/vehicles/1/readiness/check', '/vehicles/1/mode']);
  expect([readiness.asking, readiness.choosing]).toEqual([true, false]);
  answerCheck();
  await check;
  expect(readiness.asking).toBe(false);
});
