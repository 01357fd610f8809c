/** Fixes that the page can make for a finding of a mission. Pure; null if a person has to decide. */

import type { Finding, Fix } from '../fixes';
import { addStep, nodeOf, remove, setStep } from './edit';
import { nodesOf, roleNames, stepId, type Mission, type MissionPosition, type Step, type StepNode } from './mission';
import { inFrame, geoPointOf, frameOfPosition, type Frame } from './positions';
import { newStep } from './step-titles';

const HIGHEST_M = 120;
const LOWEST_M = 2;

export function fixOf(mission: Mission, finding: Finding, frame: Frame): Fix<Mission> | null {
  const node = finding.place.step === null ? null : nodeOf(mission, stepId(finding.place.step));
  switch (finding.code) {
    case 'takeoff_missing':
      return roleNames(mission).length > 0 ? null : { text: 'Take off at the beginning', plan: { ...mission, steps: [newStep('take_off'), ...mission.steps] } };
    case 'takeoff_in_air':
      return node === null ? null : { text: `Delete ${node.place}`, plan: remove(mission, [stepId(node.place)]) };
    case 'landing_missing':
      return roleNames(mission).length > 0 ? null : { text: 'Land at the end', plan: addStep(mission, 'land', null, [], frame).mission };
    case 'speed_too_high':
      return node === null ? null : { text: 'Fly at the vehicle’s speed', plan: setStep(mission, node, without(node.step, 'speed_m_s')) };
    case 'altitude_too_high':
      return node === null ? null : heights(mission, node, frame, `Lower to ${HIGHEST_M} m`, (up_m) => Math.min(up_m, HIGHEST_M));
    case 'altitude_below_home':
      return node === null ? null : heights(mission, node, frame, `Raise to ${LOWEST_M} m`, (up_m) => Math.max(up_m, LOWEST_M));
    case 'estimate_missing':
    case 'fence_unknown':
      return frame.known && mission.home == null ? { text: 'Use the vehicle’s home', plan: { ...mission, home: frame.start } } : null;
    case 'duration_too_short':
      return node === null
        ? null
        : { text: 'Double the time', plan: setStep(mission, node, { ...node.step, duration_s: 2 * Number(node.step['duration_s']) }) };
    case 'gimbal_steep':
      return node === null
        ? null
        : { text: 'Point straight down at most', plan: setStep(mission, node, { ...node.step, pitch_rad: -Math.PI / 2, sweep_pitch_rad: 0 }) };
    default:
      return null;
  }
}

function without(step: Step, field: string): Step {
  return Object.fromEntries(Object.entries(step).filter(([name]) => name !== field)) as unknown as Step;
}

function heights(mission: Mission, node: StepNode, frame: Frame, text: string, to: (up_m: number) => number): Fix<Mission> | null {
  const moved = (at: MissionPosition): MissionPosition => {
    const geoPoint = geoPointOf(at, frame);
    return to(geoPoint.up_m) === geoPoint.up_m ? at : inFrame(frameOfPosition(at), { ...geoPoint, up_m: to(geoPoint.up_m) }, frame, at);
  };
  if (node.step.points === undefined) return null;
  return { text, plan: setStep(mission, node, { ...node.step, points: node.step.points.map(moved) }) };
}

/** Ids of the parts that a finding concerns. */
export function idsOf(mission: Mission, finding: Finding): string[] {
  const place = finding.place.step;
  return place !== null && nodesOf(mission).some((node) => node.place === place) ? [stepId(place)] : [];
}
