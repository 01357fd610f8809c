/**
 * Following the position of this device: this page sends each position as a setpoint. It never goes on by itself: once
 * positions have stopped for as long as a setpoint is valid, or the vehicle follows other setpoints, only a person starts again.
 */

import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { FixedVehicles } from '../../app/actions/command.svelte';
import { MAIN_PART, type ActionController } from '../../app/actions/controller.svelte';
import type { LayerContent } from '../../app/map-layers.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import { toRequestSetpoint } from '../../vehicle/setpoint';
import { besideOf, deviceContent, deviceProgress, deviceSetpoint, deviceText, VALID_FOR_S, VALIDITY, whyNotDevice, type Beside } from './device';
import { numberOf, whyNot, type Draft, type Limits } from './guided';
import type { DevicePosition, Locator } from './locator.svelte';

const RATE_HZ = 50;
/** After the start, telemetry may show the state before it for so long [ms]. */
const START_MS = 3000;
const STOPPED = `Following has ended: no position could be used for ${VALID_FOR_S} s. The vehicle holds.`;

interface Session {
  readonly fixed: FixedVehicles;
  readonly id: string;
  readonly beside: Beside;
  readonly started_ms: number;
  /** When the server accepted the newest position. */
  accepted_ms: number;
}

export class DeviceFollowing {
  private session = $state.raw<Session | null>(null);
  private ended = $state.raw<{ readonly id: string; readonly text: string } | null>(null);
  private isSending = false;
  private release: () => void = () => undefined;

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
    private readonly factsNow: (id: string) => VehicleFacts | null,
    readonly locator: Locator,
    private readonly now_ms: () => number = () => Date.now(),
  ) {
    locator.onPosition = (position) => void this.onPosition(position);
  }

  /** Why the vehicle cannot follow this device now; null: it can. */
  whyNot(draft: Draft, facts: VehicleFacts, limits: Limits): string | null {
    return whyNot(draft, facts, limits) ?? whyNotDevice(numberOf(draft, 'distance_m') ?? 0, facts, this.locator.position, this.locator.problem);
  }

  /** What the vehicle does, as a sentence; empty: not known. */
  effect(draft: Draft, facts: VehicleFacts): string {
    const [beside, device] = [this.besideOf(draft, facts), this.locator.position];
    return beside === null || device === null ? '' : `The vehicle ${deviceText(beside, facts, device)}.`;
  }

  content(draft: Draft | null, facts: VehicleFacts): LayerContent | null {
    const device = this.locator.position;
    if (device === null) return null;
    if (this.session?.id === facts.id) return deviceContent(this.session.beside, facts, device);
    return draft?.kind !== 'device' ? null : deviceContent(this.besideOf(draft, facts), facts, device);
  }

  /** How following goes on or has ended, of a vehicle that was told to; null: it was not. */
  progress(facts: VehicleFacts): { readonly text: string; readonly ended: boolean } | null {
    const session = this.session;
    if (session?.id === facts.id) {
      const stopped = this.now_ms() - session.accepted_ms > VALID_FOR_S * 1000;
      return { text: stopped ? STOPPED : deviceProgress(facts, this.locator.position, this.now_ms()), ended: stopped };
    }
    return this.ended?.id === facts.id ? { text: this.ended.text, ended: true } : null;
  }

  /** Vehicles that follow this device. */
  vehicles(): readonly string[] {
    return this.session === null ? [] : [this.session.id];
  }

  /** Opens the confirmation, which says the effect with numbers. */
  request(draft: Draft, facts: VehicleFacts, limits: Limits): void {
    const [beside, device] = [this.besideOf(draft, facts), this.locator.position];
    if (beside === null || device === null || this.whyNot(draft, facts, limits) !== null) return;
    const fixed = this.actions.gate.fix([facts.id]);
    const newest = (): ReturnType<typeof deviceSetpoint> => deviceSetpoint(beside, this.locator.position ?? device, this.now_ms());
    this.actions.request('offboard_start', facts, MAIN_PART, null, {
      setpoint: newest(),
      newest,
      validity: VALIDITY,
      rate_hz: RATE_HZ,
      text: deviceText(beside, facts, device),
      onOutcome: (outcome: Outcome<unknown>) => {
        if (outcome.ok) this.begin(facts.id, beside, fixed);
      },
    });
  }

  /** Another command was accepted: how following ended no longer matters. */
  forget(id: string): void {
    if (this.ended?.id === id) this.ended = null;
  }

  /** Another setpoint of this page flies the vehicle, or the vehicle is to follow nothing. */
  end(id: string, text = 'Following has ended: the vehicle flies another setpoint.'): void {
    if (this.session?.id !== id) return;
    this.session = null;
    this.ended = { id, text };
    this.release();
  }

  private begin(id: string, beside: Beside, fixed: FixedVehicles): void {
    this.release();
    this.release = this.locator.use();
    const now_ms = this.now_ms();
    this.session = { fixed, id, beside, started_ms: now_ms, accepted_ms: now_ms };
    this.ended = null;
  }

  private besideOf(draft: Draft, facts: VehicleFacts): Beside | null {
    const [distance_m, alt_home_m] = [numberOf(draft, 'distance_m'), numberOf(draft, 'alt_home_m')];
    const [device, vehicle] = [this.locator.position, facts.globalPosition?.value];
    return distance_m === null || alt_home_m === null || device === null || vehicle === undefined
      ? null
      : besideOf(distance_m, alt_home_m, draft.followNose, device, vehicle);
  }

  private async onPosition(device: DevicePosition): Promise<void> {
    const session = this.session;
    if (session === null) return;
    const now_ms = this.now_ms();
    const facts = this.factsNow(session.id);
    if (session.fixed.problem() !== null || facts === null) return this.end(session.id, 'Following has ended: the vehicle was removed.');
    if (now_ms - session.accepted_ms > VALID_FOR_S * 1000) return this.end(session.id, STOPPED);
    const follows = facts.offboard?.streaming === true && facts.offboard.requestedType === 'follow_device';
    if (!follows && now_ms - session.started_ms > START_MS)
      return this.end(session.id, `Following has ended: the vehicle is in ${facts.status?.value.mode_label ?? '–'}.`);
    if (this.isSending) return;
    this.isSending = true;
    const { valid_for_s, on_expiry } = VALIDITY;
    const setpoint = toRequestSetpoint(deviceSetpoint(session.beside, device, now_ms));
    const outcome = await this.api.post('/vehicles/{v}/offboard/setpoint', { ...ofVehicle(session.id), body: { setpoint, valid_for_s, on_expiry } });
    this.isSending = false;
    if (outcome.ok) session.accepted_ms = this.now_ms();
  }
}
