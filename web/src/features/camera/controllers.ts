import { page } from '../../app/page.svelte';
import { actions } from '../../app/vehicle-actions.svelte';
import { CameraControl } from './control.svelte';

/** The page's only CameraControl instance. */
export const cameraControl = new CameraControl(page.api, actions);
