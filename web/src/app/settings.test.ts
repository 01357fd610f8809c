/** The settings of a user in several browsers, with a server that is away for a while. */

import { describe, expect, it } from 'vitest';
import { ApiClient } from '../api/client';
import type { WireEvent } from '../live/wire';
import { UserSettings, type SettingValues } from './settings.svelte';

/** The server's settings: what the API does, without checks. */
class SettingsServer {
  isAway = false;
  refusesTheme = false;
  readonly users = new Map<string, SettingValues>();
  requests = 0;

  readonly fetch = async (path: string, init: RequestInit): Promise<Response> => {
    this.requests += 1;
    await Promise.resolve();
    if (this.isAway) throw new TypeError('Failed to fetch');
    const user = new URL(path, 'http://page.test').searchParams.get('user') ?? '';
    const body = (typeof init.body === 'string' ? JSON.parse(init.body) : {}) as Record<string, unknown>;
    if (init.method === 'POST' && this.refusesTheme && 'theme' in body)
      return Response.json({ code: 'invalid_request', detail: 'theme: not known', field: 'theme' }, { status: 422 });
    if (init.method === 'PUT' && body['version'] !== 1)
      return Response.json({ code: 'invalid_request', detail: 'A newer version.', field: 'version' }, { status: 422 });
    if (init.method === 'PUT') this.users.set(user, body['settings'] as SettingValues);
    if (init.method === 'POST') this.users.set(user, withoutNull({ ...this.users.get(user), ...body }));
    return Response.json({ kind: 'gcs-settings', version: 1, user, settings: this.users.get(user) ?? {} });
  };
}

const withoutNull = (values: object): SettingValues => Object.fromEntries(Object.entries(values).filter(([, value]) => value !== null));

class Browser {
  readonly stored = new Map<string, string>();
  settings: UserSettings;

  constructor(
    private readonly server: SettingsServer,
    private readonly key: string,
    user = '',
  ) {
    this.settings = this.open(user);
  }

  /** A new page of this browser. */
  open(user = ''): UserSettings {
    const settings = new UserSettings({ getItem: (key) => this.stored.get(key) ?? null, setItem: (key, value) => void this.stored.set(key, value) });
    settings.connect(new ApiClient({ name: user, id: this.key, key: this.key }, undefined, this.server.fetch), user);
    this.settings = settings;
    return settings;
  }
}

const changed = (user: string, client_key: string): WireEvent => ({
  kind: 'settings_changed',
  vehicle: null,
  unix_s: 0,
  severity: 7,
  text: '',
  user,
  client_key,
});

/** Until all requests are answered. */
const settled = (): Promise<void> => new Promise((resolve) => setTimeout(resolve, 5));

describe('the settings of a user', () => {
  it('are the same in each browser of the user, and only there', async () => {
    const server = new SettingsServer();
    const [first, second, other] = [new Browser(server, 'a', 'Anna'), new Browser(server, 'b', 'Anna'), new Browser(server, 'c', 'Bert')];
    first.settings.set('theme', 'dark');
    await settled();
    for (const browser of [first, second, other]) browser.settings.hear(changed('anna', 'a'));
    await settled();
    expect([first, second, other].map(({ settings }) => settings.get('theme'))).toEqual(['dark', 'dark', null]);
  });

  it('are kept by the browser while the server is away, and are sent when it is back, beside what others have set', async () => {
    const server = new SettingsServer();
    const browser = new Browser(server, 'a');
    await browser.settings.synchronize();
    server.isAway = true;
    browser.settings.set('units', { height: 'ft' });
    await settled();
    expect([browser.settings.get('units'), browser.settings.isStored, browser.settings.problem]).toEqual([{ height: 'ft' }, false, null]);
    server.users.set('', { theme: 'light', units: { height: 'm' } });
    server.isAway = false;
    const reloaded = browser.open();
    expect(reloaded.get('units')).toEqual({ height: 'ft' }); // before the server has answered
    await reloaded.synchronize();
    expect(server.users.get('')).toEqual({ theme: 'light', units: { height: 'ft' } });
    expect([reloaded.get('theme'), reloaded.isStored]).toEqual(['light', true]);
  });

  it('are not changed back by an answer that is older than what was set meanwhile', async () => {
    const server = new SettingsServer();
    const { settings } = new Browser(server, 'a');
    settings.set('theme', 'dark');
    settings.set('theme', 'light');
    settings.change('units', { speed: 'kn' });
    settings.change('units', { height: 'ft' });
    expect([settings.get('theme'), settings.get('units')]).toEqual(['light', { speed: 'kn', height: 'ft' }]);
    await settled();
    expect(server.users.get('')).toEqual({ theme: 'light', units: { speed: 'kn', height: 'ft' } });
    expect(settings.isStored).toBe(true);
  });

  it('come along to a new name, but not over the settings that a name has', async () => {
    const server = new SettingsServer();
    server.users.set('Bert', { theme: 'light' });
    const { settings } = new Browser(server, 'a');
    settings.set('theme', 'dark');
    await settled();
    await settings.become('Anna');
    expect([server.users.get('Anna'), settings.get('theme')]).toEqual([{ theme: 'dark' }, 'dark']);
    server.isAway = true;
    await settings.become('Bert');
    server.isAway = false;
    await settings.synchronize();
    expect([server.users.get('Bert'), settings.get('theme')]).toEqual([{ theme: 'light' }, 'light']);
    expect(server.users.get('')).toEqual({ theme: 'dark' });
  });

  it('that the server refuses are named and do not stop the others', async () => {
    const server = new SettingsServer();
    server.refusesTheme = true;
    const { settings } = new Browser(server, 'a');
    settings.set('theme', 'dark');
    await settled();
    expect([settings.problem?.field, settings.get('theme')]).toEqual(['theme', null]);
    settings.set('language', 'de');
    await settled();
    expect([server.users.get(''), settings.problem]).toEqual([{ language: 'de' }, null]);
  });

  it('are exported and imported; what is no such file changes nothing', async () => {
    const server = new SettingsServer();
    const { settings } = new Browser(server, 'a', 'Anna');
    settings.set('theme', 'dark');
    const file = await settings.exported();
    const bert = new Browser(server, 'b', 'Bert').settings;
    expect(await bert.imported(file.ok ? file.value : '')).toBeNull();
    expect([bert.get('theme'), server.users.get('Bert')]).toEqual(['dark', { theme: 'dark' }]);
    expect(await bert.imported('PK\u0003\u0004')).toContain('not JSON');
    expect(await bert.imported('{"version": 2, "settings": {}}')).toContain('newer version');
    server.isAway = true;
    expect(await bert.imported('{"version": 1, "settings": {}}')).toBe('The server does not answer.');
    expect([bert.get('theme'), server.users.get('Bert')]).toEqual(['dark', { theme: 'dark' }]);
  });

  it.each(['', 'null', '{', '[]', '{"user": 1}', '{"user": "", "values": 3, "unsent": []}'])(
    'are the defaults if the browser’s copy is damaged: %s',
    (text) => {
      const storage = { getItem: () => text, setItem: () => undefined };
      expect(new UserSettings(storage).get('theme')).toBeNull();
    },
  );
});
