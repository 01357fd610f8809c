/** Map and 3D view, which the page loads after it has shown the rest. */

export { default as MapPointMenu } from './MapPointMenu.svelte';
export { default as MapView } from './MapView.svelte';
export { default as SceneFrame } from './SceneFrame.svelte';
