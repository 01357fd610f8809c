/** Fixes that the page can make for a finding of a mission. Pure; null if a person has to decide. */

import { removeObstacle } from '../document/edit';
import { numberText, type Finding, type Fix } from '../document/fixes';
import { addStep, nodeOf, remove, setStep } from './edit';
import { nodesOf, roleNames, stepId, type Mission, type MissionPosition, type StepNode } from './mission';
import { inFrame, geoPointOf, frameOfPosition, type Frame } from './positions';
import { newStep } from './step-titles';

const LOWEST_M = 2;
/** A curve is lowered to this distance below a limit, because it may pass a little above its points [m]. */
const BELOW_M = 0.5;

export function fixOf(mission: Mission, finding: Finding, frame: Frame): Fix<Mission> | null {
  const node = finding.place.step === null ? null : nodeOf(mission, stepId(finding.place.step));
  switch (finding.code) {
    case 'takeoff_missing':
      return roleNames(mission).length > 0
        ? null
        : { text: 'Add a take-off at the beginning', plan: { ...mission, steps: [newStep('take_off'), ...mission.steps] } };
    case 'takeoff_in_air':
      return node === null ? null : { text: `Delete ${node.place}`, plan: remove(mission, [stepId(node.place)]) };
    case 'landing_missing':
      return roleNames(mission).length > 0 ? null : { text: 'Add a landing at the end', plan: addStep(mission, 'land', null, [], frame).mission };
    case 'speed_too_high':
      return node === null ? null : speed(mission, node, finding.limit);
    case 'altitude_too_high':
    case 'altitude_fence':
    case 'limit_exceeded':
      return node === null || finding.limit === null ? null : lower(mission, node, frame, finding.limit - BELOW_M);
    case 'tilt_exceeded':
      return node === null || finding.limit === null ? null : tilt(mission, node, finding.limit);
    case 'altitude_below_home':
      return node === null ? null : heights(mission, node, frame, `Set the height to at least ${LOWEST_M} m`, (up_m) => Math.max(up_m, LOWEST_M));
    case 'estimate_missing':
    case 'fence_unknown':
    case 'obstacles_unknown':
      return frame.known && mission.home == null ? { text: 'Use the vehicle’s home', plan: { ...mission, home: frame.start } } : null;
    case 'obstacle_invalid':
      return finding.place.obstacle === null ? null : { text: 'Delete this obstacle', plan: removeObstacle(mission, finding.place.obstacle) };
    case 'duration_too_short': {
      if (node === null || finding.limit === null) return null;
      const duration_s = Math.ceil(finding.limit * 10) / 10;
      return { text: `Set the duration to ${duration_s} s`, plan: setStep(mission, node, { ...node.step, duration_s }) };
    }
    case 'gimbal_steep':
      return node === null ? null : gimbal(mission, node);
    default:
      return null;
  }
}

/** Sets the speed that was too high: the step's, else the mission's. */
function speed(mission: Mission, node: StepNode, limit: number | null): Fix<Mission> | null {
  if (limit === null) return null;
  const text = `Set the speed to ${numberText(limit)} m/s`;
  if (typeof node.step['speed_m_s'] === 'number' || mission.limits?.speed_m_s == null)
    return { text, plan: setStep(mission, node, { ...node.step, speed_m_s: limit }) };
  return { text, plan: { ...mission, limits: { ...mission.limits, speed_m_s: limit } } };
}

/** Lowers the points of a step, or its take-off, to a height above home. */
function lower(mission: Mission, node: StepNode, frame: Frame, highest_m: number): Fix<Mission> | null {
  const text = `Limit the height to ${numberText(highest_m)} m`;
  if (node.step.step === 'take_off') return { text, plan: setStep(mission, node, { ...node.step, height_m: highest_m }) };
  return heights(mission, node, frame, text, (up_m) => Math.min(up_m, highest_m));
}

/** Scales roll and pitch, so that the vehicle tilts by at most `limit_rad`. */
function tilt(mission: Mission, node: StepNode, limit_rad: number): Fix<Mission> {
  const [roll_rad, pitch_rad] = [Number(node.step['roll_rad'] ?? 0), Number(node.step['pitch_rad'] ?? 0)];
  let scale = 1;
  while (Math.acos(Math.cos(scale * roll_rad) * Math.cos(scale * pitch_rad)) > limit_rad) scale -= 0.01;
  const step = { ...node.step, roll_rad: scale * roll_rad, pitch_rad: scale * pitch_rad };
  return { text: `Limit the tilt to ${Math.floor((limit_rad * 180) / Math.PI)}°`, plan: setStep(mission, node, step) };
}

/** Keeps the gimbal between straight up and straight down, also while it sweeps. */
function gimbal(mission: Mission, node: StepNode): Fix<Mission> {
  const steepest_rad = Math.PI / 2;
  const pitch_rad = Math.max(-steepest_rad, Math.min(steepest_rad, Number(node.step['pitch_rad'] ?? 0)));
  const sweep_pitch_rad = Math.min(Number(node.step['sweep_pitch_rad'] ?? 0), steepest_rad - Math.abs(pitch_rad));
  return { text: 'Limit the gimbal pitch to ±90°', plan: setStep(mission, node, { ...node.step, pitch_rad, sweep_pitch_rad }) };
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
