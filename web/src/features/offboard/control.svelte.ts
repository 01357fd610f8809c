/** This page as a source of setpoints: starts the stream at the vehicle's position, nudges and renews it. */

import type { VehicleFacts } from '../../vehicle/facts';
import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { Turns } from '../../api/turns';
import { ageText } from '../../live/age';
import { SetpointRenewer } from './renewer';
import {
  asBody,
  LASTING,
  nudge,
  STEPS,
  type AnySetpoint,
  type Axis,
  type Lasting,
  type PositionSetpoint,
  type StartWish,
  type Steps,
} from '../../vehicle/setpoint';
import { nudgeBase } from '../../vehicle/offboard';

/** The page's own refusal, without asking the server: there is no position to hold. */
function noPosition(age_s: number | null): Outcome<never> {
  return {
    ok: false,
    problem: {
      title: 'Not sent',
      detail:
        age_s === null
          ? 'The vehicle reports no local position, so there is nothing to hold.'
          : `The last local position is ${ageText(age_s)} old: the current position is not known.`,
      reasons: [],
      remedy: 'Wait until it reports its position, then try again.',
      code: 'refused',
      status: 0,
      field: null,
    },
  };
}

/** Problems that pass: no answer, or a refusal that may not last (an estimate that is too old). */
const PASSING: readonly string[] = ['unreachable', 'refused'];

export class OffboardControl {
  steps = $state.raw<Steps>(STEPS[1] ?? { label: '1 m', metres: 1, yaw_deg: 15 });
  private readonly renewers = new Map<string, SetpointRenewer>();
  /** Called with each vehicle that gets a setpoint of its own, not a group's. */
  onAlone: (id: string) => void = () => undefined;
  /** Called when a renewal is refused: the setpoint will expire. */
  onNotRenewed: (id: string, problem: Problem) => void = () => undefined;

  constructor(
    private readonly api: ApiClient,
    private readonly turns: Turns,
    private readonly nowS: () => number,
  ) {}

  /** Starts the stream with the given setpoint, else with the vehicle's position. */
  async start(facts: VehicleFacts, wish: StartWish | null = null): Promise<Outcome<unknown>> {
    if (wish !== null) {
      const outcome = await this.begin(facts.id, wish.setpoint, wish.lasting, wish.rate_hz);
      wish.settled?.(outcome);
      return outcome;
    }
    const local = facts.local;
    const attitude = facts.attitude;
    if (local === null || attitude === null || local.stale || attitude.stale) return noPosition(local?.age_s ?? null);
    const setpoint: PositionSetpoint = {
      type: 'position',
      position_ned_m: local.value.position_ned_m,
      yaw_ned_rad: attitude.value.yaw_ned_rad,
    };
    return this.begin(facts.id, { ...setpoint }, LASTING);
  }

  /** Sends a new setpoint of any kind. If it is refused, the previous one is still renewed; without an answer it is unknown which one is flown, and none is renewed. */
  async send(id: string, setpoint: AnySetpoint, lasting: Lasting): Promise<Outcome<unknown>> {
    const renewer = this.renewer(id);
    this.onAlone(id);
    const refused = renewer.keep(setpoint, lasting, this.nowS());
    const outcome = await this.say(id, setpoint, lasting);
    if (!outcome.ok && outcome.problem.status !== 0) refused();
    if (renewer.setpoint !== setpoint) return outcome;
    if (outcome.ok) renewer.keep(repeatable(setpoint, outcome.value), lasting, this.nowS());
    else renewer.forget();
    return outcome;
  }

  /** A person steers directly now (gamepad, drag): the previous setpoint is no longer renewed. */
  forget(id: string): void {
    this.onAlone(id);
    this.drop(id);
  }

  /** The vehicle flies in a group now: its own setpoint is no longer renewed. */
  drop(id: string): void {
    this.renewers.get(id)?.forget();
  }

  private async begin(id: string, setpoint: AnySetpoint, lasting: Lasting, rate_hz?: number): Promise<Outcome<unknown>> {
    const { valid_for_s, on_expiry } = lasting;
    const outcome = await this.api.post('/vehicles/{v}/offboard/start', {
      ...ofVehicle(id),
      body: { setpoint: asBody(setpoint), valid_for_s, on_expiry, ...(rate_hz === undefined ? {} : { rate_hz }) },
    });
    if (outcome.ok) this.renewer(id).keep(repeatable(setpoint, outcome.value), lasting, this.nowS());
    return outcome;
  }

  /** One step along an axis from what is streamed now. */
  async nudge(facts: VehicleFacts, axis: Axis, sign: 1 | -1): Promise<Outcome<unknown>> {
    const renewer = this.renewer(facts.id);
    const streamed = facts.offboard;
    const from =
      wholePosition(renewer.setpoint) ??
      (streamed === null ? null : nudgeBase(streamed, facts.local?.value.position_ned_m ?? null, facts.attitude?.value.yaw_ned_rad ?? null));
    if (from === null) return noPosition(null);
    return this.send(facts.id, { ...nudge(from, axis, sign, this.steps) }, LASTING);
  }

  /** Leads its setpoints past obstacles from now on, or no longer. */
  avoid(id: string, on: boolean): Promise<Outcome<unknown>> {
    return this.api.put('/vehicles/{v}/offboard/avoidance', { ...ofVehicle(id), body: { on } });
  }

  /** Vehicles whose setpoint this page renews. */
  renewed(): string[] {
    return [...this.renewers].flatMap(([id, renewer]) => (renewer.setpoint === null ? [] : [id]));
  }

  /** Called as telemetry arrives. */
  tick(streaming: (id: string) => boolean): void {
    for (const [id, renewer] of this.renewers) renewer.tick(this.nowS(), streaming(id));
  }

  private say(id: string, setpoint: AnySetpoint, { valid_for_s, on_expiry }: Lasting): Promise<Outcome<unknown>> {
    return this.turns.run([id], () =>
      this.api.post('/vehicles/{v}/offboard/setpoint', { ...ofVehicle(id), body: { setpoint: asBody(setpoint), valid_for_s, on_expiry } }),
    );
  }

  private renewer(id: string): SetpointRenewer {
    let renewer = this.renewers.get(id);
    if (renewer === undefined) {
      renewer = new SetpointRenewer(async ({ setpoint, lasting }) => {
        const outcome = await this.say(id, setpoint, lasting);
        if (outcome.ok) return 'taken';
        if (PASSING.includes(outcome.problem.code)) return 'not now';
        this.onNotRenewed(id, outcome.problem);
        return 'refused';
      });
      this.renewers.set(id, renewer);
    }
    return renewer;
  }
}

/** An offset sent again would be flown again, so the position it led to is renewed instead. */
function repeatable(setpoint: AnySetpoint, answer: unknown): AnySetpoint {
  if (setpoint.type !== 'position_body') return setpoint;
  const streamed = (answer as { setpoint?: Record<string, unknown> | null } | null)?.setpoint ?? null;
  if (typeof streamed?.['type'] !== 'string') return setpoint;
  return Object.fromEntries(Object.entries(streamed).filter(([, value]) => value !== null)) as AnySetpoint;
}

/** The sent setpoint, if it is a position with a heading that can be nudged. */
function wholePosition(setpoint: AnySetpoint | null): PositionSetpoint | null {
  const place = setpoint?.['position_ned_m'];
  const yaw = setpoint?.['yaw_ned_rad'];
  if (setpoint?.type !== 'position' || typeof yaw !== 'number' || !Array.isArray(place)) return null;
  return { type: 'position', position_ned_m: place as [number, number, number], yaw_ned_rad: yaw };
}
