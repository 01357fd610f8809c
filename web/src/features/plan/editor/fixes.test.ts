import casesText from '../../../../../tests/data/plan_fixes/cases.json?raw';
import { expect, it } from 'vitest';
import type { Plan } from '../document/document';
import { fixOf, type Finding } from '../document/fixes';
import { fixOf as fixOfMission } from '../offboard/fixes';
import type { Mission } from '../offboard/mission';
import { missionFrameOf } from '../offboard/positions';

/** The plans after their fixes. `tests/unit/gcs_server/plans/test_fixes.py` makes the plans before the fixes and checks these plans. */
const FIXED_PLANS = '../../../../../tests/data/plan_fixes/fixed.json';
interface Case {
  readonly document: Plan | Mission;
  readonly finding: Finding;
}
const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const cases = JSON.parse(casesText) as Record<string, Case>;

it('each fix makes the plan in the file that the server’s test checks', async () => {
  const fixed: string[] = [];
  for (const [name, { document, finding }] of Object.entries(cases)) {
    const fix = 'steps' in document ? fixOfMission(document, finding, missionFrameOf(document, HOME, null)) : fixOf(document, finding, HOME);
    expect(fix, name).not.toBeNull();
    expect(fix?.plan, name).not.toEqual(document);
    fixed.push(`${JSON.stringify(name)}: ${JSON.stringify(fix?.plan)}`);
  }
  await expect(`{\n${fixed.join(',\n')}\n}\n`).toMatchFileSnapshot(FIXED_PLANS);
});
