import { unitText } from '../../../ui/units';
import { describe, expect, it } from 'vitest';
import schema from '../../../api/schema.d.ts?raw';
import type { Item, ItemKind } from './document';
import { fieldsOf, toDocumentValue } from './fields';
import { ITEM_FIELDS, specsOf } from './item-fields';
import { KIND_GROUPS, detailOf, needsPosition, newItem, titleOf } from './items';

const POSITION = { lat_deg: 47.4, lon_deg: 8.5 };
const ALTITUDE = { value_m: 30, reference: 'home' } as const;
const SHARED_FIELDS = ['kind', 'autocontinue', 'spare_params', 'original', 'lat_deg', 'lon_deg', 'altitude'];
/** PX4 refuses to upload a mission that contains one of these. */
const REFUSED_KINDS = ['set_servo', 'camera_zoom'];

/** The mission items of the API: kind and fields of each schema that has `spare_params`. */
const API_ITEMS = new Map(
  schema.split(/\n {8}(?=readonly \w+: \{\n)/).flatMap((schemaPart): [string, string[]][] => {
    const fields = [...schemaPart.matchAll(/^ {12}readonly (\w+)\??: /gm)].map((match) => match[1] ?? '');
    const kind = /^ {12}readonly kind: "(\w+)";/m.exec(schemaPart)?.[1];
    return kind === undefined || !fields.includes('spare_params') ? [] : [[kind, fields]];
  }),
);
const KINDS = [...API_ITEMS.keys()] as ItemKind[];
const MENU_KINDS = KIND_GROUPS.flatMap(({ kinds }) => kinds);
const itemOf = (kind: ItemKind): Item => newItem(kind, needsPosition(kind) ? POSITION : null, ALTITUDE);

describe('the kinds of mission items', () => {
  it('are those of the API, each with its fields in the editor', () => {
    expect(KINDS.length).toBeGreaterThanOrEqual(38);
    expect(Object.keys(ITEM_FIELDS).sort()).toEqual([...KINDS].sort());
    for (const [kind, fields] of API_ITEMS) {
      const ownFields = fields.filter((field) => !SHARED_FIELDS.includes(field));
      expect([kind, ...specsOf(kind as ItemKind).map(([name]) => name)].sort()).toEqual([kind, ...ownFields].sort());
    }
  });
  it('have different titles', () => {
    const titles = KINDS.map((kind) => titleOf({ kind }));
    for (const title of titles) expect(title).toMatch(/^[A-Z][^_]+$/);
    expect(new Set(titles).size).toBe(titles.length);
  });
  it('are in the menu once, except those that PX4 refuses', () => {
    expect([...MENU_KINDS].sort()).toEqual(KINDS.filter((kind) => !REFUSED_KINDS.includes(kind)).sort());
  });
  it('need a position exactly if the API requires one', () => {
    expect(KINDS.filter(needsPosition).sort()).toEqual(KINDS.filter((kind) => API_ITEMS.get(kind)?.includes('lat_deg')).sort());
  });
  it('are added with all their fields', () => {
    for (const kind of MENU_KINDS) expect(Object.keys(itemOf(kind)).sort()).toEqual([...(API_ITEMS.get(kind) ?? [])].sort());
    expect(itemOf('land').altitude?.value_m).toBe(0);
    expect(itemOf('loiter_to_altitude').altitude?.value_m).toBe(30);
  });
  it('have a label for each shown field, and a text for each code number of a new item', () => {
    for (const kind of KINDS) {
      const rows = fieldsOf(itemOf(kind));
      for (const row of rows) {
        expect(row.label).toMatch(/^[A-Z][^_]+$/);
        if (row.type === 'choice') expect(row.options?.find(({ value }) => value === row.value)?.text).toMatch(/^(?!other|not set)/);
      }
      expect(new Set(rows.map(({ label }) => label)).size).toBe(rows.length);
    }
  });
});

describe('the fields of an item', () => {
  const labels = (item: Item) =>
    fieldsOf(item).map(({ label, unit, placeholder }) => `${label} [${unitText(unit ?? '')}]${placeholder === undefined ? '' : '?'}`);
  const field = (item: Item, name: string) => fieldsOf(item).find((row) => row.name === name);

  it('have units, and may be empty if the autopilot has a default', () => {
    expect(labels(itemOf('waypoint'))).toEqual([
      'Hold for [s]',
      'Acceptance radius [m]',
      'Pass radius (negative: counter-clockwise) [m]',
      'Yaw from north [°]?',
    ]);
    expect(field(itemOf('gimbal_pitch_yaw'), 'pitch_rate_deg_s')).toMatchObject({ unit: '°/s', value: null, placeholder: 'default' });
  });
  it('offer texts instead of code numbers', () => {
    const climb: Item = { ...itemOf('change_speed'), speed_type: 2 };
    expect(field(climb, 'speed_type')).toMatchObject({ type: 'choice', value: '2' });
    expect(detailOf(climb)).toBe('climb speed · 5.0 m/s');
    expect(detailOf({ ...climb, speed_m_s: -2 })).toBe('climb speed · default');
    expect(detailOf(itemOf('trigger_interval'))).toBe('every 1.0 s');
    expect(toDocumentValue(climb, 'speed_type', '3')).toBe(3);
  });
  it('keep a code number for which the editor has no text', () => {
    const row = field({ ...itemOf('roi'), mode: 1 }, 'mode');
    expect(row?.value).toBe('1');
    expect(row?.options?.at(-1)).toEqual({ value: '1', text: 'other (1)' });
    const emptyField = field({ ...itemOf('gripper'), action: null }, 'action');
    expect(emptyField?.options?.at(-1)).toEqual({ value: 'null', text: 'not set' });
    expect(toDocumentValue(itemOf('gripper'), 'action', 'null')).toBeNull();
  });
  it('appear only if they apply', () => {
    expect(labels({ ...itemOf('winch'), action: 1 })).toEqual([
      'Winch []',
      'Action []',
      'Line to release (negative: wind in) [m]',
      'Release rate (negative: wind in) [m/s]',
    ]);
    expect(labels({ ...itemOf('winch'), action: 4 })).toEqual(['Winch []', 'Action []']);
    expect(labels(itemOf('delay'))).toEqual(['Wait for (−1: until a UTC time) [s]']);
    expect(labels({ ...itemOf('delay'), delay_s: -1 })).toHaveLength(4);
    expect(labels(itemOf('set_home'))).toEqual([]);
    expect(labels({ ...itemOf('set_home'), use_current: 0 })).toEqual(['New home []']);
  });
  it('have a unit that depends on the chosen type', () => {
    expect(field({ ...itemOf('camera_focus'), focus_type: 3 }, 'value')?.unit).toBe('length');
    expect(field({ ...itemOf('camera_focus'), focus_type: 4 }, 'value')).toBeUndefined();
    expect(field({ ...itemOf('camera_zoom'), zoom_type: 2 }, 'value')?.unit).toBe('%');
  });
  it('count items from 1 on the page', () => {
    const jump: Item = { ...itemOf('jump'), target_index: 2 };
    expect(field(jump, 'target_index')?.value).toBe(3);
    expect(toDocumentValue(jump, 'target_index', 3)).toBe(2);
    expect(toDocumentValue(jump, 'repeat', 1.6)).toBe(2);
  });
  it('are not shown for an unknown command', () => {
    expect(fieldsOf({ kind: 'command', command: 17, frame: 2 })).toEqual([]);
    expect(titleOf({ kind: 'command', command: 17 })).toBe('MAV_CMD 17');
  });
});
