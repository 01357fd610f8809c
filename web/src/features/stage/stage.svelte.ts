/** Which view fills the stage; the 3D one only if it answers. */

export type SceneState = { phase: 'asking' } | { phase: 'there' } | { phase: 'absent'; why: string };

const RETRY_MS = 5000;
export const SCENE_URL = '/scene/';

class StageState {
  scene = $state.raw<SceneState>({ phase: 'asking' });
  private wantsMap = $state(false);
  readonly main: 'map' | 'scene' = $derived(this.scene.phase === 'there' && !this.wantsMap ? 'scene' : 'map');

  swap(): void {
    if (this.scene.phase === 'there') this.wantsMap = !this.wantsMap;
  }

  /** Asks for the 3D view until it is there, and watches that it stays. */
  watch(): () => void {
    let ended = false;
    let timer: ReturnType<typeof setTimeout> | undefined;
    const ask = async (): Promise<void> => {
      const found = await probe();
      if (ended) return;
      if (found.phase !== this.scene.phase || found.phase === 'absent') this.scene = found;
      timer = setTimeout(() => void ask(), RETRY_MS);
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
    const response = await fetch(SCENE_URL, { signal: AbortSignal.timeout(4000), headers: { Accept: 'text/html' } });
    if (!response.ok) return { phase: 'absent', why: `it answers ${response.status}` };
    const text = await response.text();
    return text.includes('<html') || text.includes('<!doctype') || text.includes('<!DOCTYPE')
      ? { phase: 'there' } : { phase: 'absent', why: 'what answers is no page' };
  } catch {
    return { phase: 'absent', why: 'it does not answer' };
  }
}

export const stage = new StageState();
