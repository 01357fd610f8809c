/** The page's only gamepad: read 25 times a second while somebody flies or turns the gimbal with it, or looks at it. */

import { ofVehicle } from '../../api/client';
import { commandTo } from '../../app/actions/command.svelte';
import { page } from '../../app/page.svelte';
import { service } from '../../app/services';
import { userSettings } from '../../app/settings.svelte';
import { actions } from '../../app/vehicle-actions.svelte';
import { Pads } from './pads.svelte';
import type { FlightHost, Flown } from './flight.svelte';

/** The part of the page that shows refusals of these commands. */
export const PART = 'sticks';

export const holdByStick = (flown: Flown): Promise<unknown> =>
  actions.attempt(
    commandTo(flown, 'Hold', () => page.api.post('/vehicles/{v}/hold', ofVehicle(flown.id)), { stops: true }),
    PART,
  );

const host: FlightHost = {
  openSocket: (vehicle) => new WebSocket(page.socketUrl(`/vehicles/${encodeURIComponent(vehicle)}/manual_control/stream`)),
  selectedId: () => page.selectedId,
  inAir: (vehicle) => page.factsNow(vehicle)?.inAir === true,
  hold: holdByStick,
  act: (action, vehicle) => actions.request(action, page.factsNow(vehicle), PART),
};

export const pads = new Pads(
  host,
  () => userSettings.get('gamepad'),
  (vehicle, rates) => {
    const facts = page.factsNow(vehicle);
    if (facts !== null) service('gimbal').turnAt(service('gimbal').withSelectedGimbal(facts), rates.pitch, rates.yaw);
  },
);
