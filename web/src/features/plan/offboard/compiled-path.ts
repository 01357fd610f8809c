/** A mission's path and times, compiled by the server. */

import type { components } from '../../../api/schema';

type Schemas = components['schemas'];

export type StepTime = Readonly<Schemas['PlanStepTime']>;
export type Leg = Readonly<Omit<Schemas['PlanLeg'], 'points'>> & { readonly points: readonly (readonly [number, number, number, number])[] };
export type Flight = Readonly<Omit<Schemas['OffboardFlight'], 'legs'>> & { readonly legs: readonly Leg[] };
