/** All flying groups, this page's and others': updated by events, and polled once a second while there is one. */

import type { ApiClient, Outcome } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { Turns } from '../../../api/turns';
import type { WireEvent } from '../../../live/wire';
import type { ActionController } from '../../../app/actions/controller.svelte';
import { asBody, type AnySetpoint, type Lasting } from '../../../vehicle/setpoint';
import type { GroupBody, MemberSetpoint } from './order';
import { isLive, keyOf, newestOver, readGroup, withGroup, type Group, type Heard } from './group';
import { GroupRenewer, type Said } from './renewer';

const ASK_EVERY_S = 1;

export class GroupController {
  list = $state.raw<readonly Heard[]>([]);
  /** Renews the setpoints of this page's group. */
  keptKey = $state<string | null>(null);
  private seenLive = $state.raw<ReadonlySet<string>>(new Set());
  private readonly renewer = new GroupRenewer((group, lasting) => this.renewed(group, lasting));
  /** This page's setpoint of each member, by group: sent again with each renewal, except for members that got a setpoint of their own since. */
  private readonly asked = new Map<string, Map<string, AnySetpoint>>();
  private askedAt_s = -Infinity;
  private asking = false;
  private connection: unknown = null;

  constructor(
    private readonly api: ApiClient,
    private readonly turns: Turns,
    private readonly actions: Pick<ActionController, 'attempt'>,
    private readonly nowS: () => number,
    /** Whether somebody can see the page. */
    private readonly seen: () => boolean,
    private readonly nameOf: (vehicle: string) => string,
    /** Stops renewing a vehicle's own setpoint, which would work against the group. */
    private readonly forgetAlone: (vehicle: string) => void,
  ) {}

  readonly live = $derived(this.list.filter((one) => isLive(one.group)));
  readonly over = $derived(newestOver(this.list, this.seenLive));
  /** The group that this page started or commands. */
  readonly own = $derived.by(() => this.live.find((one) => this.isOwn(one.group)) ?? null);

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
  putAway(): void {
    this.seenLive = new Set([...this.seenLive].filter((key) => this.live.some((one) => keyOf(one.group) === key)));
  }

  heard(event: WireEvent): void {
    const group = event.kind === 'group' ? readGroup(event['group']) : null;
    if (group !== null) this.take(group);
  }

  /** Called as telemetry arrives. @param connection another one: groups of before may be gone. */
  tick(connection: unknown): void {
    const now_s = this.nowS();
    const anew = connection !== this.connection;
    this.connection = connection;
    if (anew || (this.live.length > 0 && this.seen() && now_s - this.askedAt_s >= ASK_EVERY_S)) void this.ask(now_s);
    const kept = this.list.find((one) => this.renewer.keeps(one.group));
    if (kept === undefined || !this.turns.busy(vehiclesOf(kept.group)))
      this.renewer.tick(
        now_s,
        this.list.map((one) => one.group),
        this.seen(),
      );
    this.tellKept();
  }

  async start(body: GroupBody, lasting: Lasting): Promise<Outcome<Group>> {
    for (const { vehicle } of body.members) this.forgetAlone(vehicle);
    const members = body.members.map(({ vehicle, setpoint }) => ({ vehicle, setpoint: asBody(setpoint) }));
    const outcome = await this.api.post('/groups', { body: { ...body, members } });
    if (outcome.ok) this.taken(outcome.value, body.members, lasting);
    return outcome;
  }

  /** New setpoints for some members, the others renewed; without any, all renewed. */
  async send(group: Group, setpoints: readonly MemberSetpoint[], lasting: Lasting): Promise<Outcome<Group>> {
    for (const { vehicle } of setpoints) this.forgetAlone(vehicle);
    return this.inTurn(group, async () => {
      const outcome = await this.post(group, setpoints, lasting);
      if (outcome.ok) this.taken(outcome.value, setpoints, lasting);
      else if (outcome.problem.status === 0) this.keepNone(); // nobody knows what is flown: a renewal might take it back
      return outcome;
    });
  }

  /** Renews all setpoints as they are flown. */
  renew(group: Group, lasting: Lasting): Promise<Outcome<Group>> {
    return this.inTurn(group, async () => {
      const outcome = await this.post(group, this.again(group), lasting);
      if (outcome.ok) this.taken(outcome.value, [], lasting);
      return outcome;
    });
  }

  /** The vehicle got a setpoint of its own: group renewals leave it out. */
  sentAlone(vehicle: string): void {
    for (const asked of this.asked.values()) asked.delete(vehicle);
  }

  async hold(group: Group): Promise<void> {
    this.keepNone();
    await this.actions.attempt(`Hold group ${group.id}`, { name: this.names(group).join(', ') }, 'room', async () => {
      const outcome = await this.api.post('/groups/{g}/hold', of(group));
      if (outcome.ok) this.take(outcome.value);
      return outcome;
    });
  }

  /** Shows the page's own refusal, or a renewal's, beside the buttons. */
  async refuse(what: string, vehicleName: string, problem: Problem): Promise<void> {
    await this.actions.attempt(what, { name: vehicleName }, 'room', () => Promise.resolve({ ok: false, problem }));
  }

  private async renewed(group: Group, lasting: Lasting): Promise<Said> {
    const outcome = await this.inTurn(group, () => this.post(group, this.again(group), lasting));
    if (outcome.ok) {
      this.take(outcome.value);
      return 'taken';
    }
    if (outcome.problem.status === 0) return 'unheard';
    await this.refuse(`Renewing group ${group.id}`, this.names(group).join(', '), outcome.problem);
    return 'refused';
  }

  /** This page's setpoints of the members that still follow the group. */
  private again(group: Group): MemberSetpoint[] {
    const asked = this.asked.get(keyOf(group));
    return group.members.flatMap(({ vehicle, held }) => {
      const setpoint = asked?.get(vehicle);
      return held || setpoint === undefined ? [] : [{ vehicle, setpoint }];
    });
  }

  /** The setpoints are computed when they are sent. */
  private inTurn(group: Group, send: () => Promise<Outcome<Group>>): Promise<Outcome<Group>> {
    return this.turns.run(vehiclesOf(group), send);
  }

  private post(group: Group, setpoints: readonly MemberSetpoint[], { valid_for_s, on_expiry }: Lasting): Promise<Outcome<Group>> {
    return this.api.post('/groups/{g}/setpoints', {
      ...of(group),
      body: { setpoints: setpoints.map(({ vehicle, setpoint }) => ({ vehicle, setpoint: asBody(setpoint) })), valid_for_s, on_expiry },
    });
  }

  private taken(group: Group, setpoints: readonly MemberSetpoint[], lasting: Lasting): void {
    this.take(group);
    const asked = this.asked.get(keyOf(group)) ?? new Map<string, AnySetpoint>();
    for (const { vehicle, setpoint } of setpoints) asked.set(vehicle, setpoint);
    this.asked.clear(); // of those before: they are over
    this.asked.set(keyOf(group), asked);
    this.renewer.keep(group, lasting, this.nowS());
    this.tellKept();
  }

  private take(group: Group): void {
    this.list = withGroup(this.list, { group, heardAt_s: this.nowS() });
    this.noteLive([group]);
  }

  private noteLive(groups: readonly Group[]): void {
    const news = groups.filter((group) => isLive(group) && !this.seenLive.has(keyOf(group)));
    if (news.length > 0) this.seenLive = new Set([...this.seenLive, ...news.map(keyOf)]);
  }

  private keepNone(): void {
    this.renewer.forget();
    this.tellKept();
  }

  private tellKept(): void {
    this.keptKey =
      this.live
        .map((one) => one.group)
        .filter((group) => this.renewer.keeps(group))
        .map(keyOf)[0] ?? null;
  }

  private async ask(now_s: number): Promise<void> {
    if (this.asking) return;
    this.asking = true;
    this.askedAt_s = now_s;
    const answer = await this.api.get('/groups');
    this.asking = false;
    if (!answer.ok) return;
    const heardAt_s = this.nowS();
    this.list = answer.value.groups.map((group) => ({ group, heardAt_s })); // a server that was started anew knows none of before
    this.noteLive(answer.value.groups);
  }
}

function vehiclesOf(group: Group): string[] {
  return group.members.map((member) => member.vehicle);
}

const of = (group: Group): { params: { path: { g: string } } } => ({ params: { path: { g: group.id } } });
