import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import type { CommandToConfirm } from '../../app/actions/command.svelte';
import type { ActionController } from '../../app/actions/controller.svelte';
import type { ParamChanges } from '../../app/param-changes/changes.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import { applyText, AutotuneControl, confirmationTexts, outcomeText, PART, type AutotuneState } from './autotune.svelte';

const facts = (mode = 'position', id = '1'): VehicleFacts =>
  ({ id, name: `Quad ${id}`, status: { value: { mode, mode_label: mode === 'hold' ? 'Hold' : 'Position' } } }) as unknown as VehicleFacts;
const OPERATION = { id: '7', kind: 'autotune', vehicle: '1', state: 'running', progress: 0.2, text: 'Moves.', result: null, error: null };
const STATE: AutotuneState = { enabled: true, apply: 0, running: false, problem: null, remedy: null };

let operations: object[] = [];
let state = STATE;
let asked: string[] = [];
let sent: { method: string; path: string; body: unknown }[] = [];
let present = facts();
let requested: CommandToConfirm[] = [];
let control: AutotuneControl;

beforeEach(() => {
  vi.useFakeTimers();
  [operations, state, asked, sent, present, requested] = [[], STATE, [], [], facts(), []];
  const api = new ApiClient('test', undefined, (path, { method, body }) => {
    if (method === undefined || method === 'GET') {
      asked.push(path.replace(/^.*\/api\/v1/, ''));
      return Promise.resolve(Response.json(path.includes('/operations') ? { operations } : state));
    }
    sent.push({ method, path, body: typeof body === 'string' ? JSON.parse(body) : null });
    return Promise.resolve(Response.json(OPERATION, { status: 202 }));
  });
  const actions = {
    requestCommand: (command: CommandToConfirm, part: string) => {
      expect(part).toBe(PART);
      requested.push(command);
    },
    attempt: async (command: CommandToConfirm) => (await command.send([], null as never)).ok,
  } as unknown as ActionController;
  control = new AutotuneControl(api, actions, () => present, {} as ParamChanges);
});
afterEach(() => void vi.useRealTimers());

const pass = (ms: number): Promise<unknown> => vi.advanceTimersByTimeAsync(ms);
const settingsAsked = (): number => asked.filter((path) => path.includes('/vehicles/1/autotune')).length;

describe('autotune', () => {
  it('says before the start what the vehicle does, where, and what becomes of the gains', () => {
    const { effect, danger } = confirmationTexts(facts('hold'), 0);
    expect(effect).toMatch(/^Shakes itself about roll, pitch and yaw for 40 to 70 s, in Hold.*4 to 20 m.*Goes on without this page.*only in the log/);
    expect(danger).toBe(false);
    expect(confirmationTexts(facts(), 1)).toMatchObject({ danger: true, effect: expect.stringContaining('writes the gains itself once it is disarmed') });
    expect(applyText(2)).toContain('in flight, without a proof');
    expect(applyText(null)).toContain('not known');
  });

  it.each([
    [0, []],
    [1, ['autotune_applies_after_disarming']],
    [2, ['autotune_applies_in_flight']],
  ])('accepts with MC_AT_APPLY %i what the confirmation said, and what was accepted after a refusal', async (apply, said) => {
    state = { ...STATE, apply };
    const stop = control.watch('1');
    await pass(0);
    control.start(facts());
    state = { ...STATE, apply: 2 }; // changed while the confirmation is open: the server then refuses
    await requested[0]?.send(['autotune_low'], null as never);
    expect(sent).toEqual([{ method: 'POST', path: expect.stringContaining('/vehicles/1/autotune'), body: { despite: [...said, 'autotune_low'] } }]);
    stop();
  });

  it('is not started in another mode than the one that was confirmed', () => {
    control.start(facts('position'));
    expect(requested[0]?.changed?.()).toBeNull();
    present = facts('hold');
    expect(requested[0]?.changed?.()).toContain('The mode of Quad 1 has changed');
  });

  it('shows whoever’s run, asks the vehicle for its settings only when none is followed, and reads them after its end', async () => {
    operations = [{ ...OPERATION, id: '5', state: 'failed' }, { ...OPERATION, id: '6', kind: 'parameters/read' }, OPERATION];
    const stop = control.watch('1');
    await pass(5000);
    expect(control.of('1')?.operation?.id).toBe('7');
    expect(control.of('2')).toBeNull();
    expect(settingsAsked()).toBe(0);
    operations = [{ ...OPERATION, state: 'succeeded', result: { outcome: 'complete', apply: 0 } }];
    await pass(1000);
    expect(settingsAsked()).toBeGreaterThanOrEqual(1);
    expect(control.of('1')?.state).toEqual(STATE);
    stop();
    const before = asked.length;
    await pass(5000);
    expect(asked).toHaveLength(before);
  });

  it('drops the answer about a vehicle that is no longer shown', async () => {
    const stop = control.watch('1');
    const other = control.watch('2');
    await pass(100);
    expect([control.of('1'), control.of('2')?.vehicle]).toEqual([null, '2']);
    stop(); // of the first, after the second has begun
    await pass(3000);
    expect(control.of('2')?.state).toEqual(STATE);
    other();
  });

  it('is ended by its own call, which may be repeated', async () => {
    expect(await control.end(facts('hold'))).toBe(true);
    expect(await control.end(facts('hold'))).toBe(true);
    expect(sent.map(({ method }) => method)).toEqual(['DELETE', 'DELETE']);
  });

  it('says what to do with the gains', () => {
    const ended = (result: object | null, of = 'succeeded'): string | null => outcomeText({ ...OPERATION, state: of, result } as never);
    expect(ended({ outcome: 'complete', apply: 0 })).toContain('prove them under Tuning');
    expect(ended({ outcome: 'complete', apply: 2 })).toContain('has written and tested them');
    expect(ended({ outcome: 'waits_for_disarming', apply: 1 })).toContain('when it is disarmed');
    expect([ended(null, 'failed'), ended(null, 'running')]).toEqual([null, null]);
  });
});
