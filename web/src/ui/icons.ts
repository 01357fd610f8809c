/** Line icons on a 24 grid, drawn for this page. */

export const ICONS = {
  up: 'M12 19V7M7 12l5-5 5 5M5 21h14',
  down: 'M12 3v12M7 10l5 5 5-5M5 20h14',
  home: 'M4 12l8-7 8 7M7 10v9h10v-9',
  play: 'M8 5l11 7-11 7z',
  flights: 'M4 18V6M4 18h16M7 14l4-5 3 3 5-6',
  save: 'M12 4v11M7 11l5 5 5-5M5 20h14',
  markBack: 'M17 6l-8 6 8 6zM7 6v12',
  markOn: 'M7 6l8 6-8 6zM17 6v12',
  pause: 'M9 6v12M15 6v12',
  stop: 'M8.5 3.5h7l5 5v7l-5 5h-7l-5-5v-7zM9 12h6',
  power: 'M12 4v8M7.5 7a7 7 0 109 0',
  sun: 'M12 8a4 4 0 100 8 4 4 0 000-8zM12 2.5V4M12 20v1.5M2.5 12H4M20 12h1.5M5.3 5.3l1 1M17.7 17.7l1 1M5.3 18.7l1-1M17.7 6.3l1-1',
  moon: 'M19.5 14.5A8 8 0 019.5 4.5a8 8 0 1010 10z',
  camera: 'M4 8h3l2-2h6l2 2h3v11H4zM12 10a3 3 0 100 6 3 3 0 000-6z',
  keys: 'M3 7h18v11H3zM7 11h.01M11 11h.01M15 11h.01M8 15h8',
  swap: 'M7 4v13M4 14l3 3 3-3M17 20V7M14 10l3-3 3 3',
  close: 'M6 6l12 12M18 6L6 18',
  left: 'M15 5l-7 7 7 7',
  right: 'M9 5l7 7-7 7',
  chevronUp: 'M5 15l7-7 7 7',
  chevronDown: 'M5 9l7 7 7-7',
  plus: 'M12 6v12M6 12h12',
  minus: 'M6 12h12',
  alert: 'M12 4l9 16H3zM12 10v4M12 17h.01',
  edit: 'M4 20h4L19 9l-4-4L4 16zM13 7l4 4',
  grip: 'M9 6h.01M9 12h.01M9 18h.01M15 6h.01M15 12h.01M15 18h.01',
  bell: 'M6 16V11a6 6 0 0112 0v5l2 2H4zM10 21h4',
  target: 'M12 5v14M5 12h14M12 8a4 4 0 100 8 4 4 0 000-8z',
} as const;

export type IconName = keyof typeof ICONS;
