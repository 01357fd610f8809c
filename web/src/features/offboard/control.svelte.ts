/** This page as a source of setpoints: starts the stream where the vehicle is, nudges it, says it again in time. */

import type { VehicleFacts } from '../../app/facts';
import type { ApiClient, Outcome } from '../../api/client';
import { ageText } from '../../live/age';
import { SetpointKeeper } from './keeper';
import { nudge, ON_EXPIRY, STEPS, VALID_FOR_S, type Axis, type PositionSetpoint, type Steps } from './setpoint';
import { nudgeBase } from './view';

/** What the page says itself, without the server: no position, nothing to hold. */
function noPosition(age_s: number | null): Outcome<never> {
  return {
    ok: false,
    problem: {
      title: 'Not sent', detail: age_s === null ? 'The vehicle reports no local position, so there is nothing to hold.' : `The last local position is ${ageText(age_s)} old: where it is now is not known.`, reasons: [],
      remedy: 'Wait until it reports its position, then try again.', code: 'refused', status: 0, field: null,
    },
  };
}

export class OffboardControl {
  steps = $state.raw<Steps>(STEPS[1] ?? { label: '1 m', metres: 1, yaw_deg: 15 });
  private readonly keepers = new Map<string, SetpointKeeper>();

  constructor(
    private readonly api: ApiClient,
    private readonly nowS: () => number,
  ) {}

  /** Starts the stream with the place where the vehicle is. */
  async start(facts: VehicleFacts): Promise<Outcome<unknown>> {
    const local = facts.local;
    const attitude = facts.attitude;
    if (local === null || attitude === null || local.stale || attitude.stale) return noPosition(local?.age_s ?? null);
    const setpoint: PositionSetpoint = {
      type: 'position', position_ned_m: local.value.position_ned_m, yaw_ned_rad: attitude.value.yaw_ned_rad,
    };
    const outcome = await this.api.post(`${base(facts.id)}/start`, { setpoint, valid_for_s: VALID_FOR_S, on_expiry: ON_EXPIRY });
    if (outcome.ok) this.keeper(facts.id).keep(setpoint, this.nowS());
    return outcome;
  }

  /** One step along an axis from what is streamed now. */
  async nudge(facts: VehicleFacts, axis: Axis, sign: 1 | -1): Promise<Outcome<unknown>> {
    const keeper = this.keeper(facts.id);
    const streamed = facts.offboard;
    const from = keeper.setpoint ?? (streamed === null ? null
      : nudgeBase(streamed, facts.local?.value.position_ned_m ?? null, facts.attitude?.value.yaw_ned_rad ?? null));
    if (from === null) return noPosition(null);
    const next = nudge(from, axis, sign, this.steps);
    keeper.keep(next, this.nowS());
    const outcome = await this.say(facts.id, next);
    if (!outcome.ok) keeper.forget();
    return outcome;
  }

  /** Called as telemetry arrives. */
  tick(streaming: (id: string) => boolean): void {
    for (const [id, keeper] of this.keepers) keeper.tick(this.nowS(), streaming(id));
  }

  private say(id: string, setpoint: PositionSetpoint): Promise<Outcome<unknown>> {
    return this.api.post(`${base(id)}/setpoint`, { ...setpoint, valid_for_s: VALID_FOR_S, on_expiry: ON_EXPIRY });
  }

  private keeper(id: string): SetpointKeeper {
    let keeper = this.keepers.get(id);
    if (keeper === undefined) {
      keeper = new SetpointKeeper(async (setpoint) => (await this.say(id, setpoint)).ok);
      this.keepers.set(id, keeper);
    }
    return keeper;
  }
}

function base(id: string): string {
  return `/vehicles/${encodeURIComponent(id)}/offboard`;
}
