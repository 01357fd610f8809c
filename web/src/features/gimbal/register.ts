import { registry } from '../../app/registry.svelte';
import { provide } from '../../app/services';
import { gimbalControl } from './controllers';
import GimbalCards from './GimbalCards.svelte';

provide('gimbal', gimbalControl);
registry.addVehiclePage({ id: 'gimbal', title: 'Gimbal', order: 10, load: () => import('./setup/GimbalSetupPage.svelte') });
registry.addTo('cards', { order: 40, vehicleComponent: GimbalCards });
