/** A message of the dialect that a person writes and sends. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';
import { parse, type Definition, type Value } from './messages';

/** What would be sent, frozen when a person pressed Send, until it is confirmed. */
export interface Draft {
  readonly vehicle: string;
  readonly message: string;
  readonly fields: Readonly<Record<string, Value>>;
  readonly whileArmed: boolean;
}

/** Filled in by the server. */
const ADDRESS = new Set(['target_system', 'target_component']);
const COMMAND = 'Send a MAVLink message';

export class MessageForm {
  names = $state.raw<readonly string[]>([]);
  definition = $state.raw<Definition | null>(null);
  /** What was typed, by field. */
  texts = $state<Record<string, string>>({});
  toConfirm = $state.raw<Draft | null>(null);
  private last = $state.raw<{ readonly vehicle: string; readonly problem: Problem | null; readonly result: string | null } | null>(null);

  constructor(private readonly gate = new CommandGate()) {}

  problemOf(vehicle: string): Problem | null {
    return this.last?.vehicle === vehicle ? this.last.problem : null;
  }

  /** How the last message was answered; null: not sent. */
  resultOf(vehicle: string): string | null {
    return this.last?.vehicle === vehicle ? this.last.result : null;
  }

  /** The fields that a person fills in. */
  get fields(): Definition['fields'] {
    return (this.definition?.fields ?? []).filter(({ name }) => !ADDRESS.has(name));
  }

  async load(api: ApiClient): Promise<void> {
    if (this.names.length > 0) return;
    const answer = await api.get('/mavlink/messages');
    if (answer.ok) this.names = answer.value.messages;
  }

  async choose(api: ApiClient, name: string): Promise<void> {
    this.toConfirm = null;
    if (!this.names.includes(name)) {
      this.definition = null;
      return;
    }
    const answer = await api.get('/mavlink/messages/{name}', { params: { path: { name } } });
    if (!answer.ok) return;
    this.definition = answer.value;
    this.texts = {};
  }

  /** Asks for confirmation of what has been typed. */
  ask(vehicle: string, whileArmed: boolean): void {
    const { definition } = this;
    if (definition === null) return;
    const fields: Record<string, Value> = {};
    for (const field of this.fields) {
      const text = this.texts[field.name] ?? '';
      if (text.trim() === '') continue;
      const parsed = parse(field, text);
      if ('problem' in parsed) {
        this.fail(vehicle, parsed.problem);
        return;
      }
      fields[field.name] = parsed.value;
    }
    this.last = null;
    this.toConfirm = { vehicle, message: definition.name, fields, whileArmed };
  }

  /** Sends what a person has confirmed. */
  async send(api: ApiClient, draft: Draft): Promise<void> {
    this.toConfirm = null;
    this.last = null;
    const { vehicle, message, whileArmed } = draft;
    const fields = draft.fields as Record<string, number | string | null>;
    const outcome = await this.gate.run({ name: COMMAND, vehicles: [vehicle], part: message }, () =>
      api.post('/vehicles/{v}/mavlink/send', {
        params: { path: { v: vehicle } },
        body: { message, fields, while_armed: whileArmed, confirm: `${message} is sent unchecked to vehicle ${vehicle}` },
      }),
    );
    if (!outcome.ok) {
      if (outcome.problem.code !== DOUBLE_CLICK) this.last = { vehicle, problem: outcome.problem, result: null };
      return;
    }
    const { acknowledged, result } = outcome.value;
    this.last = { vehicle, problem: null, result: acknowledged === null ? 'Sent; this message has no answer.' : (result ?? 'Sent; no answer came.') };
  }

  private fail(vehicle: string, detail: string): void {
    this.last = { vehicle, problem: { title: 'Not sent', detail, reasons: [], remedy: null, code: 'refused', status: 0, field: null }, result: null };
  }
}
