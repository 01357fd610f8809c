import { describe, expect, it } from 'vitest';
import { isOffered, type Panel } from '../app/registry.svelte';
import type { VehicleFacts } from './facts';
import { linkSupports, protocolLines, type Protocols } from './facts';

const BOTH_PROTOCOLS: Protocols = { protocols: ['MAVLink', 'ROS 2'], telemetry: 'MAVLink', commands: 'MAVLink', setpoints: 'ROS 2', missing: [] };
const ONLY_ROS_2: Protocols = { protocols: ['ROS 2'], telemetry: 'ROS 2', commands: 'ROS 2', setpoints: 'ROS 2', missing: ['parameters', 'files'] };
const facts = (protocols: Protocols | null): VehicleFacts => ({ protocols }) as VehicleFacts;

describe('the protocols of a vehicle', () => {
  it('determine which features are available: some need MAVLink', () => {
    expect(linkSupports(facts(ONLY_ROS_2), 'parameters')).toBe(false);
    expect(linkSupports(facts(ONLY_ROS_2), 'gimbal')).toBe(true);
    expect(linkSupports(facts(BOTH_PROTOCOLS), 'parameters')).toBe(true);
    expect(linkSupports(facts(null), 'parameters')).toBe(true);
  });
  it('are listed separately for telemetry, commands and setpoints if they differ', () => {
    expect(protocolLines(null)).toEqual([]);
    expect(protocolLines(BOTH_PROTOCOLS)).toEqual([
      ['Protocol', 'MAVLink and ROS 2'],
      ['Telemetry', 'MAVLink'],
      ['Commands', 'MAVLink'],
      ['Setpoints', 'ROS 2'],
    ]);
    expect(protocolLines(ONLY_ROS_2)).toEqual([
      ['Protocol', 'ROS 2'],
      ['Not available without MAVLink', 'parameters, files'],
    ]);
  });
  it('determine which panels are offered', () => {
    const panel = { needs: 'parameters' } as Panel;
    expect(isOffered(panel, facts(ONLY_ROS_2))).toBe(false);
    expect(isOffered(panel, facts(BOTH_PROTOCOLS))).toBe(true);
    expect(isOffered(panel, null)).toBe(true);
    expect(isOffered({} as Panel, facts(ONLY_ROS_2))).toBe(true);
  });
});
