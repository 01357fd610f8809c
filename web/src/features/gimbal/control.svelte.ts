/** Controls the gimbal: sends angles while the pilot drags on the pad, and rates while the pilot holds an arrow button. When the button is released, both axes stop. */

import type { VehicleFacts } from '../../vehicle/facts';
import type { components } from '../../api/schema';
import type { ApiClient, Outcome } from '../../api/client';
import type { FixedVehicles } from '../../app/actions/command.svelte';
import { commandTo, type Command } from '../../app/actions/command.svelte';
import type { ActionController } from '../../app/actions/controller.svelte';
import { gimbalKey, angleLimits, gimbalParams, withGimbal, type Angles } from '../../vehicle/gimbal';
import { clamp } from './pad';

/**
 * Time without a drag or key press after which the page sends the last angles once more [ms]. The response says whether
 * a limit stopped the camera.
 */
const FINAL_ANGLES_DELAY_MS = 400;
/** Rate of the camera while an arrow button is held [deg/s]. */
const RATE_DEG_S = 20;

export type Roi = components['schemas']['Roi'];

interface QueuedCommand {
  facts: VehicleFacts;
  /** The vehicle as it was when the command was given. */
  fixed: FixedVehicles;
  send: () => Promise<Outcome<unknown>>;
}

const TAKE = 'Take gimbal control';
const RELEASE = 'Release gimbal control';
const CLEAR_ROI = 'Clear ROI';

/** The gimbal as the target of a command: a vehicle may have several gimbals. */
const gimbalCommand = (name: string, facts: VehicleFacts, send: Command['send']): Command => commandTo(facts, name, send, { part: gimbalKey(facts) });

export class GimbalControl {
  /** The target angles of one gimbal: the ring on the pad. */
  private target = $state.raw<{ gimbal: string; angles: Angles } | null>(null);
  /** Whether a person locked yaw relative to north, by gimbal; missing: as the gimbal reports it. */
  private chosenYawLocks = $state.raw<Readonly<Record<string, boolean>>>({});
  /** Key of the gimbal that a person has selected, by vehicle. */
  private selectedKeys = $state.raw<Readonly<Record<string, string>>>({});
  /** Text about the limit that stopped the camera of one gimbal; null: the camera reached its target or is still moving. */
  private limitNotice = $state.raw<{ gimbal: string; text: string } | null>(null);
  private finalAnglesTimer: ReturnType<typeof setTimeout> | undefined;
  /** Number of commands sent so far; shows whether a newer command was sent during a request. */
  private sentCount = 0;
  /** The server's latest response for each gimbal: whether the server was in control of the gimbal (`isServerInControl`), and the ROI. */
  private responses = $state.raw<Readonly<Record<string, { gimbalAndHolder: string; isServerInControl: boolean; roi: Roi | null }>>>({});
  /** Each gimbal has its own sender: a command to one gimbal must not replace the stop of another. */
  private readonly senders = new Map<string, LatestSender<QueuedCommand>>();
  /** The gimbal that a held arrow button turns. This gimbal stops when the button is released, even if the card then shows another gimbal. */
  private turnedGimbal: VehicleFacts | null = null;

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
  ) {}

  /** The target angles of this gimbal; null: none. */
  targetAnglesOf(facts: VehicleFacts): Angles | null {
    return this.target?.gimbal === gimbalKey(facts) ? this.target.angles : null;
  }

  /** Whether a request about the control or the ROI of this gimbal has no answer yet. */
  isBusy(facts: VehicleFacts): boolean {
    return [TAKE, RELEASE, CLEAR_ROI].some((name) => this.actions.gate.isWaiting({ name, vehicles: [facts.id], part: gimbalKey(facts) }));
  }

  /** Whether this server controls the gimbal; false until the server has confirmed that. */
  isServerInControl(facts: VehicleFacts): boolean {
    const response = this.responses[gimbalKey(facts)];
    return response !== undefined && response.isServerInControl && response.gimbalAndHolder === gimbalAndHolderKey(facts);
  }

  /** Reads from the server whether the server controls the gimbal, and the ROI. Called periodically, and when the gimbal reports another controller. */
  async fetchControlAndRoi(facts: VehicleFacts): Promise<void> {
    const [gimbal, requestedGimbalAndHolder] = [gimbalKey(facts), gimbalAndHolderKey(facts)];
    const response = await this.api.get('/vehicles/{v}/gimbal', gimbalParams(facts));
    if (!response.ok) return;
    this.responses = {
      ...this.responses,
      [gimbal]: { gimbalAndHolder: requestedGimbalAndHolder, isServerInControl: response.value.in_control, roi: response.value.roi },
    };
  }

  /** The ROI that this server has set, until another command ends the ROI; null: no ROI, or not known. */
  roiOf(facts: VehicleFacts): Roi | null {
    return this.responses[gimbalKey(facts)]?.roi ?? null;
  }

  async clearRoi(facts: VehicleFacts): Promise<void> {
    await this.actions.attempt(
      gimbalCommand(CLEAR_ROI, facts, () => this.api.post('/vehicles/{v}/gimbal/roi/clear', gimbalParams(facts))),
      'gimbal',
    );
    await this.fetchControlAndRoi(facts);
  }

  /** Whether yaw is locked relative to north. */
  yawLock(facts: VehicleFacts): boolean {
    return this.chosenYawLocks[gimbalKey(facts)] ?? facts.gimbal?.value.yaw_lock ?? false;
  }

  async takeOrRelease(facts: VehicleFacts, take: boolean): Promise<void> {
    this.target = null;
    clearTimeout(this.finalAnglesTimer);
    this.limitNotice = null;
    const send: Command['send'] = () => this.api.post(`/vehicles/{v}/gimbal/${take ? 'take' : 'release'}`, gimbalParams(facts));
    await this.actions.attempt(gimbalCommand(take ? TAKE : RELEASE, facts, send), 'gimbal');
  }

  /** Points the camera. The yaw in `angles` is relative to the vehicle's nose. */
  point(facts: VehicleFacts, angles: Angles): void {
    const clamped = clamp(angles, angleLimits(facts.gimbal?.value ?? null));
    this.target = { gimbal: gimbalKey(facts), angles: clamped };
    const lock = this.yawLock(facts);
    const vehicleYaw = facts.attitude?.value.yaw_ned_rad ?? null;
    // With yaw lock the API's yaw is relative to north.
    const yaw_deg = lock && vehicleYaw !== null ? wrap180(clamped.yaw_deg + (vehicleYaw * 180) / Math.PI) : clamped.yaw_deg;
    const body = { pitch_deg: round(clamped.pitch_deg), yaw_deg: round(yaw_deg), yaw_lock: lock };
    this.push({ facts, send: () => this.api.post('/vehicles/{v}/gimbal/angles', { ...gimbalParams(facts), body: { ...body, wait: false } }) });
    const fixed = this.actions.gate.fix([facts.id]);
    this.finalAnglesTimer = setTimeout(() => {
      if (fixed.problem() === null) void this.sendFinalAngles(facts, body);
    }, FINAL_ANGLES_DELAY_MS);
  }

  /** Text about the limit that stopped the camera before its target; null: no limit stopped the camera. */
  limitNoticeOf(facts: VehicleFacts): string | null {
    return this.limitNotice?.gimbal === gimbalKey(facts) ? this.limitNotice.text : null;
  }

  /** Sends the last angles again; the server answers when the camera has stopped. Other commands do not wait for this response. */
  private async sendFinalAngles(facts: VehicleFacts, body: { pitch_deg: number; yaw_deg: number; yaw_lock: boolean }): Promise<void> {
    const sentBefore = this.sentCount;
    const response = await this.api.post('/vehicles/{v}/gimbal/angles', { ...gimbalParams(facts), body: { ...body, wait: true } });
    if (sentBefore === this.sentCount && response.ok && response.value.limited != null)
      this.limitNotice = { gimbal: gimbalKey(facts), text: response.value.limited.text };
  }

  /** Sends a command, and clears the limit text of the previous command. */
  private push(command: Omit<QueuedCommand, 'fixed'>): void {
    clearTimeout(this.finalAnglesTimer);
    this.sentCount += 1;
    this.limitNotice = null;
    const gimbal = gimbalKey(command.facts);
    const sender =
      this.senders.get(gimbal) ??
      new LatestSender<QueuedCommand>(({ facts, fixed, send }) => this.actions.attempt(gimbalCommand('Gimbal', facts, send), 'gimbal', fixed));
    this.senders.set(gimbal, sender);
    sender.push({ ...command, fixed: this.actions.gate.fix([command.facts.id]) });
  }

  /** Turns the camera while an arrow button is held. Up and right are positive. */
  turn(facts: VehicleFacts, pitchSign: number, yawSign: number): void {
    this.turnedGimbal = facts;
    this.turnAt(facts, pitchSign * RATE_DEG_S, yawSign * RATE_DEG_S);
  }

  /** Turns the camera at these rates until the next command, for a stick. Up and right are positive [deg/s]. */
  turnAt(facts: VehicleFacts, pitch_deg_s: number, yaw_deg_s: number): void {
    this.target = null;
    this.sendRates(facts, pitch_deg_s, yaw_deg_s);
  }

  /** The arrow button was released: both axes stop. */
  stop(): void {
    const facts = this.turnedGimbal;
    this.turnedGimbal = null;
    if (facts !== null) this.sendRates(facts, 0, 0);
  }

  /** The facts with the selected gimbal of the vehicle; initially the first gimbal. */
  withSelectedGimbal(facts: VehicleFacts): VehicleFacts {
    return withGimbal(facts, this.selectedKeys[facts.id] ?? '');
  }

  /** Selects a gimbal of the vehicle, and clears the target and the chosen yaw lock of the previous gimbal. */
  select(facts: VehicleFacts, key: string): void {
    this.selectedKeys = { ...this.selectedKeys, [facts.id]: key };
    clearTimeout(this.finalAnglesTimer);
    this.target = null;
    this.chosenYawLocks = {};
  }

  setYawLock(facts: VehicleFacts, lock: boolean): void {
    this.chosenYawLocks = { ...this.chosenYawLocks, [gimbalKey(facts)]: lock };
    this.sendRates(facts, 0, 0);
  }

  private sendRates(facts: VehicleFacts, pitch_rate_deg_s: number, yaw_rate_deg_s: number): void {
    const body = { pitch_rate_deg_s, yaw_rate_deg_s, yaw_lock: this.yawLock(facts) };
    this.push({ facts, send: () => this.api.post('/vehicles/{v}/gimbal/rates', { ...gimbalParams(facts), body }) });
  }
}

/** A key that changes with the vehicle, the gimbal or the component that controls the gimbal. */
export function gimbalAndHolderKey(facts: VehicleFacts): string {
  return `${gimbalKey(facts)}/${facts.gimbal?.value.primary_control?.join('.') ?? 'nobody'}`;
}

function round(value: number): number {
  return Math.round(value * 10) / 10;
}

function wrap180(value_deg: number): number {
  return ((((value_deg + 180) % 360) + 360) % 360) - 180;
}

export class LatestSender<T> {
  private waitingRequest: { value: T } | null = null;
  private busy = false;

  constructor(private readonly send: (value: T) => Promise<unknown>) {}

  push(value: T): void {
    this.waitingRequest = { value };
    if (!this.busy) void this.sendWaiting();
  }

  private async sendWaiting(): Promise<void> {
    this.busy = true;
    try {
      while (this.waitingRequest !== null) {
        const { value } = this.waitingRequest;
        this.waitingRequest = null;
        await this.send(value);
      }
    } finally {
      this.busy = false;
    }
  }
}
