import { describe, expect, it } from 'vitest';
import { loadIdentity, markUnloaded, setName } from '../app/identity';
import {
  chipText,
  forceHint,
  controlProblem,
  otherControlHolder,
  externalModeText,
  requestOfThisPage,
  readControl,
  controlState,
  requestToAnswer,
  type Control,
} from './control';

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
const REQUEST = { client: 'Bob', key: 'b', reason: null, since_unix_s: 1, answer_left_s: 11.2 };
const ANNA_CONTROLS: Control = { ...FREE, holder: 'Anna', holder_key: 'a', since_unix_s: 1, can_be_asked: true };

function memoryStorage(): Storage {
  const stored = new Map<string, string>();
  return {
    getItem: (k: string) => stored.get(k) ?? null,
    setItem: (k: string, v: string) => void stored.set(k, v),
    removeItem: (k: string) => void stored.delete(k),
  } as Storage;
}

describe('control', () => {
  it('belongs to this page, to another client or to nobody, or is unknown', () => {
    expect(controlState(ANNA_CONTROLS, 'a')).toBe('this_page');
    expect(controlState(ANNA_CONTROLS, 'b')).toBe('other_client');
    expect(controlState(FREE, 'a')).toBe('free');
    expect(controlState(ANNA_CONTROLS, null)).toBe('unknown');
    expect([chipText(ANNA_CONTROLS, 'a'), chipText(ANNA_CONTROLS, 'b'), chipText(FREE, 'a')]).toEqual([
      'You have control',
      'Anna has control',
      'Control: nobody',
    ]);
    expect(otherControlHolder(ANNA_CONTROLS, 'a')).toBeNull();
    expect(readControl({ holder: 'x' })).toBeNull();
  });
  it('blocks commands that need control, but never Hold, Land now and Stop motors', () => {
    expect(controlProblem('takeoff', 'Anna')).toMatchObject({ detail: 'Anna has control of this vehicle.' });
    for (const command of ['hold', 'land_now', 'kill']) expect(controlProblem(command, 'Anna')).toBeNull();
    expect(controlProblem('takeoff', null)).toBeNull();
  });
  it('shows a request only to the controlling client and the requester', () => {
    const withRequest = { ...ANNA_CONTROLS, requests: [REQUEST] };
    expect(requestToAnswer(withRequest, 'a')).toEqual(REQUEST);
    expect(requestToAnswer(withRequest, 'b')).toBeNull();
    expect(requestOfThisPage(withRequest, 'b')).toEqual(REQUEST);
  });
  it('can be taken by force only after a request that was denied or not answered', () => {
    expect(forceHint(ANNA_CONTROLS, 'b', false)).toBe('Anna is connected, so request control first. If Anna does not answer, you can take control by force.');
    expect(forceHint({ ...ANNA_CONTROLS, requests: [REQUEST] }, 'b', false)).toBe('Anna has 12 s to answer.');
    expect(forceHint({ ...ANNA_CONTROLS, requests: [{ ...REQUEST, answer_left_s: 0 }] }, 'b', false)).toBeNull();
    expect(forceHint(ANNA_CONTROLS, 'b', true)).toBeNull();
    expect(forceHint({ ...ANNA_CONTROLS, can_be_asked: false }, 'b', false)).toBeNull();
  });
  it('shows who outside this server set the mode', () => {
    const controlWithCause = (source: string, who: string | null = null): Control => ({
      ...FREE,
      mode_cause: { source, who, text: '', since_unix_s: 1 } as Control['mode_cause'],
    });
    expect(externalModeText(controlWithCause('pilot'))).toBe('mode set by the RC pilot');
    expect(externalModeText(controlWithCause('station', 'station 245/190'))).toBe('mode set by station 245/190');
    expect(externalModeText(controlWithCause('command', 'Anna'))).toBeNull();
    expect(externalModeText(FREE)).toBeNull();
  });
});

describe('the page’s identity', () => {
  it('stays the same after a reload, and differs in a duplicated tab', () => {
    const tabStorage = memoryStorage();
    const browserStorage = memoryStorage();
    const first = loadIdentity(tabStorage, browserStorage);
    expect(loadIdentity(tabStorage, browserStorage).id).not.toBe(first.id); // a duplicated tab: the original is still open
    const second = loadIdentity(tabStorage, browserStorage);
    markUnloaded(tabStorage);
    expect(loadIdentity(tabStorage, browserStorage).id).toBe(second.id);
  });
  it('stores a person’s name in the browser', () => {
    const browserStorage = memoryStorage();
    const identity = loadIdentity(memoryStorage(), browserStorage);
    expect(identity.name).toMatch(/^page-[0-9a-f]{4}$/);
    setName(identity, '  Anna ', browserStorage);
    expect([identity.name, loadIdentity(memoryStorage(), browserStorage).name]).toEqual(['Anna', 'Anna']);
    setName(identity, '', browserStorage);
    expect(identity.name).toMatch(/^page-/);
  });
});
