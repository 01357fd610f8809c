/** The state of the group form and the actions of its buttons. */

import type { VehicleFacts } from '../../../vehicle/facts';
import { page } from '../../../app/page.svelte';
import { actions } from '../../../app/vehicle-actions.svelte';
import { groups } from '../controllers';
import type { Outcome } from '../../../api/client';
import { UNKNOWN_IDENTITY } from '../../../live/vehicle-state';
import { editor } from '../setpoints/editor.svelte';
import { isCommandable, joinNames, type Group } from './group';
import {
  motionOf,
  formText,
  validityOf,
  NEW_DRAFT,
  problemsOf,
  setpointsFor,
  startBody,
  startQuestion,
  groupText,
  type Draft,
  type SetpointsResult,
  type Problems,
} from './group-form';

class GroupDraft {
  fields = $state.raw<Draft>(NEW_DRAFT);
  /** False until a person presses Start, Send or Renew. */
  showsErrors = $state(false);

  edit(changed: Partial<Draft>): void {
    this.fields = { ...this.fields, ...changed };
  }

  choose(id: string, chosen: boolean): void {
    this.edit({ members: chosen ? [...this.fields.members, id] : this.fields.members.filter((member) => member !== id) });
  }

  problems(flying: boolean): Problems {
    return this.showsErrors ? problemsOf(this.fields, flying) : {};
  }

  /** Shows all errors of the form, or opens the confirmation if there are none. */
  requestStart(selected: VehicleFacts): void {
    const draft = this.fields;
    this.showsErrors = true;
    if (Object.keys(problemsOf(draft, false)).length > 0) return;
    const names = draft.members.map((id) => page.factsOf(id)?.name ?? id);
    actions.requestForGroup(
      { commandName: 'Group', names: joinNames(names), question: () => startQuestion(names, draft), run: () => this.start(draft) },
      selected,
      'panel',
    );
  }

  /** Starts the group. Offsets are relative to each vehicle's current position, not to its position when the confirmation opened. */
  private async start(draft: Draft): Promise<Outcome<unknown>> {
    const result = setpointsFor(factsOf(draft.members), draft);
    if (!result.ok) return noPositions(result);
    groups.dismissEnded();
    return this.sendLogged(draft.members, draft, () => groups.start(startBody(result.setpoints, draft, page.store.nowUnixS()), validityOf(draft)));
  }

  /** Sends new setpoints to all members that still follow the group, without a confirmation, like the room's other forms. */
  async send(group: Group): Promise<void> {
    const draft = this.fields;
    this.showsErrors = true;
    if (Object.keys(problemsOf(draft, true)).length > 0) return;
    const members = group.members.filter((m) => !m.held).map((m) => m.vehicle);
    await actions.attempt(`Group ${group.id}`, { name: joinNames(groups.names(group)) }, 'panel', async (): Promise<Outcome<unknown>> => {
      const result = setpointsFor(factsOf(members), draft);
      return result.ok ? this.sendLogged(members, draft, () => groups.send(group, result.setpoints, validityOf(draft))) : noPositions(result);
    });
  }

  /** Renews the group's setpoints once, with the form's validity for their motion; this page continues to renew them if the form's checkbox is set. */
  async renew(group: Group): Promise<void> {
    const renewed: Draft = { ...this.fields, motion: motionOf(group) };
    this.showsErrors = true;
    if ('valid' in problemsOf(renewed, true)) return;
    await actions.attempt(`Renewing group ${group.id}`, { name: joinNames(groups.names(group)) }, 'panel', () => groups.renew(group, validityOf(renewed)));
  }

  private async sendLogged(members: readonly string[], draft: Draft, send: () => Promise<Outcome<unknown>>): Promise<Outcome<unknown>> {
    const line = editor.recordSent('group', { type: `Group of ${joinNames(members)}: ${groupText(draft)}` });
    const outcome = await send();
    editor.recordOutcome(line, outcome, null);
    if (outcome.ok) {
      // The form is cleared: sent again, the same offset would move the vehicles again.
      if (draft.motion === 'move') this.edit({ axes: { ...this.fields.axes, move: NEW_DRAFT.axes.move } });
      return outcome;
    }
    const { detail, remedy } = outcome.problem;
    return { ok: false, problem: { ...outcome.problem, detail: formText(detail), remedy: remedy === null ? null : formText(remedy) } };
  }
}

/** Ids of all vehicles that the server can command, also of vehicles that are not connected now. */
export function commandableIds(): string[] {
  void page.tick;
  return page.ids.filter((id) => isCommandable(page.store.vehicles.get(id)?.identity ?? UNKNOWN_IDENTITY));
}

function factsOf(ids: readonly string[]): VehicleFacts[] {
  return ids.map((id) => page.factsOf(id)).filter((facts) => facts !== null);
}

function noPositions(result: Extract<SetpointsResult, { ok: false }>): Outcome<never> {
  return {
    ok: false,
    problem: {
      title: 'Not sent',
      detail: result.detail,
      reasons: [],
      remedy: 'Wait until each vehicle reports its position, or use a velocity.',
      code: 'refused',
      status: 0,
      field: null,
    },
  };
}

export const draft = new GroupDraft();
