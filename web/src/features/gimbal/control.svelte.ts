/** Controls the gimbal: angles while the pad is dragged, rates while an arrow is held; both axes stop on release. */

import type { VehicleFacts } from '../../vehicle/facts';
import type { components } from '../../api/schema';
import type { ApiClient, Outcome } from '../../api/client';
import type { ActionController } from '../../app/actions/controller.svelte';
import { LatestSender } from './latest-sender';
import { gimbalKey, limits, ofGimbal, withGimbal, type Angles } from '../../vehicle/gimbal';
import { clamp } from './pad';

/**
 * After this time without a drag or key [ms] the last angles are sent once more, and the answer says where the camera
 * stopped.
 */
const SETTLE_MS = 400;
/** Rate of the camera while an arrow is held [deg/s]. */
const RATE_DEG_S = 20;

export type Roi = components['schemas']['Roi'];

interface QueuedCommand {
  facts: VehicleFacts;
  send: () => Promise<Outcome<unknown>>;
}

export class GimbalControl {
  /** The target angles: the ring on the pad. */
  target = $state.raw<Angles | null>(null);
  /** Whether yaw is locked relative to north; null: as the gimbal reports it. */
  private lockChosen = $state<boolean | null>(null);
  busy = $state(false);
  /** Key of the gimbal that a person has selected, by vehicle. */
  private chosen = $state.raw<Readonly<Record<string, string>>>({});
  /** Why the camera has not reached its target, by gimbal; null if it has or is still moving. */
  private limited = $state.raw<{ id: string; text: string } | null>(null);
  private settleTimer: ReturnType<typeof setTimeout> | undefined;
  /** Number of commands sent so far. */
  private sent = 0;
  /** Latest answer of the server for each gimbal: whether it had control at that time, and its ROI. */
  private answers = $state.raw<Readonly<Record<string, { holder: string; mine: boolean; roi: Roi | null }>>>({});
  private readonly sender: LatestSender<QueuedCommand>;
  /** The gimbal that a held arrow turns. It is stopped on release, even if another gimbal is shown by then. */
  private turning: VehicleFacts | null = null;

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
  ) {
    this.sender = new LatestSender((command) => this.actions.attempt('Gimbal', command.facts, 'gimbal', () => command.send()));
  }

  /** Whether the reported holder is this server; false until the server has confirmed it. */
  inControl(facts: VehicleFacts): boolean {
    const answer = this.answers[gimbalKey(facts)];
    return answer !== undefined && answer.mine && answer.holder === holderKey(facts);
  }

  /** Reads from the server whether it controls the gimbal, and the gimbal's ROI; called when the reported holder of control changes. */
  async fetchHolder(facts: VehicleFacts): Promise<void> {
    const [key, holder] = [gimbalKey(facts), holderKey(facts)];
    const answer = await this.api.get('/vehicles/{v}/gimbal', ofGimbal(facts));
    if (!answer.ok) return;
    this.answers = { ...this.answers, [key]: { holder, mine: answer.value.in_control, roi: answer.value.roi } };
  }

  /**
   * The ROI that this server has set and not ended by another command; null if there is none or it is not known.
   */
  roiOf(facts: VehicleFacts): Roi | null {
    return this.answers[gimbalKey(facts)]?.roi ?? null;
  }

  async clearRoi(facts: VehicleFacts): Promise<void> {
    this.busy = true;
    await this.actions.attempt('Clear ROI', facts, 'gimbal', () => this.api.post('/vehicles/{v}/gimbal/roi/clear', ofGimbal(facts)));
    this.busy = false;
    await this.fetchHolder(facts);
  }

  lock(facts: VehicleFacts): boolean {
    return this.lockChosen ?? facts.gimbal?.value.yaw_lock ?? false;
  }

  async control(facts: VehicleFacts, take: boolean): Promise<void> {
    this.busy = true;
    this.target = null;
    clearTimeout(this.settleTimer);
    this.limited = null;
    await this.actions.attempt(take ? 'Take gimbal' : 'Release gimbal', facts, 'gimbal', () =>
      this.api.post(`/vehicles/{v}/gimbal/${take ? 'take' : 'release'}`, ofGimbal(facts)),
    );
    this.busy = false;
  }

  /** Points the camera; yaw is from the nose, as the pad shows it. */
  point(facts: VehicleFacts, angles: Angles): void {
    const clamped = clamp(angles, limits(facts.gimbal?.value ?? null));
    this.target = clamped;
    const lock = this.lock(facts);
    const vehicleYaw = facts.attitude?.value.yaw_ned_rad ?? null;
    // With yaw lock the API's yaw is relative to north.
    const yaw_deg = lock && vehicleYaw !== null ? wrap(clamped.yaw_deg + (vehicleYaw * 180) / Math.PI) : clamped.yaw_deg;
    const body = { pitch_deg: round(clamped.pitch_deg), yaw_deg: round(yaw_deg), yaw_lock: lock };
    this.push({ facts, send: () => this.api.post('/vehicles/{v}/gimbal/angles', { ...ofGimbal(facts), body: { ...body, wait: false } }) });
    this.settleTimer = setTimeout(() => void this.settle(facts, body), SETTLE_MS);
  }

  /** Why the camera stopped before its target; null if it did not. */
  limitedOf(facts: VehicleFacts): string | null {
    return this.limited?.id === gimbalKey(facts) ? this.limited.text : null;
  }

  /** Sends the same angles again and waits until the camera stops; other commands are not delayed. */
  private async settle(facts: VehicleFacts, body: { pitch_deg: number; yaw_deg: number; yaw_lock: boolean }): Promise<void> {
    const number = this.sent;
    const answer = await this.api.post('/vehicles/{v}/gimbal/angles', { ...ofGimbal(facts), body: { ...body, wait: true } });
    if (number === this.sent && answer.ok && answer.value.limited != null) this.limited = { id: gimbalKey(facts), text: answer.value.limited.text };
  }

  /** Sends a command; the result of the previous command no longer applies. */
  private push(command: QueuedCommand): void {
    clearTimeout(this.settleTimer);
    this.sent += 1;
    this.limited = null;
    this.sender.push(command);
  }

  /** Turns the camera while an arrow is held. @param pitch, yaw signs: up and right are positive. */
  turn(facts: VehicleFacts, pitch: number, yaw: number): void {
    this.target = null;
    this.turning = facts;
    this.sendRates(facts, pitch * RATE_DEG_S, yaw * RATE_DEG_S);
  }

  /** The arrow was released: both axes stop. */
  stop(): void {
    const turning = this.turning;
    this.turning = null;
    if (turning !== null) this.sendRates(turning, 0, 0);
  }

  /** The facts with the selected gimbal of the vehicle; initially the first. */
  selected(facts: VehicleFacts): VehicleFacts {
    return withGimbal(facts, this.chosen[facts.id] ?? '');
  }

  /** Selects a gimbal of the vehicle; target and yaw lock of the previous one do not apply to it. */
  select(facts: VehicleFacts, key: string): void {
    this.chosen = { ...this.chosen, [facts.id]: key };
    clearTimeout(this.settleTimer);
    this.target = this.lockChosen = null;
  }

  setLock(facts: VehicleFacts, lock: boolean): void {
    this.lockChosen = lock;
    this.sendRates(facts, 0, 0);
  }

  private sendRates(facts: VehicleFacts, pitch: number, yaw: number): void {
    const body = { pitch_rate_deg_s: pitch, yaw_rate_deg_s: yaw, yaw_lock: this.lock(facts) };
    this.push({ facts, send: () => this.api.post('/vehicles/{v}/gimbal/rates', { ...ofGimbal(facts), body }) });
  }
}

/** A key that changes when another vehicle, another gimbal or another holder of control is shown. */
export function holderKey(facts: VehicleFacts): string {
  return `${gimbalKey(facts)}/${facts.gimbal?.value.primary_control?.join('.') ?? 'nobody'}`;
}

function round(value: number): number {
  return Math.round(value * 10) / 10;
}

function wrap(value_deg: number): number {
  return ((((value_deg + 180) % 360) + 360) % 360) - 180;
}
