import { registry } from '../../app/registry.svelte';
import { provide } from '../../app/services';
import { gimbal } from './controllers';
import GimbalCards from './GimbalCards.svelte';

provide('gimbal', gimbal);
registry.addTo('cards', { order: 40, vehicleComponent: GimbalCards });
