import { registry } from '../../app/registry.svelte';
import CameraCard from './CameraCard.svelte';

registry.addTo('cards', { order: 45, vehicleComponent: CameraCard });
