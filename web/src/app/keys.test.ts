import { describe, expect, it } from 'vitest';
import { KeyGuard } from './key-targets';
import { characterOf, isControl, isShortcut, mayRepeat, takesText, hasTypeAhead, type KeyTarget } from './key-targets';

const input = (type?: string, more: object = {}): KeyTarget => ({ tagName: 'INPUT', tabIndex: 0, ...(type === undefined ? {} : { type }), ...more });
const elementWithRole = (role: string): KeyTarget => ({ tagName: 'DIV', tabIndex: 0, getAttribute: (name) => (name === 'role' ? role : null) });

const button = (attributes: Readonly<Record<string, string>>): KeyTarget => ({
  tagName: 'BUTTON',
  tabIndex: 0,
  getAttribute: (name) => attributes[name] ?? null,
});
const menuButton = (expanded: string): KeyTarget => button({ 'aria-haspopup': 'menu', 'aria-expanded': expanded });
const listButton = (expanded: string): KeyTarget => button({ role: 'combobox', 'aria-haspopup': 'listbox', 'aria-expanded': expanded });

describe('a pressed character', () => {
  it.each(['text', 'search', 'url', 'tel', 'email', 'password', 'number', 'date', 'datetime-local', 'month', 'week', 'time', 'not-a-type-yet'])(
    'is text in an input of type %s',
    (type) => {
      expect(takesText(input(type))).toBe(true);
      expect(isShortcut('h', input(type))).toBe(false);
      expect(isShortcut('K', input(type))).toBe(false);
    },
  );
  it.each(['checkbox', 'radio', 'range', 'button', 'submit', 'reset', 'image', 'file', 'color', 'hidden', 'CHECKBOX'])(
    'is a shortcut on an input of type %s, for example H for Hold',
    (type) => {
      expect(takesText(input(type))).toBe(false);
      expect(isShortcut('h', input(type))).toBe(true);
    },
  );
  it('is text in an input without a type, a text area and an editable element', () => {
    for (const target of [
      input(),
      { tagName: 'TEXTAREA' },
      { tagName: 'DIV', isContentEditable: true },
      { tagName: 'textarea' },
      elementWithRole('textbox'),
      elementWithRole('combobox'),
    ]) {
      expect(takesText(target)).toBe(true);
    }
  });
  it('is a shortcut on elements without text input', () => {
    for (const target of [
      null,
      { tagName: 'BODY' },
      { tagName: 'BUTTON', tabIndex: 0 },
      elementWithRole('slider'),
      menuButton('false'),
      listButton('false'),
      input('text', { readOnly: true }),
    ]) {
      expect(isShortcut('h', target)).toBe(true);
      expect(isShortcut('t', target)).toBe(true);
    }
  });
  it.each<[string, KeyTarget]>([
    ['list', { tagName: 'SELECT', tabIndex: 0 }],
    ['menu', elementWithRole('menu')],
    ['menu item', elementWithRole('menuitem')],
    ['button whose menu is opening', menuButton('true')],
    ['button whose list is open', listButton('true')],
  ])('selects an entry in a %s, but the keys of Hold, Land now and Stop motors remain shortcuts', (_, target) => {
    expect(hasTypeAhead(target)).toBe(true);
    for (const key of ['h', 'H', 'L', 'K']) expect(isShortcut(key, target)).toBe(true);
    for (const key of ['t', 'l', 'r', '1', 'A', 'g']) expect(isShortcut(key, target)).toBe(false);
  });
  it('is a shortcut by the physical key on a non-Latin keyboard', () => {
    expect(characterOf({ key: 'h', code: 'KeyH' })).toBe('h');
    expect(characterOf({ key: 'р', code: 'KeyH' })).toBe('h');
    expect(characterOf({ key: 'Л', code: 'KeyK' })).toBe('K');
    expect(characterOf({ key: 'r', code: 'KeyP' })).toBe('r'); // another Latin layout: the character of the key counts, not its position
    expect(characterOf({ key: 'Escape', code: 'Escape' })).toBe('Escape');
  });
  it('is handled by a focused control if it is Space or an arrow, but not by a focused panel', () => {
    expect(isControl({ tagName: 'BUTTON', tabIndex: 0 })).toBe(true);
    expect(isControl(elementWithRole('application'))).toBe(true);
    for (const target of [null, { tagName: 'BODY', tabIndex: -1 }, { tagName: 'SECTION', tabIndex: -1 }]) expect(isControl(target)).toBe(false);
  });
});

describe('a key pressed on one control', () => {
  it('acts on this control while it is held', () => {
    const guard = new KeyGuard<string>();
    expect(guard.blocksKeyDown({ key: ' ', target: 'slider' })).toBe(false);
    expect(guard.blocksKeyDown({ key: ' ', target: 'slider', repeat: true })).toBe(false);
    expect(guard.blocksKeyUp({ key: ' ', target: 'slider' })).toBe(false);
  });
  it.each([' ', 'Enter'])('acts on no other control while it is held (%j)', (key) => {
    const guard = new KeyGuard<string>();
    guard.blocksKeyDown({ key, target: 'slider' });
    expect(guard.blocksKeyDown({ key, target: 'Stop motors', repeat: true })).toBe(true);
    expect(guard.blocksKeyUp({ key, target: 'Stop motors' })).toBe(true);
    expect(guard.blocksKeyDown({ key, target: 'Stop motors' })).toBe(false); // a new press acts
  });
  it('acts on nothing in this window if it was pressed in another window', () => {
    const guard = new KeyGuard<string>();
    expect(guard.blocksKeyDown({ key: 'Enter', target: 'slider', repeat: true })).toBe(true);
    guard.blocksKeyDown({ key: ' ', target: 'slider' });
    guard.clear();
    expect(guard.blocksKeyUp({ key: ' ', target: 'slider' })).toBe(true);
  });
  it('acts on nothing just after a confirmation closed without a key press', () => {
    let confirmationJustClosed = true;
    const guard = new KeyGuard<string>(() => confirmationJustClosed);
    expect(guard.blocksKeyDown({ key: ' ', target: 'Up 1 m more' })).toBe(true);
    confirmationJustClosed = false;
    expect(guard.blocksKeyDown({ key: ' ', target: 'Up 1 m more', repeat: true })).toBe(true);
    expect(guard.blocksKeyUp({ key: ' ', target: 'Up 1 m more' })).toBe(true);
    expect(guard.blocksKeyDown({ key: ' ', target: 'Up 1 m more' })).toBe(false);
  });
  it('presses the control once, however long it is held', () => {
    const [button, field, text] = ['BUTTON', 'INPUT', 'TEXTAREA'].map((tagName) => ({ tagName, type: 'text' }));
    expect([' ', 'Enter'].map((key) => mayRepeat(key, button ?? null))).toEqual([false, false]);
    expect([' ', 'Enter'].map((key) => mayRepeat(key, field ?? null))).toEqual([true, false]); // Enter submits the form
    expect([mayRepeat('Enter', text ?? null), mayRepeat('ArrowUp', button ?? null), mayRepeat('a', null)]).toEqual([true, true, true]);
  });
  it('does not affect other keys', () => {
    const guard = new KeyGuard<string>();
    expect(guard.blocksKeyDown({ key: 'h', target: 'a', repeat: true })).toBe(false);
    expect(guard.blocksKeyUp({ key: 'h', target: 'b' })).toBe(false);
  });
});
