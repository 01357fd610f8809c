import { describe, expect, it } from 'vitest';
import { identity, leave, rename } from '../app/identity';
import { chipText, forceHint, controlProblem, otherHolder, outsideText, ownRequest, readControl, controlState, requestToAnswer, type Control } from './control';

const FREE: Control = {
  holder: null,
  holder_key: null,
  since_unix_s: null,
  expires_in_s: null,
  can_be_asked: false,
  on_expiry: null,
  requests: [],
  lease_s: 30,
  answer_s: 15,
  mode_cause: null,
};
const ASKING = { client: 'Bob', key: 'b', reason: null, since_unix_s: 1, answer_left_s: 11.2 };
const ANNAS: Control = { ...FREE, holder: 'Anna', holder_key: 'a', since_unix_s: 1, can_be_asked: true };

function memory(): Storage {
  const kept = new Map<string, string>();
  return {
    getItem: (k: string) => kept.get(k) ?? null,
    setItem: (k: string, v: string) => void kept.set(k, v),
    removeItem: (k: string) => void kept.delete(k),
  } as Storage;
}

describe('who has control', () => {
  it('is this page, another client, nobody, or unknown', () => {
    expect(controlState(ANNAS, 'a')).toBe('yours');
    expect(controlState(ANNAS, 'b')).toBe('others');
    expect(controlState(FREE, 'a')).toBe('free');
    expect(controlState(ANNAS, null)).toBe('unknown');
    expect([chipText(ANNAS, 'a'), chipText(ANNAS, 'b'), chipText(FREE, 'a')]).toEqual(['You have control', 'Anna has control', 'Control is free']);
    expect(otherHolder(ANNAS, 'a')).toBeNull();
    expect(readControl({ holder: 'x' })).toBeNull();
  });
  it('refuses commands that need control, never those that do not', () => {
    expect(controlProblem('takeoff', 'Anna')).toMatchObject({ detail: 'Anna has control of this vehicle.' });
    for (const open of ['hold', 'land_now', 'kill']) expect(controlProblem(open, 'Anna')).toBeNull();
    expect(controlProblem('takeoff', null)).toBeNull();
  });
  it('shows a request only to the holder and the requester', () => {
    const asked = { ...ANNAS, requests: [ASKING] };
    expect(requestToAnswer(asked, 'a')).toEqual(ASKING);
    expect(requestToAnswer(asked, 'b')).toBeNull();
    expect(ownRequest(asked, 'b')).toEqual(ASKING);
  });
  it('allows force only after a request', () => {
    expect(forceHint(ANNAS, 'b', false)).toBe('Anna is connected, so request control first. If Anna does not answer, you can take control by force.');
    expect(forceHint({ ...ANNAS, requests: [ASKING] }, 'b', false)).toBe('Anna has 12 s to answer.');
    expect(forceHint({ ...ANNAS, requests: [{ ...ASKING, answer_left_s: 0 }] }, 'b', false)).toBeNull();
    expect(forceHint(ANNAS, 'b', true)).toBeNull();
    expect(forceHint({ ...ANNAS, can_be_asked: false }, 'b', false)).toBeNull();
  });
  it('shows who outside this server commands the mode', () => {
    const cause = (source: string, who: string | null = null): Control => ({
      ...FREE,
      mode_cause: { source, who, text: '', since_unix_s: 1 } as Control['mode_cause'],
    });
    expect(outsideText(cause('pilot'))).toBe('mode set by the RC pilot');
    expect(outsideText(cause('station', 'station 245/190'))).toBe('mode set by station 245/190');
    expect(outsideText(cause('command', 'Anna'))).toBeNull();
    expect(outsideText(FREE)).toBeNull();
  });
});

describe('the page’s identity', () => {
  it('survives a reload, and differs in a duplicated tab', () => {
    const tab = memory();
    const browser = memory();
    const first = identity(tab, browser);
    expect(identity(tab, browser).id).not.toBe(first.id); // a duplicated tab: the original is still open
    const second = identity(tab, browser);
    leave(tab);
    expect(identity(tab, browser).id).toBe(second.id);
  });
  it('stores a person’s name in the browser', () => {
    const browser = memory();
    const who = identity(memory(), browser);
    expect(who.name).toMatch(/^page-[0-9a-f]{4}$/);
    rename(who, '  Anna ', browser);
    expect([who.name, identity(memory(), browser).name]).toEqual(['Anna', 'Anna']);
    rename(who, '', browser);
    expect(who.name).toMatch(/^page-/);
  });
});
