import { expect, it, vi } from 'vitest';
import type { ApiClient } from '../../api/client';
import { instanceText, kindText, SimulatorView, type Simulator } from './simulator.svelte';

const PX4: Simulator = {
  kind: 'px4',
  source: 'PX4 build (/px4)',
  agent: 'no agent',
  instances: [{ instance: 1, system_id: 2, state: 'crashed', restarts: 3, problem: 'It ended.', console: '' }],
};

it('says what runs', () => {
  expect(kindText(PX4)).toBe('PX4 build (/px4); no agent');
  expect(kindText({ kind: null, instances: [] })).toContain('no simulated vehicle');
  expect(kindText({ kind: 'bundled', instances: [] })).toContain('--sim px4');
  expect(PX4.instances.map(instanceText)).toEqual(['vehicle 2 · crashed · restarted 3 ×']);
});

it('reads every two seconds while it is shown, and never twice at once', async () => {
  vi.useFakeTimers();
  const answers: ((value: unknown) => void)[] = [];
  const get = vi.fn(() => new Promise((resolve) => answers.push(resolve)));
  const view = new SimulatorView();
  const stop = view.watch({ get } as unknown as ApiClient);
  vi.advanceTimersByTime(10_000);
  expect(get).toHaveBeenCalledTimes(1);
  answers[0]?.({ ok: true, value: PX4 });
  await vi.advanceTimersByTimeAsync(2000);
  expect(view.state).toEqual(PX4);
  expect(get).toHaveBeenCalledTimes(2);
  answers[1]?.({ ok: false, problem: { title: 'No connection', detail: '' } });
  await vi.advanceTimersByTimeAsync(0);
  expect(view.problem?.title).toBe('No connection');
  expect(view.state).toEqual(PX4);
  stop();
  await vi.advanceTimersByTimeAsync(10_000);
  expect(get).toHaveBeenCalledTimes(2);
  vi.useRealTimers();
});
