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
  fieldErrors,
  setpointsFor,
  startBody,
  startTexts,
  groupText,
  type Draft,
  type SetpointsResult,
  type FieldErrors,
} from './group-form';

/** Name of the command that starts a group. */
export const GROUP = 'Group';

class GroupDraft {
  fields = $state.raw<Draft>(NEW_DRAFT);
  /** False until a person presses Start, Send or Renew. */
  showsErrors = $state(false);

  edit(changed: Partial<Draft>): void {
    this.fields = { ...this.fields, ...changed };
  }

  setMember(id: string, isMember: boolean): void {
    this.edit({ members: isMember ? [...this.fields.members, id] : this.fields.members.filter((member) => member !== id) });
  }

  errors(isFlying: boolean): FieldErrors {
    return this.showsErrors ? fieldErrors(this.fields, isFlying) : {};
  }

  /** Opens the confirmation; if the form has errors, shows all errors instead. */
  requestStart(): void {
    const fields = this.fields;
    this.showsErrors = true;
    if (Object.keys(fieldErrors(fields, false)).length > 0) return;
    const names = fields.members.map((id) => page.factsOf(id)?.name ?? id);
    actions.requestCommand(
      { name: GROUP, vehicles: fields.members, vehicleNames: joinNames(names), texts: () => startTexts(names, fields), send: () => this.start(fields) },
      'offboardRoom',
    );
  }

  /** Starts the group. Offsets are relative to each vehicle's current position, not to its position when the confirmation opened. */
  private async start(fields: Draft): Promise<Outcome<unknown>> {
    const result = setpointsFor(factsOf(fields.members), fields);
    if (!result.ok) return positionsUnknownRefusal(result);
    groups.dismissEnded();
    return this.sendAndLog(fields.members, fields, () => groups.start(startBody(result.setpoints, fields, page.store.nowUnixS()), validityOf(fields)));
  }

  /** Sends new setpoints to all members that still follow the group, without a confirmation, like the room's other forms. */
  async send(group: Group): Promise<void> {
    const fields = this.fields;
    this.showsErrors = true;
    if (Object.keys(fieldErrors(fields, true)).length > 0) return;
    const members = group.members.filter((m) => !m.held).map((m) => m.vehicle);
    const send = async (): Promise<Outcome<unknown>> => {
      const result = setpointsFor(factsOf(members), fields);
      return result.ok ? this.sendAndLog(members, fields, () => groups.send(group, result.setpoints, validityOf(fields))) : positionsUnknownRefusal(result);
    };
    await actions.attempt({ ...groups.commandTo(group), name: `Group ${group.id}`, send }, 'offboardRoom');
  }

  /** Renews the group's setpoints once, with the form's validity for setpoints of this type. If the form's checkbox is set, this page continues to renew them. */
  async renew(group: Group): Promise<void> {
    const renewalDraft: Draft = { ...this.fields, motion: motionOf(group) };
    this.showsErrors = true;
    if ('valid' in fieldErrors(renewalDraft, true)) return;
    const send = (): Promise<Outcome<unknown>> => groups.renew(group, validityOf(renewalDraft));
    await actions.attempt({ ...groups.commandTo(group), name: `Renewing group ${group.id}`, send }, 'offboardRoom');
  }

  private async sendAndLog(members: readonly string[], fields: Draft, send: () => Promise<Outcome<unknown>>): Promise<Outcome<unknown>> {
    const lineId = editor.recordSent('group', { type: groupText(joinNames(members), fields) });
    const outcome = await send();
    editor.recordOutcome(lineId, outcome, null);
    if (outcome.ok) {
      // The form's offset is reset, because sending the same offset again would move the vehicles again.
      if (fields.motion === 'move') this.edit({ axes: { ...this.fields.axes, move: NEW_DRAFT.axes.move } });
      return outcome;
    }
    const { detail, remedy } = outcome.problem;
    return { ok: false, problem: { ...outcome.problem, detail: formText(detail), remedy: remedy === null ? null : formText(remedy) } };
  }
}

/** Ids of all vehicles that the server can command, including vehicles that are not connected now. */
export function commandableIds(): string[] {
  return page.eachRepaint(() => page.ids.filter((id) => isCommandable(page.store.vehicles.get(id)?.identity ?? UNKNOWN_IDENTITY)));
}

function factsOf(ids: readonly string[]): VehicleFacts[] {
  return ids.map((id) => page.factsOf(id)).filter((facts) => facts !== null);
}

function positionsUnknownRefusal(result: Extract<SetpointsResult, { ok: false }>): Outcome<never> {
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
