/** The stage: whether map or 3D view is large, and the 3D view's camera, vehicle and theme. */

import { covered } from '../../app/covered-edges.svelte';
import { freeMiddle } from '../../app/free-area';
import type { Camera } from '../../app/services';
import type { SceneDryRun, ScenePreview } from '../../app/preview.svelte';
import type { LayerPosition } from '../../app/map-layers.svelte';
import type { GeoPosition } from '../../vehicle/geo';
import { SceneOverview } from './scene-overview';

export type SceneState = { phase: 'asking' } | { phase: 'available' } | { phase: 'absent'; why: string };

/** The content of the 3D view. */
export interface SceneRequest {
  mode: Camera;
  vehicle: string | null;
  theme: 'light' | 'dark';
  /** Preview of the unsent setpoint; null: none. */
  preview: ScenePreview | null;
  dry_run: SceneDryRun | null;
}

/** Commands that keyboard shortcuts send to the map. */
export interface MapCommands {
  follow: () => void;
  near: () => void;
  northUp: () => void;
  /** Fits positions into the uncovered area. */
  show: (positions: readonly GeoPosition[]) => void;
  /** The middle of the uncovered area and the distance to its edge; null: the map is not drawn, or is the inset. */
  middle: () => { at: GeoPosition; edgeDistance_m: number } | null;
}

const RETRY_MS = 5000;
const SCENE_URL = '/scene/';

class StageState {
  scene = $state.raw<SceneState>({ phase: 'asking' });
  camera = $state<Camera>('chase');
  /** Key under which the server stores the state of this page's 3D view. */
  readonly token = `page-${Math.random().toString(36).slice(2, 12)}`;
  /** Size of the stage [px]. */
  size = $state.raw({ width: 0, height: 0 });
  /** Pixel of the point whose menu is open; it changes when the map moves. */
  mapPointAt = $state.raw({ x: 0, y: 0 });
  /**
   * Offset of the middle of the uncovered area from the stage's middle, right and down [px]. Map and 3D view show the
   * followed vehicle there.
   */
  readonly middle = $derived(freeMiddle(this.size, covered()));
  map: MapCommands | null = null;
  /** Fits positions into the 3D view; null: it shows no layer. */
  scenePositions: ((positions: readonly LayerPosition[]) => void) | null = null;
  /** The 3D view's camera while a plan is open. */
  readonly overview = new SceneOverview();
  /** The middle of the 3D view's uncovered ground; null: it shows no layer. */
  sceneMiddle: MapCommands['middle'] | null = null;
  private pendingView: SceneRequest | null = null;
  private mapChosen = $state(false);
  readonly main: 'map' | 'scene' = $derived(this.scene.phase === 'available' && !this.mapChosen ? 'scene' : 'map');

  get sceneAvailable(): boolean {
    return this.scene.phase === 'available';
  }

  swap(): void {
    if (this.scene.phase === 'available') this.mapChosen = !this.mapChosen;
  }

  /** Makes the map large. */
  showMap(): void {
    this.mapChosen = true;
  }

  showPositions(positions: readonly GeoPosition[]): void {
    this.map?.show(positions);
    if (this.main === 'scene') this.scenePositions?.(positions);
  }

  /** @param positions of the plan, for the map; the 3D view shows all its layers, once, when it is large. */
  showPlan(positions: readonly GeoPosition[]): void {
    if (positions.length > 0) this.map?.show(positions);
    this.overview.request(this.camera);
  }

  /** The plan that was shown is known completely now. */
  refitPlan(): void {
    this.overview.grow();
  }

  visibleMiddle(): { at: GeoPosition; edgeDistance_m: number } | null {
    return this.main === 'scene' ? (this.sceneMiddle?.() ?? null) : (this.map?.middle() ?? null);
  }

  /** Assigns only a changed value, because each assignment makes a new menu layout. */
  pointAt(at: { x: number; y: number }): void {
    const [x, y] = [Math.round(at.x), Math.round(at.y)];
    if (x !== this.mapPointAt.x || y !== this.mapPointAt.y) this.mapPointAt = { x, y };
  }

  /** The iframe's URL with its initial state. */
  address(view: SceneRequest): string {
    const query = new URLSearchParams({ view: this.token, mode: view.mode, theme: view.theme });
    if (view.vehicle !== null) query.set('vehicle', view.vehicle);
    return `${SCENE_URL}?${query}`;
  }

  /**
   * Sends the state to the running 3D view: one request at a time, and after each request only the newest state. A
   * failure is visible in the view and needs no message.
   */
  async show(view: SceneRequest): Promise<void> {
    const isSending = this.pendingView !== null;
    this.pendingView = view;
    if (isSending) return;
    for (let sentView: SceneRequest | null = null; sentView !== this.pendingView;) {
      sentView = this.pendingView;
      const { vehicle, ...rest } = sentView;
      const body = JSON.stringify(vehicle === null ? rest : sentView);
      await fetch(`${SCENE_URL}view/${this.token}`, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body }).catch(() => null);
    }
    this.pendingView = null;
  }

  /** Polls until the 3D view is available. */
  watch(): () => void {
    let ended = false;
    let timer: ReturnType<typeof setTimeout> | undefined;
    const ask = async (): Promise<void> => {
      const found = await probe();
      if (ended) return;
      this.scene = found;
      if (found.phase !== 'available') timer = setTimeout(() => void ask(), RETRY_MS);
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
    return isPage ? { phase: 'available' } : { phase: 'absent', why: 'the answer is not a page' };
  } catch {
    return { phase: 'absent', why: 'the server does not answer' };
  }
}

export const stage = new StageState();
