/**
 * The groups of this page and of other clients: active groups, and the groups that ended. The server's events update the
 * groups, and while a group is active this page polls all groups once a second.
 */

import type { ApiClient, Outcome } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { CommandQueue } from '../../../api/command-queue';
import type { WireEvent } from '../../../live/wire';
import type { Command } from '../../../app/actions/command.svelte';
import type { ActionController } from '../../../app/actions/controller.svelte';
import { toRequestSetpoint, type AnySetpoint, type Validity } from '../../../vehicle/setpoint';
import type { GroupBody, MemberSetpoint } from './group-form';
import { isActive, groupKey, joinNames, newestEnded, readGroup, withGroup, type Group, type ReceivedGroup } from './group';
import { GroupRenewer, type GroupRenewalResult } from './renewer';

const POLL_INTERVAL_S = 1;

export class GroupController {
  list = $state.raw<readonly ReceivedGroup[]>([]);
  /** Key of the group whose setpoints this page renews. */
  renewedKey = $state<string | null>(null);
  /** Keys of the groups that this page has seen active and that are not dismissed. */
  private seenActiveKeys = $state.raw<ReadonlySet<string>>(new Set());
  private readonly renewer = new GroupRenewer((group, validity) => this.sendRenewal(group, validity));
  /**
   * The setpoints that this page sent, by group key and vehicle. Each renewal sends these setpoints again. A setpoint
   * that this page sends outside the group removes the entry of the vehicle.
   */
  private readonly sentSetpoints = new Map<string, Map<string, AnySetpoint>>();
  private polledAt_s = -Infinity;
  private polling = false;
  private connection: unknown = null;

  constructor(
    private readonly api: ApiClient,
    private readonly queue: CommandQueue,
    private readonly actions: Pick<ActionController, 'attempt' | 'showProblem'>,
    private readonly nowS: () => number,
    /** Whether the page is visible. */
    private readonly isVisible: () => boolean,
    private readonly nameOf: (vehicle: string) => string,
    /** Stops the renewal of the setpoint that this page sent to the vehicle outside the group. */
    private readonly stopVehicleRenewal: (vehicle: string) => void,
  ) {}

  readonly activeGroups = $derived(this.list.filter((entry) => isActive(entry.group)));
  readonly lastEndedGroup = $derived(newestEnded(this.list, this.seenActiveKeys));
  /** The group that this page started or commands. */
  readonly pageGroup = $derived.by(() => this.activeGroups.find((entry) => this.isOwn(entry.group)) ?? null);

  isOwn(group: Group): boolean {
    return this.api.key !== null && group.client_key === this.api.key;
  }

  memberNames(group: Group): string[] {
    return group.members.map((member) => this.nameOf(member.vehicle));
  }

  /** The active group that contains the vehicle. */
  groupWith(vehicle: string): Group | null {
    return this.activeGroups.find((entry) => entry.group.members.some((m) => m.vehicle === vehicle))?.group ?? null;
  }

  /** Hides the ended group. */
  dismissEnded(): void {
    this.seenActiveKeys = new Set([...this.seenActiveKeys].filter((key) => this.activeGroups.some((entry) => groupKey(entry.group) === key)));
  }

  handleEvent(event: WireEvent): void {
    const group = event.kind === 'group' ? readGroup(event['group']) : null;
    if (group !== null) this.update(group);
  }

  /**
   * Called when telemetry arrives.
   * @param connection identifies the connection; a new connection may be to a restarted server without these groups.
   */
  onTelemetry(connection: unknown): void {
    const now_s = this.nowS();
    const isNewConnection = connection !== this.connection;
    this.connection = connection;
    if (isNewConnection || (this.activeGroups.length > 0 && this.isVisible() && now_s - this.polledAt_s >= POLL_INTERVAL_S)) void this.poll(now_s);
    const renewedGroup = this.list.find((entry) => this.renewer.isRenewing(entry.group));
    if (renewedGroup === undefined || !this.queue.busy(vehiclesOf(renewedGroup.group)))
      this.renewer.renewIfDue(
        now_s,
        this.list.map((entry) => entry.group),
        this.isVisible(),
      );
    this.updateRenewedKey();
  }

  async start(body: GroupBody, validity: Validity): Promise<Outcome<Group>> {
    for (const { vehicle } of body.members) this.stopVehicleRenewal(vehicle);
    const members = body.members.map(({ vehicle, setpoint }) => ({ vehicle, setpoint: toRequestSetpoint(setpoint) }));
    const outcome = await this.api.post('/groups', { body: { ...body, members } });
    if (outcome.ok) this.onAccepted(outcome.value, body.members, validity);
    return outcome;
  }

  /** Sends new setpoints to some members. The request also renews the setpoints of the other members. */
  async send(group: Group, setpoints: readonly MemberSetpoint[], validity: Validity): Promise<Outcome<Group>> {
    for (const { vehicle } of setpoints) this.stopVehicleRenewal(vehicle);
    return this.enqueue(group, async () => {
      const outcome = await this.post(group, setpoints, validity);
      if (outcome.ok) this.onAccepted(outcome.value, setpoints, validity);
      else if (outcome.problem.status === 0) this.stopRenewing(); // without an answer, a renewal might replace accepted new setpoints by the previous ones
      return outcome;
    });
  }

  /** Renews the setpoints of all members that follow the group. */
  renew(group: Group, validity: Validity): Promise<Outcome<Group>> {
    return this.enqueue(group, async () => {
      const outcome = await this.post(group, this.currentSetpoints(group), validity);
      if (outcome.ok) this.onAccepted(outcome.value, [], validity);
      return outcome;
    });
  }

  /** This page sent a setpoint to the vehicle outside the group: renewals of the group no longer contain this vehicle. */
  onVehicleSetpoint(vehicle: string): void {
    for (const setpoints of this.sentSetpoints.values()) setpoints.delete(vehicle);
  }

  async hold(group: Group): Promise<void> {
    this.stopRenewing();
    const send = async (): Promise<Outcome<unknown>> => {
      const outcome = await this.api.post('/groups/{g}/hold', groupParams(group));
      if (outcome.ok) this.update(outcome.value);
      return outcome;
    };
    await this.actions.attempt({ ...this.commandTo(group), name: `Hold group ${group.id}`, stops: true, send }, 'offboardRoom');
  }

  /** The vehicles of a command to a group. */
  commandTo(group: Group): Pick<Command, 'vehicles' | 'vehicleNames'> {
    return { vehicles: vehiclesOf(group), vehicleNames: joinNames(this.memberNames(group)) };
  }

  /** Shows a problem in the room, for example a refused renewal. */
  private showProblem(commandName: string, vehicleName: string, problem: Problem): void {
    this.actions.showProblem(commandName, vehicleName, 'offboardRoom', problem);
  }

  private async sendRenewal(group: Group, validity: Validity): Promise<GroupRenewalResult> {
    const outcome = await this.enqueue(group, () => this.post(group, this.currentSetpoints(group), validity));
    if (outcome.ok) {
      this.update(outcome.value);
      return 'accepted';
    }
    if (outcome.problem.status === 0) return 'no answer';
    this.showProblem(`Renewing group ${group.id}`, this.memberNames(group).join(', '), outcome.problem);
    return 'refused';
  }

  /** This page's setpoints of the members that still follow the group. */
  private currentSetpoints(group: Group): MemberSetpoint[] {
    const setpointsByVehicle = this.sentSetpoints.get(groupKey(group));
    return group.members.flatMap(({ vehicle, held }) => {
      const setpoint = setpointsByVehicle?.get(vehicle);
      return held || setpoint === undefined ? [] : [{ vehicle, setpoint }];
    });
  }

  /** Calls `send` after earlier requests to these vehicles have been answered, so that `send` reads the newest setpoints. */
  private enqueue(group: Group, send: () => Promise<Outcome<Group>>): Promise<Outcome<Group>> {
    return this.queue.run(vehiclesOf(group), send);
  }

  private post(group: Group, setpoints: readonly MemberSetpoint[], { valid_for_s, on_expiry }: Validity): Promise<Outcome<Group>> {
    return this.api.post('/groups/{g}/setpoints', {
      ...groupParams(group),
      body: { setpoints: setpoints.map(({ vehicle, setpoint }) => ({ vehicle, setpoint: toRequestSetpoint(setpoint) })), valid_for_s, on_expiry },
    });
  }

  private onAccepted(group: Group, setpoints: readonly MemberSetpoint[], validity: Validity): void {
    this.update(group);
    const setpointsByVehicle = this.sentSetpoints.get(groupKey(group)) ?? new Map<string, AnySetpoint>();
    for (const { vehicle, setpoint } of setpoints) setpointsByVehicle.set(vehicle, setpoint);
    this.sentSetpoints.clear(); // earlier groups have ended, so their setpoints are no longer renewed
    this.sentSetpoints.set(groupKey(group), setpointsByVehicle);
    this.renewer.start(group, validity, this.nowS());
    this.updateRenewedKey();
  }

  private update(group: Group): void {
    this.list = withGroup(this.list, { group, receivedAt_s: this.nowS() });
    this.recordActive([group]);
  }

  private recordActive(groups: readonly Group[]): void {
    const newActive = groups.filter((group) => isActive(group) && !this.seenActiveKeys.has(groupKey(group)));
    if (newActive.length > 0) this.seenActiveKeys = new Set([...this.seenActiveKeys, ...newActive.map(groupKey)]);
  }

  private stopRenewing(): void {
    this.renewer.stop();
    this.updateRenewedKey();
  }

  private updateRenewedKey(): void {
    this.renewedKey =
      this.activeGroups
        .map((entry) => entry.group)
        .filter((group) => this.renewer.isRenewing(group))
        .map(groupKey)[0] ?? null;
  }

  private async poll(now_s: number): Promise<void> {
    if (this.polling) return;
    this.polling = true;
    this.polledAt_s = now_s;
    const response = await this.api.get('/groups');
    this.polling = false;
    if (!response.ok) return;
    const receivedAt_s = this.nowS();
    this.list = response.value.groups.map((group) => ({ group, receivedAt_s })); // a restarted server has no earlier groups
    this.recordActive(response.value.groups);
  }
}

export function vehiclesOf(group: Group): string[] {
  return group.members.map((member) => member.vehicle);
}

const groupParams = (group: Group): { params: { path: { g: string } } } => ({ params: { path: { g: group.id } } });
