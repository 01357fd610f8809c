/**
 * What this person has set, stored by the server for each name, so that each browser of the person has the same. The
 * browser keeps a copy for the first paint and for when the server is away; what was set meanwhile is sent when it is back.
 */

import type { ApiClient, Outcome } from '../api/client';
import type { Problem } from '../api/problems';
import type { components } from '../api/schema';
import type { WireEvent } from '../live/wire';
import { provideUnits } from '../ui/units';
import { availableStorage } from './identity';

/** Each value is one entry of the server's settings; null or missing: the default, which the feature that uses it has. */
export type SettingValues = components['schemas']['UserSettingValues'];
export type SettingName = keyof SettingValues;

/** Also read by `public/before-paint.js`. */
const STORAGE_KEY = 'gcs-settings-1';

interface Stored {
  readonly user: string;
  readonly values: SettingValues;
  /** What the server does not have yet. */
  readonly unsent: readonly SettingName[];
}

type SettingStorage = Pick<Storage, 'getItem' | 'setItem'>;

export class UserSettings {
  /** Whose settings these are; empty: all who have given no name. */
  user = $state('');
  private values = $state.raw<SettingValues>({});
  /** What the server does not have yet. */
  private unsent = $state.raw<ReadonlySet<SettingName>>(new Set());
  /** Why the server did not take them; null: it did, or could not be asked yet. */
  problem = $state.raw<Problem | null>(null);
  private api: ApiClient | null = null;
  private exchange: Promise<void> | null = null;
  private isAgain = false;
  /** The user has just been chosen: what the server has of this user comes first. */
  private isNewUser = false;

  constructor(private readonly storage: SettingStorage) {
    const stored = readStored(storage);
    if (stored === null) return;
    this.user = stored.user;
    this.values = stored.values;
    this.unsent = new Set(stored.unsent);
  }

  get<N extends SettingName>(name: N): NonNullable<SettingValues[N]> | null {
    return this.values[name] ?? null;
  }

  /** Whether the server has everything that was set here. */
  get isStored(): boolean {
    return this.unsent.size === 0;
  }

  /** Sets a value; null: the default. */
  set<N extends SettingName>(name: N, value: NonNullable<SettingValues[N]> | null): void {
    this.take({ ...this.values, [name]: value }, new Set([...this.unsent, name]));
    void this.synchronize();
  }

  /** Sets some entries of a value that has several; null: their default. */
  change<N extends 'units' | 'voice' | 'default_altitudes' | 'gamepad'>(name: N, entries: NonNullable<SettingValues[N]>): void {
    this.set(name, { ...this.get(name), ...entries } as NonNullable<SettingValues[N]>);
  }

  /** Begins to exchange settings with the server. @param user the name that this person has given; empty: none. */
  connect(api: ApiClient, user: string): void {
    this.api = api;
    if (user === this.user) return;
    this.user = user; // another tab of this browser has another name
    this.take(this.values, new Set());
  }

  /** Changes the user. Who has no settings yet takes along the present ones. */
  become(user: string): Promise<void> {
    this.user = user;
    this.isNewUser = true;
    this.take(this.values, new Set());
    return this.synchronize();
  }

  /** Takes over what another browser of this user has set. */
  hear(event: WireEvent): void {
    const isOwn = event['client_key'] === this.api?.key;
    if (event.kind === 'settings_changed' && !isOwn && String(event['user']).toLowerCase() === this.user.toLowerCase()) void this.synchronize();
  }

  /** Sends what the server does not have, then takes over what it has. */
  synchronize(): Promise<void> {
    this.isAgain = true;
    this.exchange ??= this.exchangeUntilDone().finally(() => (this.exchange = null));
    return this.exchange;
  }

  private async exchangeUntilDone(): Promise<void> {
    while (this.isAgain && this.api !== null) {
      this.isAgain = false;
      const { user, values, unsent, isNewUser } = this;
      const body = pick(values, unsent);
      const isRead = isNewUser || unsent.size === 0;
      const answer = isRead ? await this.api.get('/settings', this.query()) : await this.api.post('/settings', { ...this.query(), body });
      if (user !== this.user) continue;
      const left = isRead ? this.unsent : without(this.unsent, unsent, this.values, values);
      if (answer.ok) {
        const isEmpty = Object.keys(answer.value.settings).length === 0;
        if (!isRead) this.problem = null;
        if (isNewUser && isEmpty) this.take(this.values, new Set(Object.keys(this.values) as SettingName[]));
        else this.take({ ...answer.value.settings, ...pick(this.values, left) }, left);
        this.isNewUser = false;
        this.isAgain ||= isNewUser && this.unsent.size > 0;
      } else {
        this.problem = answer.problem.status === 0 ? null : answer.problem; // it is sent when the server is back
        if (answer.problem.status !== 422) continue;
        this.take(this.values, left); // not values of this server: its own apply
        this.isAgain = true;
      }
    }
  }

  /** The settings as a file. */
  async exported(): Promise<Outcome<string>> {
    await this.synchronize();
    const answer = await this.server.get('/settings', this.query());
    return answer.ok ? { ok: true, value: JSON.stringify(answer.value, null, 2) } : answer;
  }

  /** Replaces all settings by those of a file. @returns why it was not possible, and nothing has changed; null: done. */
  async imported(text: string): Promise<string | null> {
    const file = parsed(text);
    if (file === null) return 'This is not a file of settings: it is not JSON.';
    const answer = await this.server.put('/settings', { ...this.query(), body: file as components['schemas']['UserSettingsFile'] });
    if (answer.ok) this.take(answer.value.settings, new Set());
    return answer.ok ? null : settingsProblem(answer.problem);
  }

  private get server(): ApiClient {
    if (this.api === null) throw new Error('connect() comes first');
    return this.api;
  }

  private query(): { params: { query: { user: string } } } {
    return { params: { query: { user: this.user } } };
  }

  private take(values: SettingValues, unsent: ReadonlySet<SettingName>): void {
    this.values = values;
    this.unsent = unsent;
    try {
      const stored: Stored = { user: this.user, values, unsent: [...unsent] };
      this.storage.setItem(STORAGE_KEY, JSON.stringify(stored));
    } catch {
      // the browser's storage is full: the values apply, and the server has them
    }
  }
}

/** A problem of the server with settings as a sentence. */
export function settingsProblem({ status, detail, remedy }: Problem): string {
  return status === 0 ? 'The server does not answer.' : [detail, remedy].filter(Boolean).join(' ');
}

function pick(values: SettingValues, names: ReadonlySet<SettingName>): SettingValues {
  return Object.fromEntries([...names].map((name) => [name, values[name] ?? null]));
}

/** What is still to be sent, after `sent` was answered: also what was set again meanwhile. */
function without(unsent: ReadonlySet<SettingName>, sent: ReadonlySet<SettingName>, now: SettingValues, then: SettingValues): ReadonlySet<SettingName> {
  return new Set([...unsent].filter((name) => !sent.has(name) || now[name] !== then[name]));
}

function parsed(text: string): unknown {
  try {
    const file: unknown = JSON.parse(text);
    return typeof file === 'object' ? file : null;
  } catch {
    return null;
  }
}

function readStored(storage: SettingStorage): Stored | null {
  const stored = parsed(storage.getItem(STORAGE_KEY) ?? 'null') as Partial<Stored> | null;
  if (typeof stored?.user !== 'string' || typeof stored.values !== 'object' || !Array.isArray(stored.unsent)) return null;
  return stored as Stored;
}

export const userSettings = new UserSettings(availableStorage(() => localStorage));
provideUnits(() => userSettings.get('units'));
