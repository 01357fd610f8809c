/** Which view fills the stage, and what the 3D one shows: its camera, its vehicle, its theme. */

import { covered } from '../../app/covers.svelte';
import { freeMiddle } from '../../app/free';
import type { Camera } from '../../app/services';
import type { SceneDryRun, ScenePreview } from '../../app/preview.svelte';
import type { Place } from '../../vehicle/geo';

export type SceneState = { phase: 'asking' } | { phase: 'there' } | { phase: 'absent'; why: string };

export interface SceneView {
  mode: Camera;
  vehicle: string | null;
  theme: 'light' | 'dark';
  /** What is not sent yet; null: nothing. */
  preview: ScenePreview | null;
  dry_run: SceneDryRun | null;
}

/** What the keyboard may ask of the map while it is shown. */
export interface MapCommands {
  follow: () => void;
  near: () => void;
  northUp: () => void;
  /** Puts places into what panels leave free. */
  show: (places: readonly Place[]) => void;
}

const RETRY_MS = 5000;
const SCENE_URL = '/scene/';

class StageState {
  scene = $state.raw<SceneState>({ phase: 'asking' });
  camera = $state<Camera>('chase');
  /** Under this name the server keeps what this page's 3D view shows. */
  readonly token = `page-${Math.random().toString(36).slice(2, 12)}`;
  /** Where the stage is on the screen [px]. */
  size = $state.raw({ width: 0, height: 0 });
  /** Where on the stage the place lies whose menu is open: the map moves under it [px]. */
  mapPointAt = $state.raw({ x: 0, y: 0 });
  /** The middle of what panels leave free, right of and below the stage's own [px]: there map and 3D view have their vehicle. */
  readonly middle = $derived(freeMiddle(this.size, covered()));
  map: MapCommands | null = null;
  private toTell: SceneView | null = null;
  private wantsMap = $state(false);
  readonly main: 'map' | 'scene' = $derived(this.scene.phase === 'there' && !this.wantsMap ? 'scene' : 'map');

  get sceneIsThere(): boolean {
    return this.scene.phase === 'there';
  }

  swap(): void {
    if (this.scene.phase === 'there') this.wantsMap = !this.wantsMap;
  }

  /** The map fills the stage, whichever view did. */
  showMap(): void {
    this.wantsMap = true;
  }

  showPlaces(places: readonly Place[]): void {
    this.map?.show(places);
  }

  /** Tells only what changed: the menu is laid out anew each time. */
  pointAt(at: { x: number; y: number }): void {
    const [x, y] = [Math.round(at.x), Math.round(at.y)];
    if (x !== this.mapPointAt.x || y !== this.mapPointAt.y) this.mapPointAt = { x, y };
  }

  /** The frame's address, with what it shows first. */
  address(view: SceneView): string {
    const query = new URLSearchParams({ view: this.token, mode: view.mode, theme: view.theme });
    if (view.vehicle !== null) query.set('vehicle', view.vehicle);
    return `${SCENE_URL}?${query}`;
  }

  /** Tells the running 3D view, one request at a time and then the newest; that it fails is seen, not worth a message. */
  async show(view: SceneView): Promise<void> {
    const telling = this.toTell !== null;
    this.toTell = view;
    if (telling) return;
    for (let told: SceneView | null = null; told !== this.toTell;) {
      told = this.toTell;
      const { vehicle, ...rest } = told;
      const body = JSON.stringify(vehicle === null ? rest : told);
      await fetch(`${SCENE_URL}view/${this.token}`, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body }).catch(() => null);
    }
    this.toTell = null;
  }

  /** Asks for the 3D view until it is there. */
  watch(): () => void {
    let ended = false;
    let timer: ReturnType<typeof setTimeout> | undefined;
    const ask = async (): Promise<void> => {
      const found = await probe();
      if (ended) return;
      this.scene = found;
      if (found.phase !== 'there') timer = setTimeout(() => void ask(), RETRY_MS);
    };
    void ask();
    return () => {
      ended = true;
      clearTimeout(timer);
    };
  }
}

async function probe(): Promise<SceneState> {
  try {
    const response = await fetch(SCENE_URL, { signal: AbortSignal.timeout(6000), headers: { Accept: 'text/html' } });
    void response.body?.cancel();
    if (!response.ok) return { phase: 'absent', why: `the server answered ${response.status}` };
    const isPage = response.headers.get('content-type')?.includes('text/html') === true;
    return isPage ? { phase: 'there' } : { phase: 'absent', why: 'the answer is not a page' };
  } catch {
    return { phase: 'absent', why: 'the server does not answer' };
  }
}

export const stage = new StageState();
