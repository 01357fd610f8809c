/**
 * Fixes that the page can make for a finding of a mission: a changed mission, or null if a person has to decide. Pure functions.
 */

import { shortText } from '../../../ui/format';
import { removeObstacle } from '../document/edit';
import { type Finding, type Fix } from '../document/fixes';
import { addStep, nodeOf, remove, setStep } from './edit';
import { nodesOf, roleNames, stepId, type Mission, type MissionPosition, type StepNode } from './mission';
import { positionInFrame, geoPointOf, positionFrameOf, type MissionFrame } from './positions';
import { newStep } from './step-titles';

/** Points are raised to at least this altitude above the start [m]. */
const MIN_UP_M = 2;
/** Points are lowered to this distance below a limit [m], because a curve may pass slightly above its points. */
const MARGIN_M = 0.5;

export function fixOf(mission: Mission, finding: Finding, frame: MissionFrame): Fix<Mission> | null {
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
      return node === null ? null : setSpeed(mission, node, finding.limit);
    case 'altitude_too_high':
    case 'altitude_fence':
    case 'limit_exceeded':
      return node === null || finding.limit === null ? null : limitAltitude(mission, node, frame, finding.limit - MARGIN_M);
    case 'tilt_exceeded':
      return node === null || finding.limit === null ? null : limitTilt(mission, node, finding.limit);
    case 'altitude_below_home':
      return node === null
        ? null
        : changeAltitudes(mission, node, frame, `Set the altitude above home to at least ${shortText('height', MIN_UP_M)}`, (up_m) => Math.max(up_m, MIN_UP_M));
    case 'estimate_missing':
    case 'fence_unknown':
    case 'obstacles_unknown':
      return frame.isStartKnown && mission.home == null ? { text: 'Use the vehicle’s home', plan: { ...mission, home: frame.start } } : null;
    case 'obstacle_invalid':
      return finding.place.obstacle === null ? null : { text: 'Delete this obstacle', plan: removeObstacle(mission, finding.place.obstacle) };
    case 'duration_too_short': {
      if (node === null || finding.limit === null) return null;
      const duration_s = Math.ceil(finding.limit * 10) / 10;
      return { text: `Set the duration to ${duration_s} s`, plan: setStep(mission, node, { ...node.step, duration_s }) };
    }
    case 'gimbal_steep':
      return node === null ? null : limitGimbal(mission, node);
    default:
      return null;
  }
}

/** Sets the maximum speed of the step to the limit; if only the mission has a maximum speed, sets that of the mission. */
function setSpeed(mission: Mission, node: StepNode, limit: number | null): Fix<Mission> | null {
  if (limit === null) return null;
  const text = `Set the speed to ${shortText('speed', limit)}`;
  if (typeof node.step['speed_m_s'] === 'number' || mission.limits?.speed_m_s == null)
    return { text, plan: setStep(mission, node, { ...node.step, speed_m_s: limit }) };
  return { text, plan: { ...mission, limits: { ...mission.limits, speed_m_s: limit } } };
}

/** Lowers the points of a step, or the height of a take-off, to an altitude above home. */
function limitAltitude(mission: Mission, node: StepNode, frame: MissionFrame, max_m: number): Fix<Mission> | null {
  if (node.step.step === 'take_off') {
    const text = `Limit the height above the start to ${shortText('height', max_m)}`;
    return { text, plan: setStep(mission, node, { ...node.step, height_m: max_m }) };
  }
  const text = `Limit the altitude above home to ${shortText('height', max_m)}`;
  return changeAltitudes(mission, node, frame, text, (up_m) => Math.min(up_m, max_m));
}

/** Scales roll and pitch, so that the vehicle tilts by at most `limit_rad`. */
function limitTilt(mission: Mission, node: StepNode, limit_rad: number): Fix<Mission> {
  const [roll_rad, pitch_rad] = [Number(node.step['roll_rad'] ?? 0), Number(node.step['pitch_rad'] ?? 0)];
  let scale = 1;
  while (Math.acos(Math.cos(scale * roll_rad) * Math.cos(scale * pitch_rad)) > limit_rad) scale -= 0.01;
  const step = { ...node.step, roll_rad: scale * roll_rad, pitch_rad: scale * pitch_rad };
  return { text: `Limit the tilt to ${Math.floor((limit_rad * 180) / Math.PI)}°`, plan: setStep(mission, node, step) };
}

/** Limits the pitch of the gimbal, also during a sweep, to ±90°. */
function limitGimbal(mission: Mission, node: StepNode): Fix<Mission> {
  const max_rad = Math.PI / 2;
  const pitch_rad = Math.max(-max_rad, Math.min(max_rad, Number(node.step['pitch_rad'] ?? 0)));
  const sweep_pitch_rad = Math.min(Number(node.step['sweep_pitch_rad'] ?? 0), max_rad - Math.abs(pitch_rad));
  return { text: 'Limit the gimbal pitch to ±90°', plan: setStep(mission, node, { ...node.step, pitch_rad, sweep_pitch_rad }) };
}

/** Sets the altitude above the start of each point of a step to `newUp_m(up_m)`; null for a step without points. */
function changeAltitudes(mission: Mission, node: StepNode, frame: MissionFrame, text: string, newUp_m: (up_m: number) => number): Fix<Mission> | null {
  const withNewAltitude = (point: MissionPosition): MissionPosition => {
    const geoPoint = geoPointOf(point, frame);
    const up_m = newUp_m(geoPoint.up_m);
    return up_m === geoPoint.up_m ? point : positionInFrame(positionFrameOf(point), { ...geoPoint, up_m }, frame, point);
  };
  if (node.step.points === undefined) return null;
  return { text, plan: setStep(mission, node, { ...node.step, points: node.step.points.map(withNewAltitude) }) };
}

/** Ids of the parts that a finding concerns. */
export function idsOf(mission: Mission, finding: Finding): string[] {
  const place = finding.place.step;
  return place !== null && nodesOf(mission).some((node) => node.place === place) ? [stepId(place)] : [];
}
