import { registry } from '../../app/registry.svelte';

registry.addVehiclePage({ id: 'autotune', title: 'Autotune', order: 20, load: () => import('./AutotunePage.svelte') });
