/** The menu at a map point: its state, altitudes and requests. */

import { commandTo } from '../../app/actions/command.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import type { ApiClient, Outcome } from '../../api/client';
import type { WireEvent } from '../../live/wire';
import type { ActionController } from '../../app/actions/controller.svelte';
import { service } from '../../app/services';
import { userSettings } from '../../app/settings.svelte';
import type { Pixel } from '../../vehicle/geo';
import { gimbalKey, gimbalParams } from '../../vehicle/gimbal';
import { isTargetActive, type RequestedTarget, type RequestedTargets } from './map-model';
import { suggestedGoAlt_home_m, distance_m, flightTime_s, altitudeInRange, homeAmsl_m, lookAngles, NO_SPEEDS, type Speeds, type MapPoint } from './map-point';

type ActiveTarget = RequestedTarget & { since_s: number };

/** PX4's parameters for the speeds in automatic modes. */
const SPEED_PARAMETERS = { horizontal_m_s: 'MPC_XY_CRUISE', up_m_s: 'MPC_Z_V_AUTO_UP', down_m_s: 'MPC_Z_V_AUTO_DN' } as const;

function roundToTenth(value: number): number {
  return Math.round(value * 10) / 10;
}

export class MapPointMenu {
  mapPoint = $state.raw<MapPoint | null>(null);
  /** Id of the vehicle to which the menu sends commands. */
  vehicle = $state<string | null>(null);
  /** Altitude to fly to, above home. */
  goto_home_m = $state(0);
  /** Altitude of the point to look at, above home. */
  point_home_m = $state(0);
  /** A person has chosen `goto_home_m` in the open menu. */
  private isAltitudeChosen = false;
  private speeds = $state.raw<Record<string, Speeds>>({});
  private readonly activeTargets = new Map<string, ActiveTarget>();

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
    private readonly nowS: () => number,
  ) {}

  open(mapPoint: MapPoint, facts: VehicleFacts | null): void {
    if (facts === null) return;
    const home = homeAmsl_m(facts);
    if (this.mapPoint === null || this.vehicle !== facts.id) this.isAltitudeChosen = false;
    if (!this.isAltitudeChosen)
      this.goto_home_m = suggestedGoAlt_home_m(facts, mapPoint, this.actions.takeoffAlt_home_m, userSettings.get('default_altitudes')?.go_m ?? null);
    this.point_home_m = mapPoint.ground_amsl_m === null || home === null ? 0 : roundToTenth(mapPoint.ground_amsl_m - home);
    this.actions.dismissRefusal('stage');
    if (this.actions.confirmation?.pagePart === 'stage') this.actions.cancelConfirmation();
    this.mapPoint = mapPoint;
    this.vehicle = facts.id;
    if (!facts.replayed && !facts.lost) void this.loadSpeeds(facts.id);
  }

  close(): void {
    this.mapPoint = null;
    this.actions.dismissRefusal('stage');
  }

  /** Handles the server's event about a click in this page's 3D view. @param viewId id of this page's 3D view. */
  onSceneClick(event: WireEvent, viewId: string, size: { width: number; height: number }, facts: VehicleFacts | null): void {
    const number = (name: string): number | null => (typeof event[name] === 'number' ? (event[name] as number) : null);
    const [lat_deg, lon_deg, x, y] = [number('lat_deg'), number('lon_deg'), number('view_x'), number('view_y')];
    if (event.kind !== 'scene_click' || event['view'] !== viewId || lat_deg === null || lon_deg === null) return;
    const scenePixel: Pixel = { x: (x ?? 0.5) * size.width, y: (y ?? 0.5) * size.height };
    this.open({ lat_deg, lon_deg, ground_amsl_m: number('alt_amsl_m'), scenePixel }, facts);
  }

  speedsOf(id: string): Speeds {
    return this.speeds[id] ?? NO_SPEEDS;
  }

  setAltitude(field: 'goto_home_m' | 'point_home_m', value_m: number): void {
    this[field] = altitudeInRange(value_m) ?? this[field];
    if (field === 'goto_home_m') this.isAltitudeChosen = true;
  }

  /** Opens the confirmation of "Go here". */
  requestGoto(facts: VehicleFacts): void {
    const mapPoint = this.mapPoint;
    const toPoint_m = mapPoint === null ? null : distance_m(facts, mapPoint);
    if (mapPoint === null || toPoint_m === null) return;
    const { lat_deg, lon_deg } = mapPoint;
    const alt_home_m = this.goto_home_m;
    this.actions.request('goto', facts, 'stage', {
      lat_deg,
      lon_deg,
      alt_home_m,
      distance_m: toPoint_m,
      time_s: flightTime_s(facts, mapPoint, alt_home_m, this.speedsOf(facts.id)),
      onResult: (accepted) => {
        if (!accepted) return;
        this.activeTargets.set(facts.id, { lat_deg, lon_deg, alt_home_m, since_s: this.nowS() });
        if (this.mapPoint === mapPoint) this.close();
      },
    });
  }

  /** Points the selected gimbal at the point once. @param facts with the selected gimbal. */
  async lookAt(facts: VehicleFacts): Promise<void> {
    const angles = this.mapPoint === null ? null : lookAngles(facts, this.mapPoint, this.point_home_m);
    if (angles === null) return;
    const lock = service('gimbal').yawLock(facts);
    const body = { pitch_deg: roundToTenth(angles.pitch_deg), yaw_deg: roundToTenth(lock ? angles.yaw_ned_deg : angles.yaw_deg), yaw_lock: lock };
    await this.send('Look here', facts, () => this.api.post('/vehicles/{v}/gimbal/angles', { ...gimbalParams(facts), body }));
  }

  /** Sets the point as the region of interest (ROI) of the selected gimbal. @param facts with the selected gimbal. */
  async setRoi(facts: VehicleFacts): Promise<void> {
    const home = homeAmsl_m(facts);
    if (this.mapPoint === null || home === null) return;
    const { lat_deg, lon_deg } = this.mapPoint;
    const body = { lat_deg, lon_deg, alt_amsl_m: home + this.point_home_m };
    await this.send('Set ROI', facts, () => this.api.post('/vehicles/{v}/gimbal/roi', { ...gimbalParams(facts), body }));
  }

  /** The targets that the map draws for a vehicle. */
  targetsOf(facts: VehicleFacts): RequestedTargets {
    const target = this.activeTargets.get(facts.id);
    if (target !== undefined && !isTargetActive(target, facts, this.nowS())) this.activeTargets.delete(facts.id);
    const roi = service('gimbal').roiOf(service('gimbal').withSelectedGimbal(facts));
    const home = homeAmsl_m(facts);
    const roiTarget = roi === null ? null : { lat_deg: roi.lat_deg, lon_deg: roi.lon_deg, alt_home_m: home === null ? null : roi.alt_amsl_m - home };
    return { go: this.activeTargets.get(facts.id) ?? null, roi: roiTarget };
  }

  private async send(commandName: string, facts: VehicleFacts, request: () => Promise<Outcome<unknown>>): Promise<void> {
    const mapPoint = this.mapPoint;
    const accepted = await this.actions.attempt(commandTo(facts, commandName, request, { part: gimbalKey(facts) }), 'stage');
    await service('gimbal').fetchControlAndRoi(facts);
    if (accepted && this.mapPoint === mapPoint) this.close(); // not the menu of another point or vehicle, opened meanwhile
  }

  /** Whether a camera command of this menu has no answer yet. */
  isBusy(facts: VehicleFacts): boolean {
    return ['Look here', 'Set ROI'].some((name) => this.actions.gate.isWaiting({ name, vehicles: [facts.id], part: gimbalKey(facts) }));
  }

  private async loadSpeeds(id: string): Promise<void> {
    if (id in this.speeds) return;
    this.speeds = { ...this.speeds, [id]: NO_SPEEDS };
    const readParameter = async (name: string): Promise<number | null> => {
      const response = await this.api.get('/vehicles/{v}/params/{name}', { params: { path: { v: id, name } } });
      return response.ok && typeof response.value.value === 'number' ? response.value.value : null;
    };
    const horizontal_m_s = await readParameter(SPEED_PARAMETERS.horizontal_m_s);
    const up_m_s = await readParameter(SPEED_PARAMETERS.up_m_s);
    const down_m_s = await readParameter(SPEED_PARAMETERS.down_m_s);
    if (horizontal_m_s === null) {
      const { [id]: _failed, ...otherSpeeds } = this.speeds;
      this.speeds = otherSpeeds; // when the menu opens again, the page requests the parameters again
    } else this.speeds = { ...this.speeds, [id]: { horizontal_m_s, up_m_s, down_m_s } };
  }
}
