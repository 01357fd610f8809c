/** The draft of a guided command, its limits, and the commands that the vehicles have accepted. */

import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { ConfirmationTexts } from '../../app/actions/actions';
import { commandTo } from '../../app/actions/command.svelte';
import { MAIN_PART, type ActionController } from '../../app/actions/controller.svelte';
import type { LayerContent, LayerEditor } from '../../app/map-layers.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import type { GeoPosition } from '../../vehicle/geo';
import type { DeviceFollowing } from './device.svelte';
import { followStart } from './follow';
import {
  confirmationTexts,
  futuresOf,
  FIELDS,
  followingOf,
  headingTo,
  KIND_NAMES,
  NO_LIMITS,
  numberOf,
  PARAMETERS,
  placeOf,
  previewContent,
  whyNot,
  type Accepted,
  type Draft,
  type Field,
  type Kind,
  type Limits,
  type Place,
} from './guided';

const EMPTY: Draft = {
  kind: 'altitude',
  place: null,
  texts: { alt_home_m: '', yaw_ned_deg: '', speed_m_s: '', radius_m: '20', behind_m: '5', above_m: '2', distance_m: '15' },
  clockwise: true,
  nose: 'vehicle',
  leader: '',
  followNose: 'keep',
};
const DEFAULT_ORBIT_SPEED = '3';

export class GuidedCommands {
  draft = $state.raw<Draft>(EMPTY);
  /** Following this device, once the panel has loaded it. */
  device = $state.raw<DeviceFollowing | null>(null);
  /** The vehicle of the draft; null: none yet. */
  private vehicle = $state<string | null>(null);
  private limits = $state.raw<Readonly<Record<string, Limits>>>({});
  private accepted = $state.raw<Readonly<Record<string, Accepted>>>({});

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
    /** The vehicle's present state; null: it was removed. */
    private readonly factsNow: (id: string) => VehicleFacts | null,
  ) {}

  limitsOf(id: string): Limits {
    return this.limits[id] ?? NO_LIMITS;
  }

  /** The newest command that the vehicle has accepted; null: none. */
  acceptedOf(id: string): Accepted | null {
    return this.accepted[id] ?? null;
  }

  /** Begins a command with the vehicle's present values. @param place the position from the map; null: the vehicle's. */
  open(kind: Kind, facts: VehicleFacts, place: Place | null = null): void {
    const alt_m = Math.round((facts.globalPosition?.value.alt_home_m ?? 10) * 10) / 10;
    const heading_deg = facts.globalPosition?.value.heading_deg ?? null;
    const texts = {
      ...EMPTY.texts,
      alt_home_m: String(alt_m),
      yaw_ned_deg:
        kind === 'heading' && place !== null ? headingTo(place, facts) : kind === 'go' || heading_deg === null ? '' : String(Math.round(heading_deg)),
      speed_m_s: kind === 'orbit' ? DEFAULT_ORBIT_SPEED : '',
    };
    const leader = this.draft.leader === facts.id ? '' : this.draft.leader;
    this.draft = { ...this.draft, kind, place, texts, leader };
    this.vehicle = facts.id;
    if (!facts.replayed && !facts.lost) void this.loadLimits(facts.id);
  }

  /** Shows the draft for the selected vehicle; another vehicle gets its own values. */
  selectVehicle(facts: VehicleFacts): void {
    if (this.vehicle !== facts.id) this.open(this.draft.kind === 'go' ? 'altitude' : this.draft.kind, facts);
  }

  choose(kind: Kind, facts: VehicleFacts): void {
    this.open(kind, facts, this.draft.place);
  }

  /** Uses the vehicle's position instead of the one from the map. */
  forgetPlace(): void {
    this.draft = { ...this.draft, place: null };
  }

  enter(field: Field, text: string): void {
    const place = this.draft.kind === 'heading' ? null : this.draft.place; // an entered heading is no longer that of a place
    this.draft = { ...this.draft, place, texts: { ...this.draft.texts, [field]: text } };
  }

  change(changes: Partial<Pick<Draft, 'clockwise' | 'nose' | 'leader' | 'followNose'>>): void {
    this.draft = { ...this.draft, ...changes };
  }

  /** A click on the map or a drag moves the position of the draft. */
  readonly editor: LayerEditor = {
    pick: () => undefined,
    grab: (id) => {
      this.dragged = this.draft;
      return id;
    },
    drag: (_, at) => this.moveTo(at),
    raise: () => undefined,
    drop: (keep) => {
      if (!keep) this.draft = this.dragged;
    },
    press: (at) => {
      this.moveTo(at);
      return true;
    },
    remove: () => false,
  };
  /** The draft before a drag. */
  private dragged: Draft = EMPTY;

  private moveTo({ lat_deg, lon_deg }: GeoPosition): void {
    const place = { lat_deg, lon_deg, ground_amsl_m: null };
    const facts = this.vehicle === null ? null : this.factsNow(this.vehicle);
    const texts = this.draft.kind === 'heading' && facts !== null ? { ...this.draft.texts, yaw_ned_deg: headingTo(place, facts) } : this.draft.texts;
    this.draft = { ...this.draft, place, texts };
  }

  /** What the map shows of the draft; null: nothing. */
  preview(facts: VehicleFacts | null): LayerContent | null {
    if (facts === null || facts.id !== this.vehicle || this.draft.kind === 'device') return null;
    return previewContent(this.draft, facts, this.limitsOf(facts.id));
  }

  /** Whether the command has a position, which a click on the map sets. */
  get usesPlace(): boolean {
    return this.draft.kind === 'go' || this.draft.kind === 'orbit' || this.draft.kind === 'home' || this.draft.kind === 'heading';
  }

  /** Opens the confirmation of the draft, which says the effect with numbers. */
  request(facts: VehicleFacts): void {
    const draft = this.draft;
    const { kind } = draft;
    if (kind === 'device') return this.device?.request(draft, facts, this.limitsOf(facts.id));
    const at = placeOf(draft, facts);
    const leader = draft.kind === 'follow' ? this.factsNow(draft.leader) : null;
    if (at === null || whyNot(draft, facts, this.limitsOf(facts.id), leader) !== null) return;
    const accept = (outcome: Outcome<unknown>): void => {
      if (!outcome.ok) return;
      this.accepted = { ...this.accepted, [facts.id]: { draft, at } };
      this.device?.forget(facts.id);
    };
    if (kind === 'follow') {
      if (leader !== null) this.actions.request('offboard_start', facts, MAIN_PART, null, followStart(followingOf(draft), leader, accept));
      return;
    }
    const present = (): VehicleFacts => this.factsNow(facts.id) ?? facts;
    const changed = (): string | null => {
      const now = this.factsNow(facts.id);
      return now === null || now.inAir === facts.inAir ? null : `${facts.name} has ${facts.inAir ? 'landed' : 'taken off'} since the command was given.`;
    };
    const send = async (despite: readonly string[]): Promise<Outcome<unknown>> => {
      const outcome = await this.send({ ...draft, kind }, facts.id, at, despite);
      accept(outcome);
      return outcome;
    };
    const command = commandTo(facts, KIND_NAMES[draft.kind], send, { changed, acceptsFindings: true });
    const texts = (): ConfirmationTexts => confirmationTexts(draft, present(), this.limitsOf(facts.id));
    const futures = futuresOf(draft, at);
    this.actions.requestCommand(futures === null ? { ...command, texts } : { ...command, texts, futures: () => futures }, MAIN_PART);
  }

  /** @param codes findings about the geofence that the person has accepted. */
  private send(
    draft: Draft & { kind: Exclude<Kind, 'follow' | 'device'> },
    id: string,
    { lat_deg, lon_deg }: GeoPosition,
    codes: readonly string[],
  ): Promise<Outcome<unknown>> {
    const params = ofVehicle(id);
    const accepted = codes.length === 0 ? {} : { despite: [...codes] };
    const given = Object.fromEntries(FIELDS[draft.kind].flatMap((field) => ((value) => (value === null ? [] : [[field, value]]))(numberOf(draft, field))));
    const value = (field: Field): number => given[field] as number;
    switch (draft.kind) {
      case 'go':
        return this.api.post('/vehicles/{v}/goto', { ...params, body: { lat_deg, lon_deg, ...given, ...accepted } });
      case 'altitude':
        return this.api.post('/vehicles/{v}/altitude', { ...params, body: { alt_home_m: value('alt_home_m'), ...accepted } });
      case 'heading':
        return this.api.post('/vehicles/{v}/heading', { ...params, body: { yaw_ned_deg: value('yaw_ned_deg') } });
      case 'speed':
        return this.api.post('/vehicles/{v}/speed', { ...params, body: { speed_m_s: value('speed_m_s') } });
      case 'orbit': {
        const nose = draft.nose === 'vehicle' ? {} : { yaw: draft.nose };
        const circle = { lat_deg, lon_deg, alt_home_m: value('alt_home_m'), radius_m: value('radius_m'), speed_m_s: value('speed_m_s') };
        return this.api.post('/vehicles/{v}/orbit', { ...params, body: { ...circle, clockwise: draft.clockwise, ...nose, ...accepted } });
      }
      case 'home': {
        const ground_m = draft.place?.ground_amsl_m ?? null;
        const body = draft.place === null ? { here: true } : { lat_deg, lon_deg, ...(ground_m === null ? {} : { alt_amsl_m: ground_m }) };
        return this.api.post('/vehicles/{v}/home', { ...params, body });
      }
    }
  }

  /** Reads the parameters that limit the commands, once for each vehicle. */
  private async loadLimits(id: string): Promise<void> {
    if (id in this.limits) return;
    this.limits = { ...this.limits, [id]: NO_LIMITS };
    for (const [field, name] of Object.entries(PARAMETERS)) {
      const response = await this.api.get('/vehicles/{v}/params/{name}', { params: { path: { v: id, name } } });
      if (response.ok && typeof response.value.value === 'number')
        this.limits = { ...this.limits, [id]: { ...this.limitsOf(id), [field]: response.value.value } };
    }
    if (Object.values(this.limitsOf(id)).every((value) => value === null)) {
      const { [id]: _failed, ...others } = this.limits;
      this.limits = others; // read again when the panel opens again
    }
  }
}
