/** Takes pictures with the selected camera of a vehicle. */

import type { ApiClient } from '../../api/client';
import type { ActionController } from '../../app/actions/controller.svelte';
import type { Component } from '../../live/topics';
import type { VehicleFacts } from '../../vehicle/facts';

/** The cameras that have sent a heartbeat, in the order of their component ids; lost ones too. */
export function camerasOf(facts: VehicleFacts): Component[] {
  return facts.components.filter((one) => one.kind === 'camera');
}

/** Why the camera cannot take a picture now; null if it can. */
export function whyNoPicture(facts: VehicleFacts, camera: Component): string | null {
  if (facts.replayed) return 'A recording takes no commands.';
  if (facts.lost) return 'No connection to the vehicle.';
  return camera.lost ? 'No connection to the camera.' : null;
}

export class CameraControl {
  busy = $state(false);
  /** The camera that took the last picture of this page. */
  private taken = $state.raw<{ vehicle: string; camera: number } | null>(null);
  /** Component id of the camera that a person has selected, by vehicle. */
  private chosen = $state.raw<Readonly<Record<string, number>>>({});

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
  ) {}

  select(facts: VehicleFacts, component: number): void {
    this.chosen = { ...this.chosen, [facts.id]: component };
    this.taken = null;
    this.actions.dismiss('camera');
  }

  /** The selected camera; initially the first that is connected. Null if the vehicle has none. */
  selected(facts: VehicleFacts): Component | null {
    const cameras = camerasOf(facts);
    return cameras.find((one) => one.component_id === this.chosen[facts.id]) ?? cameras.find((one) => !one.lost) ?? cameras[0] ?? null;
  }

  hasTaken(facts: VehicleFacts, camera: Component): boolean {
    return this.taken?.vehicle === facts.id && this.taken.camera === camera.component_id;
  }

  async takePicture(facts: VehicleFacts, camera: Component): Promise<void> {
    if (this.busy || whyNoPicture(facts, camera) !== null) return;
    this.busy = true;
    this.taken = null;
    const component = camera.component_id;
    const taken = await this.actions.attempt('Take photo', facts, 'camera', () =>
      this.api.post('/vehicles/{v}/camera/picture', { params: { path: { v: facts.id }, query: { component } } }),
    );
    this.busy = false;
    if (taken) this.taken = { vehicle: facts.id, camera: component };
  }
}
