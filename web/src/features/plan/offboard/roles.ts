/** Adds, renames and removes roles of a mission, and says what the server has planned for them. Pure: each function returns a new mission. */

import { distance, durationText, lengthText } from '../../../ui/format';
import { roleNames, type CompiledFlight, type Mission, type Role, type Step } from './mission';
import { newStep } from './step-titles';

export const MAX_ROLES = 10;
/** A new role starts at this distance east of the easternmost start [m]. */
const ROLE_SPACING_M = 10;

function newRoleName(mission: Mission, requestedName: string): string {
  const existingNames = roleNames(mission);
  let number = existingNames.length + 1;
  if (!existingNames.includes(requestedName)) return requestedName;
  while (existingNames.includes(`role ${number}`)) number += 1;
  return `role ${number}`;
}

/** Steps of a new role: take-off, the "meet" steps of another role, landing. */
function newRoleSteps(otherRoleSteps: readonly Step[]): readonly Step[] {
  const meetings = otherRoleSteps.filter((step) => step.step === 'meet').map((step) => ({ ...step }));
  return [newStep('take_off'), ...meetings, newStep('land')];
}

/** Adds a role. In a mission for one vehicle, the steps become those of a first role. */
export function addRole(mission: Mission): Mission {
  const roles: Readonly<Record<string, Role>> =
    roleNames(mission).length > 0 ? (mission.roles ?? {}) : { lead: { start_ned_m: [0, 0, 0], steps: mission.steps } };
  const existingRoles = Object.values(roles);
  const starts = existingRoles.map((role) => role.start_ned_m ?? null);
  const [north = 0, , down = 0] = starts.at(-1) ?? [];
  const east = Math.max(...starts.map((start) => start?.[1] ?? 0)) + ROLE_SPACING_M;
  const role: Role = { start_ned_m: starts.includes(null) ? null : [north, east, down], steps: newRoleSteps(existingRoles[0]?.steps ?? []) };
  const withRoles = { ...mission, roles, steps: [] };
  return { ...withRoles, roles: { ...roles, [newRoleName(withRoles, 'wing')]: role } };
}

/** Why a role cannot have this name; null: the name is permitted. */
export function nameProblem(mission: Mission, old: string, name: string): string | null {
  if (name.trim() === '') return 'A role needs a name.';
  if (name !== old && roleNames(mission).includes(name)) return `A role named “${name}” already exists.`;
  return null;
}

export function renameRole(mission: Mission, old: string, name: string): Mission {
  const roles = Object.entries(mission.roles ?? {}).map(([roleName, role]) => [roleName === old ? name : roleName, role] as const);
  return { ...mission, roles: Object.fromEntries(roles) };
}

export function setRole(mission: Mission, name: string, fields: Partial<Role>): Mission {
  const role = mission.roles?.[name];
  return role === undefined ? mission : { ...mission, roles: { ...mission.roles, [name]: { ...role, ...fields } } };
}

/** Removes a role. If only one role remains, the mission becomes a mission for one vehicle, without "meet" steps. */
export function removeRole(mission: Mission, name: string): Mission {
  const { [name]: _removed, ...roles } = mission.roles ?? {};
  const [remainingRole, ...otherRoles] = Object.values(roles);
  if (remainingRole === undefined || otherRoles.length > 0) return { ...mission, roles };
  const { roles: _roles, minimum_separation_m: _separation, ...rest } = mission;
  return { ...rest, steps: withoutMeetings(remainingRole.steps) };
}

function withoutMeetings(steps: readonly Step[]): readonly Step[] {
  return steps.filter((step) => step.step !== 'meet').map((step) => (step.step === 'repeat' ? { ...step, steps: withoutMeetings(step.steps ?? []) } : step));
}

/** Time, length and photos of a role; empty until the server has compiled it. */
export function roleFigures(flight: CompiledFlight, role: string): string {
  const planned = flight.roles.find((each) => each.role === role);
  if (planned === undefined) return '';
  const length = distance(planned.length_m);
  return [durationText(planned.time_s), `${length.text} ${length.unit}`, ...(planned.photos > 0 ? [`${planned.photos} photos`] : [])].join(' · ');
}

/** The smallest planned distance of two vehicles; null: one vehicle, or the places are not known. */
export function closestText(flight: CompiledFlight): string | null {
  const [first, ...rest] = flight.closest;
  if (first === undefined) return null;
  const { roles, distance_m, t_s } = rest.reduce((nearest, each) => (each.distance_m < nearest.distance_m ? each : nearest), first);
  return `Smallest planned distance: ${lengthText(distance_m)}, ${roles[0]} and ${roles[1]} after ${durationText(t_s)}.`;
}
