/** Takes photos with the selected camera of a vehicle. */

import { commandTo, type Command } from '../../app/actions/command.svelte';
import type { ApiClient } from '../../api/client';
import type { ActionController } from '../../app/actions/controller.svelte';
import type { Component } from '../../live/topics';
import type { VehicleFacts } from '../../vehicle/facts';

/** The cameras that have sent a heartbeat, in the order of their component ids, including cameras whose connection is lost. */
export function camerasOf(facts: VehicleFacts): Component[] {
  return facts.components.filter((component) => component.kind === 'camera');
}

/** Why the camera cannot take a photo now; null if it can. */
export function reasonNoPhoto(facts: VehicleFacts, camera: Component): string | null {
  if (facts.replayed) return 'A replayed vehicle accepts no commands.';
  if (facts.lost) return 'No connection to the vehicle.';
  return camera.lost ? 'No connection to the camera.' : null;
}

const PHOTO = 'Take photo';

export class CameraControl {
  /** The camera with which this page took its last photo. */
  private lastPhotoCamera = $state.raw<{ vehicle: string; camera: number } | null>(null);
  /** Component id of the camera that a person has selected, by vehicle. */
  private selectedIds = $state.raw<Readonly<Record<string, number>>>({});

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
  ) {}

  select(facts: VehicleFacts, componentId: number): void {
    this.selectedIds = { ...this.selectedIds, [facts.id]: componentId };
    this.lastPhotoCamera = null;
    this.actions.dismissRefusal('camera');
  }

  /** The selected camera; initially the first connected camera. Null if the vehicle has no camera. */
  selectedCamera(facts: VehicleFacts): Component | null {
    const cameras = camerasOf(facts);
    return cameras.find((camera) => camera.component_id === this.selectedIds[facts.id]) ?? cameras.find((camera) => !camera.lost) ?? cameras[0] ?? null;
  }

  /** Whether this page's last photo is from this camera. */
  hasTakenPhoto(facts: VehicleFacts, camera: Component): boolean {
    return this.lastPhotoCamera?.vehicle === facts.id && this.lastPhotoCamera.camera === camera.component_id;
  }

  /** Whether the camera has not answered the request for a photo yet. */
  isBusy(facts: VehicleFacts, camera: Component): boolean {
    return this.actions.gate.isWaiting({ name: PHOTO, vehicles: [facts.id], part: String(camera.component_id) });
  }

  async takePhoto(facts: VehicleFacts, camera: Component): Promise<void> {
    if (reasonNoPhoto(facts, camera) !== null) return;
    this.lastPhotoCamera = null;
    const component = camera.component_id;
    const send: Command['send'] = () => this.api.post('/vehicles/{v}/camera/picture', { params: { path: { v: facts.id }, query: { component } } });
    const accepted = await this.actions.attempt(commandTo(facts, PHOTO, send, { part: String(component) }), 'camera');
    if (accepted) this.lastPhotoCamera = { vehicle: facts.id, camera: component };
  }
}
