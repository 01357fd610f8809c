/** The path and the times that the server has compiled from a mission. */

import type { components } from '../../../api/schema';

type Schemas = components['schemas'];

export type StepTime = Readonly<Schemas['PlanStepTime']>;
export type Leg = Readonly<Omit<Schemas['PlanLeg'], 'points'>> & { readonly points: readonly (readonly [number, number, number, number])[] };
export type CompiledFlight = Readonly<Omit<Schemas['OffboardFlight'], 'legs'>> & { readonly legs: readonly Leg[] };
