/**
 * All active groups, this page's and others'. Events update them, and they are polled once a second while there is
 * one.
 */

import type { ApiClient, Outcome } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { CommandQueue } from '../../../api/command-queue';
import type { WireEvent } from '../../../live/wire';
import type { ActionController } from '../../../app/actions/controller.svelte';
import { asBody, type AnySetpoint, type Validity } from '../../../vehicle/setpoint';
import type { GroupBody, MemberSetpoint } from './group-form';
import { isLive, keyOf, lastEnded, readGroup, withGroup, type Group, type ReceivedGroup } from './group';
import { GroupRenewer, type RenewalResult } from './renewer';

const POLL_INTERVAL_S = 1;

export class GroupController {
  list = $state.raw<readonly ReceivedGroup[]>([]);
  /** Key of this page's group whose setpoints are renewed. */
  renewedKey = $state<string | null>(null);
  private seenLive = $state.raw<ReadonlySet<string>>(new Set());
  private readonly renewer = new GroupRenewer((group, validity) => this.sendRenewal(group, validity));
  /**
   * This page's setpoints of the members, by group. Each renewal sends them again, except for members that got their
   * own setpoint since.
   */
  private readonly setpoints = new Map<string, Map<string, AnySetpoint>>();
  private polledAt_s = -Infinity;
  private polling = false;
  private connection: unknown = null;

  constructor(
    private readonly api: ApiClient,
    private readonly queue: CommandQueue,
    private readonly actions: Pick<ActionController, 'attempt'>,
    private readonly nowS: () => number,
    /** Whether the page is visible. */
    private readonly isVisible: () => boolean,
    private readonly nameOf: (vehicle: string) => string,
    /** Stops renewing a vehicle's own setpoint, which would conflict with the group. */
    private readonly stopVehicleRenewal: (vehicle: string) => void,
  ) {}

  readonly live = $derived(this.list.filter((one) => isLive(one.group)));
  readonly lastEnded = $derived(lastEnded(this.list, this.seenLive));
  /** The group that this page started or commands. */
  readonly pageGroup = $derived.by(() => this.live.find((one) => this.isOwn(one.group)) ?? null);

  isOwn(group: Group): boolean {
    return this.api.key !== null && group.client_key === this.api.key;
  }

  names(group: Group): string[] {
    return group.members.map((member) => this.nameOf(member.vehicle));
  }

  /** The group that a vehicle flies in. */
  of(vehicle: string): Group | null {
    return this.live.find((one) => one.group.members.some((m) => m.vehicle === vehicle))?.group ?? null;
  }

  /** Dismisses the ended group. */
  dismissEnded(): void {
    this.seenLive = new Set([...this.seenLive].filter((key) => this.live.some((one) => keyOf(one.group) === key)));
  }

  onEvent(event: WireEvent): void {
    const group = event.kind === 'group' ? readGroup(event['group']) : null;
    if (group !== null) this.update(group);
  }

  /**
   * Called as telemetry arrives. @param connection identifies the connection; after a change, earlier groups may no
   * longer exist.
   */
  tick(connection: unknown): void {
    const now_s = this.nowS();
    const isNewConnection = connection !== this.connection;
    this.connection = connection;
    if (isNewConnection || (this.live.length > 0 && this.isVisible() && now_s - this.polledAt_s >= POLL_INTERVAL_S)) void this.poll(now_s);
    const renewed = this.list.find((one) => this.renewer.isRenewing(one.group));
    if (renewed === undefined || !this.queue.busy(vehiclesOf(renewed.group)))
      this.renewer.tick(
        now_s,
        this.list.map((one) => one.group),
        this.isVisible(),
      );
    this.updateRenewedKey();
  }

  async start(body: GroupBody, validity: Validity): Promise<Outcome<Group>> {
    for (const { vehicle } of body.members) this.stopVehicleRenewal(vehicle);
    const members = body.members.map(({ vehicle, setpoint }) => ({ vehicle, setpoint: asBody(setpoint) }));
    const outcome = await this.api.post('/groups', { body: { ...body, members } });
    if (outcome.ok) this.onAccepted(outcome.value, body.members, validity);
    return outcome;
  }

  /** Sends new setpoints to some members and renews the others; without new ones, renews all. */
  async send(group: Group, setpoints: readonly MemberSetpoint[], validity: Validity): Promise<Outcome<Group>> {
    for (const { vehicle } of setpoints) this.stopVehicleRenewal(vehicle);
    return this.enqueue(group, async () => {
      const outcome = await this.post(group, setpoints, validity);
      if (outcome.ok) this.onAccepted(outcome.value, setpoints, validity);
      else if (outcome.problem.status === 0) this.stopRenewing(); // it is unknown which setpoints are flown: a renewal might undo the new ones
      return outcome;
    });
  }

  /** Renews all present setpoints. */
  renew(group: Group, validity: Validity): Promise<Outcome<Group>> {
    return this.enqueue(group, async () => {
      const outcome = await this.post(group, this.currentSetpoints(group), validity);
      if (outcome.ok) this.onAccepted(outcome.value, [], validity);
      return outcome;
    });
  }

  /** The vehicle got its own setpoint: renewals of the group leave it out. */
  onVehicleSetpoint(vehicle: string): void {
    for (const sentSetpoints of this.setpoints.values()) sentSetpoints.delete(vehicle);
  }

  async hold(group: Group): Promise<void> {
    this.stopRenewing();
    await this.actions.attempt(`Hold group ${group.id}`, { name: this.names(group).join(', ') }, 'room', async () => {
      const outcome = await this.api.post('/groups/{g}/hold', pathOf(group));
      if (outcome.ok) this.update(outcome.value);
      return outcome;
    });
  }

  /** Shows a problem, for example a refused renewal, beside the buttons. */
  async showProblem(what: string, vehicleName: string, problem: Problem): Promise<void> {
    await this.actions.attempt(what, { name: vehicleName }, 'room', () => Promise.resolve({ ok: false, problem }));
  }

  private async sendRenewal(group: Group, validity: Validity): Promise<RenewalResult> {
    const outcome = await this.enqueue(group, () => this.post(group, this.currentSetpoints(group), validity));
    if (outcome.ok) {
      this.update(outcome.value);
      return 'accepted';
    }
    if (outcome.problem.status === 0) return 'no answer';
    await this.showProblem(`Renewing group ${group.id}`, this.names(group).join(', '), outcome.problem);
    return 'refused';
  }

  /** This page's setpoints of the members that still follow the group. */
  private currentSetpoints(group: Group): MemberSetpoint[] {
    const sentSetpoints = this.setpoints.get(keyOf(group));
    return group.members.flatMap(({ vehicle, held }) => {
      const setpoint = sentSetpoints?.get(vehicle);
      return held || setpoint === undefined ? [] : [{ vehicle, setpoint }];
    });
  }

  /** Calls `send` after earlier requests to these vehicles have been answered, so that `send` reads the present setpoints. */
  private enqueue(group: Group, send: () => Promise<Outcome<Group>>): Promise<Outcome<Group>> {
    return this.queue.run(vehiclesOf(group), send);
  }

  private post(group: Group, setpoints: readonly MemberSetpoint[], { valid_for_s, on_expiry }: Validity): Promise<Outcome<Group>> {
    return this.api.post('/groups/{g}/setpoints', {
      ...pathOf(group),
      body: { setpoints: setpoints.map(({ vehicle, setpoint }) => ({ vehicle, setpoint: asBody(setpoint) })), valid_for_s, on_expiry },
    });
  }

  private onAccepted(group: Group, setpoints: readonly MemberSetpoint[], validity: Validity): void {
    this.update(group);
    const sentSetpoints = this.setpoints.get(keyOf(group)) ?? new Map<string, AnySetpoint>();
    for (const { vehicle, setpoint } of setpoints) sentSetpoints.set(vehicle, setpoint);
    this.setpoints.clear(); // earlier groups have ended, so their setpoints are no longer renewed
    this.setpoints.set(keyOf(group), sentSetpoints);
    this.renewer.start(group, validity, this.nowS());
    this.updateRenewedKey();
  }

  private update(group: Group): void {
    this.list = withGroup(this.list, { group, receivedAt_s: this.nowS() });
    this.recordLive([group]);
  }

  private recordLive(groups: readonly Group[]): void {
    const newLive = groups.filter((group) => isLive(group) && !this.seenLive.has(keyOf(group)));
    if (newLive.length > 0) this.seenLive = new Set([...this.seenLive, ...newLive.map(keyOf)]);
  }

  private stopRenewing(): void {
    this.renewer.stop();
    this.updateRenewedKey();
  }

  private updateRenewedKey(): void {
    this.renewedKey =
      this.live
        .map((one) => one.group)
        .filter((group) => this.renewer.isRenewing(group))
        .map(keyOf)[0] ?? null;
  }

  private async poll(now_s: number): Promise<void> {
    if (this.polling) return;
    this.polling = true;
    this.polledAt_s = now_s;
    const answer = await this.api.get('/groups');
    this.polling = false;
    if (!answer.ok) return;
    const receivedAt_s = this.nowS();
    this.list = answer.value.groups.map((group) => ({ group, receivedAt_s })); // a restarted server has no earlier groups
    this.recordLive(answer.value.groups);
  }
}

function vehiclesOf(group: Group): string[] {
  return group.members.map((member) => member.vehicle);
}

const pathOf = (group: Group): { params: { path: { g: string } } } => ({ params: { path: { g: group.id } } });
