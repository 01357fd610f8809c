/** This page's setpoints for single vehicles: starts the stream, sends, nudges and renews setpoints. Also switches obstacle avoidance. */

import type { VehicleFacts } from '../../vehicle/facts';
import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { CommandQueue } from '../../api/command-queue';
import { CommandGate, type FixedVehicles } from '../../app/actions/command.svelte';
import { ageText } from '../../live/age';
import { SetpointRenewer } from './renewer';
import {
  toRequestSetpoint,
  DEFAULT_VALIDITY,
  nudge,
  nudgeSizes,
  type AnySetpoint,
  type NudgeAxis,
  type Validity,
  type PositionSetpoint,
  type StreamStart,
  type NudgeSize,
} from '../../vehicle/setpoint';
import { nudgeBase } from '../../vehicle/offboard';

/** A refusal by the page without a request to the server: the vehicle's position or heading is not known. */
function positionUnknownRefusal({ localPosition, attitude }: VehicleFacts): Outcome<never> {
  const [name, reading] = localPosition === null || localPosition.stale ? ['local position', localPosition] : ['heading', attitude];
  return {
    ok: false,
    problem: {
      title: 'Not sent',
      detail: reading === null ? `The vehicle reports no ${name}.` : `The last ${name} is ${ageText(reading.age_s)} old: the current ${name} is not known.`,
      reasons: [],
      remedy: 'Wait until the vehicle reports its position and heading, then try again.',
      code: 'refused',
      status: 0,
      field: null,
    },
  };
}

/** Codes of transient problems: no answer, or a refusal whose cause may pass (such as an old estimate). */
const TRANSIENT_CODES: readonly string[] = ['unreachable', 'refused'];

export class OffboardControl {
  /** Which of the steps is chosen. */
  nudgeIndex = $state(1);

  get nudgeSize(): NudgeSize {
    return nudgeSizes()[this.nudgeIndex] ?? { metres: 1, yaw_deg: 15 };
  }
  private readonly renewers = new Map<string, { readonly renewer: SetpointRenewer; readonly fixed: FixedVehicles }>();
  /** Called when this page sends a setpoint to one vehicle, which then no longer follows its group. */
  onVehicleSetpoint: (id: string) => void = () => undefined;
  /** Called when the server refuses a renewal: the setpoint will expire. */
  onRenewalRefused: (id: string, problem: Problem) => void = () => undefined;

  constructor(
    private readonly api: ApiClient,
    private readonly queue: CommandQueue,
    private readonly nowS: () => number,
    private readonly gate = new CommandGate(),
  ) {}

  /** Starts the stream with the given setpoint; null: with the vehicle's position. */
  async start(facts: VehicleFacts, streamStart: StreamStart | null = null): Promise<Outcome<unknown>> {
    if (streamStart !== null) {
      const outcome = await this.postStart(facts.id, streamStart.newest?.() ?? streamStart.setpoint, streamStart.validity, streamStart.rate_hz);
      streamStart.onOutcome?.(outcome);
      return outcome;
    }
    const { localPosition, attitude } = facts;
    if (localPosition === null || attitude === null || localPosition.stale || attitude.stale) return positionUnknownRefusal(facts);
    const setpoint: PositionSetpoint = {
      type: 'position',
      position_ned_m: localPosition.value.position_ned_m,
      yaw_ned_rad: attitude.value.yaw_ned_rad,
    };
    return this.postStart(facts.id, { ...setpoint }, DEFAULT_VALIDITY);
  }

  /**
   * Sends a new setpoint of any type. If the server refuses it, this page continues to renew the previous setpoint. Without
   * an answer it is unknown which of the two setpoints the vehicle follows, and this page renews neither.
   */
  async send(id: string, setpoint: AnySetpoint, validity: Validity): Promise<Outcome<unknown>> {
    const renewer = this.renewer(id);
    this.onVehicleSetpoint(id);
    const restorePrevious = renewer.start(setpoint, validity, this.nowS());
    const outcome = await this.postSetpoint(id, setpoint, validity);
    if (!outcome.ok && outcome.problem.status !== 0) restorePrevious();
    if (renewer.setpoint !== setpoint) return outcome;
    if (outcome.ok) renewer.start(setpointToRenew(setpoint, outcome.value), validity, this.nowS());
    else renewer.stop();
    return outcome;
  }

  /** A person controls the vehicle directly (gamepad, drag): this page no longer renews the previous setpoint. */
  onDirectControl(id: string): void {
    this.onVehicleSetpoint(id);
    this.stopRenewing(id);
  }

  /** This page no longer renews the vehicle's setpoint, for example because the vehicle flies in a group. */
  stopRenewing(id: string): void {
    this.renewers.get(id)?.renewer.stop();
  }

  private async postStart(id: string, setpoint: AnySetpoint, validity: Validity, rate_hz?: number): Promise<Outcome<unknown>> {
    const { valid_for_s, on_expiry } = validity;
    const outcome = await this.api.post('/vehicles/{v}/offboard/start', {
      ...ofVehicle(id),
      body: { setpoint: toRequestSetpoint(setpoint), valid_for_s, on_expiry, ...(rate_hz === undefined ? {} : { rate_hz }) },
    });
    if (outcome.ok) this.renewer(id).start(setpointToRenew(setpoint, outcome.value), validity, this.nowS());
    return outcome;
  }

  /** Moves the streamed setpoint by one step along an axis. */
  async nudge(facts: VehicleFacts, axis: NudgeAxis, sign: 1 | -1): Promise<Outcome<unknown>> {
    const renewer = this.renewer(facts.id);
    const stream = facts.offboard;
    const base =
      nudgeablePosition(renewer.setpoint) ??
      (stream === null ? null : nudgeBase(stream, facts.localPosition?.value.position_ned_m ?? null, facts.attitude?.value.yaw_ned_rad ?? null));
    if (base === null) return positionUnknownRefusal(facts);
    return this.send(facts.id, { ...nudge(base, axis, sign, this.nudgeSize) }, DEFAULT_VALIDITY);
  }

  /** Switches obstacle avoidance on or off. */
  setAvoidance(id: string, on: boolean): Promise<Outcome<unknown>> {
    const name = on ? 'Avoidance on' : 'Avoidance off';
    return this.gate.run({ name, vehicles: [id] }, () => this.api.put('/vehicles/{v}/offboard/avoidance', { ...ofVehicle(id), body: { on } }));
  }

  /** Vehicles whose setpoint this page renews. */
  renewedVehicles(): string[] {
    return [...this.renewers].flatMap(([id, { renewer }]) => (renewer.setpoint === null ? [] : [id]));
  }

  /** Called when telemetry arrives. @param isStreaming whether the server streams to a vehicle. */
  onTelemetry(isStreaming: (id: string) => boolean): void {
    for (const [id, { renewer, fixed }] of this.renewers) {
      if (fixed.problem() !== null) this.renewers.delete(id);
      else renewer.renewIfDue(this.nowS(), isStreaming(id));
    }
  }

  private postSetpoint(id: string, setpoint: AnySetpoint, { valid_for_s, on_expiry }: Validity): Promise<Outcome<unknown>> {
    const fixed = this.gate.fix([id]);
    return this.queue.run([id], async () => {
      const problem = fixed.problem();
      if (problem !== null) return { ok: false, problem };
      return this.api.post('/vehicles/{v}/offboard/setpoint', { ...ofVehicle(id), body: { setpoint: toRequestSetpoint(setpoint), valid_for_s, on_expiry } });
    });
  }

  /** Renews the setpoint of exactly this vehicle; another vehicle with the same id gets a new renewer. */
  private renewer(id: string): SetpointRenewer {
    const known = this.renewers.get(id);
    if (known === undefined || known.fixed.problem() !== null) {
      const renewer = new SetpointRenewer(async ({ setpoint, validity }) => {
        const outcome = await this.postSetpoint(id, setpoint, validity);
        if (outcome.ok) return 'accepted';
        if (TRANSIENT_CODES.includes(outcome.problem.code)) return 'retry';
        this.onRenewalRefused(id, outcome.problem);
        return 'refused';
      });
      this.renewers.set(id, { renewer, fixed: this.gate.fix([id]) });
      return renewer;
    }
    return known.renewer;
  }
}

/** The setpoint to renew. An offset is replaced by the position that resulted from it, because sending the offset again would move the vehicle again. */
function setpointToRenew(setpoint: AnySetpoint, response: unknown): AnySetpoint {
  if (setpoint.type !== 'position_body') return setpoint;
  const streamedSetpoint = (response as { setpoint?: Record<string, unknown> | null } | null)?.setpoint ?? null;
  if (typeof streamedSetpoint?.['type'] !== 'string') return setpoint;
  return Object.fromEntries(Object.entries(streamedSetpoint).filter(([, value]) => value !== null)) as AnySetpoint;
}

/** The setpoint as a position that can be nudged; null for other types, and for a position without a heading. */
function nudgeablePosition(setpoint: AnySetpoint | null): PositionSetpoint | null {
  const position_ned_m = setpoint?.['position_ned_m'];
  const yaw = setpoint?.['yaw_ned_rad'];
  if (setpoint?.type !== 'position' || typeof yaw !== 'number' || !Array.isArray(position_ned_m)) return null;
  return { type: 'position', position_ned_m: position_ned_m as [number, number, number], yaw_ned_rad: yaw };
}
