import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { ActionController } from '../../app/actions/controller.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import { modeGroups, modeTexts, type ModeChoice, type ModeRow } from './mode-texts';
import { ModeMenu } from './modes.svelte';

const choice = (mode: string, more: Partial<ModeChoice> = {}): ModeChoice => ({ mode, label: mode, settable: true, can_run: true, reasons: [], ...more });
const factsOf = (armed: boolean, more: object = {}): VehicleFacts =>
  ({
    id: '1',
    name: 'Quad 1',
    lost: false,
    replayed: false,
    inAir: armed,
    status: { value: { armed, mode: 'hold' } },
    globalPosition: { value: { alt_home_m: 12 } },
    ...more,
  }) as unknown as VehicleFacts;
const rowOf = (each: ModeChoice, facts: VehicleFacts): ModeRow => modeGroups([each], facts)[0]?.rows[0] as ModeRow;

describe('the modes', () => {
  it('are grouped by who flies, in the vehicle’s order, with the current one marked', () => {
    const modes = ['position', 'hold', 'external_1', 'mission', 'acro'].map((mode) => choice(mode));
    const groups = modeGroups(modes, factsOf(true));
    expect(groups.map(({ rows }) => rows.map(({ mode }) => mode))).toEqual([['hold', 'mission'], ['external_1'], ['position', 'acro']]);
    expect(groups.flatMap(({ rows }) => rows.filter(({ isCurrent }) => isCurrent).map(({ mode }) => mode))).toEqual(['hold']);
  });
  it('say why one cannot be entered in flight; a disarmed vehicle accepts it, with a caution', () => {
    const position = choice('position', { can_run: false, reasons: ['No RC transmitter or joystick.'] });
    expect(rowOf(position, factsOf(true))).toMatchObject({ whyNot: 'No RC transmitter or joystick.', caution: null });
    const onGround = rowOf(position, factsOf(false));
    expect(onGround).toMatchObject({ whyNot: null, caution: 'No RC transmitter or joystick.' });
    expect(modeTexts(onGround, factsOf(false)).effect).toContain('cannot fly in this mode now: No RC transmitter or joystick.');
    expect(rowOf(choice('orbit', { settable: false, reasons: ['Orbit needs a centre.'] }), factsOf(false)).whyNot).toBe('Orbit needs a centre.');
    expect(rowOf(choice('hold'), factsOf(true, { replayed: true })).whyNot).toContain('replayed');
    expect(rowOf(choice('takeoff'), factsOf(true)).whyNot).toBe('The vehicle is in the air.');
    expect(rowOf(choice('mission'), factsOf(true, { lost: true })).whyNot).toBe('No connection to the vehicle.');
    expect(rowOf(choice('hold'), factsOf(true, { lost: true })).whyNot).toBeNull();
    // The page starts the stream that Offboard needs.
    expect(rowOf(choice('offboard', { can_run: false, reasons: ['No offboard signal.'] }), factsOf(true)).whyNot).toBeNull();
  });
  it('are confirmed by what the vehicle does; a mode that does not hold itself is dangerous in flight', () => {
    const acro = rowOf(choice('acro', { label: 'Acro' }), factsOf(true));
    expect(modeTexts(acro, factsOf(true))).toMatchObject({
      title: 'Mode Acro: Quad 1',
      danger: true,
      effect: expect.stringContaining('does not level itself'),
    });
    expect(modeTexts(acro, factsOf(false)).danger).toBe(false);
    const streaming = factsOf(true, { offboard: { streaming: true } });
    expect(modeTexts(rowOf(choice('external_2', { label: 'Survey' }), streaming), streaming).effect).toMatch(
      /another program.*12\.0 m above home now\. Offboard ends\./,
    );
  });
});

describe('the menu', () => {
  const requests: { path: string; answer: (response: Response) => void }[] = [];
  const api = new ApiClient('p', undefined, (path) => new Promise((resolve) => requests.push({ path, answer: resolve })));
  const actions = new ActionController(api, () => 0, () => Promise.reject(new Error('not used')), () => factsOf(true)); // prettier-ignore
  const menu = new ModeMenu(api, actions, () => factsOf(true));

  it('shows the newest answer, keeps the list if a later reading fails, and never shows another vehicle’s', async () => {
    const [first, second] = [menu.read('1'), menu.read('1')];
    requests[1]?.answer(Response.json({ vehicle: '1', of_vehicle: true, modes: [choice('hold')] }));
    requests[0]?.answer(Response.json({ vehicle: '1', of_vehicle: true, modes: [] }));
    await Promise.all([first, second]);
    expect(menu.listOf('1')?.modes).toHaveLength(1);
    const failed = menu.read('1');
    requests[2]?.answer(Response.json({ code: 'disconnected', detail: 'Vehicle 1 is not connected.' }, { status: 503 }));
    await failed;
    expect(menu.listOf('1')).toMatchObject({ modes: [{ mode: 'hold' }], problem: { detail: 'Vehicle 1 is not connected.' } });
    expect(menu.listOf('2')).toBeNull();
  });
  it('sends Hold at once, and asks before Land, Return and any other mode', () => {
    requests.length = 0;
    menu.choose(rowOf(choice('hold'), factsOf(true)), factsOf(true));
    expect(requests.map(({ path }) => path)).toEqual(['/api/v1/vehicles/1/hold']);
    for (const mode of ['land', 'rtl', 'position']) {
      menu.choose(rowOf(choice(mode), factsOf(true)), factsOf(true));
      expect(actions.confirmation?.command.vehicles, mode).toEqual(['1']);
    }
    expect(requests.filter(({ path }) => !path.includes('/params/')).length).toBe(1);
  });
});
