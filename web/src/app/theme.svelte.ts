/** Light or dark theme: the system's theme until a person chooses a theme, which is a setting of the user. */

import { userSettings } from './settings.svelte';

export type ThemeChoice = 'system' | 'light' | 'dark';

class Theme {
  readonly choice: ThemeChoice = $derived(userSettings.get('theme') ?? 'system');
  private systemDark = $state(matchMedia('(prefers-color-scheme: dark)').matches);
  readonly shown: 'light' | 'dark' = $derived(this.choice === 'system' ? (this.systemDark ? 'dark' : 'light') : this.choice);

  constructor() {
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', (event) => (this.systemDark = event.matches));
  }

  /** Switches between light and dark. If the new theme is the system's theme, the page follows the system again. */
  toggle(): void {
    const newTheme = this.shown === 'dark' ? 'light' : 'dark';
    userSettings.set('theme', newTheme === (this.systemDark ? 'dark' : 'light') ? null : newTheme);
  }

  /** Shows the theme. Before the first paint `public/before-paint.js` has shown it. */
  apply(): void {
    document.documentElement.dataset['theme'] = this.shown;
  }

  /** The shown theme's CSS variables by name, for what draws itself: also when it draws before the page's frame has followed a change. */
  variables(): (name: string) => string {
    this.apply();
    const style = getComputedStyle(document.documentElement);
    return (name) => style.getPropertyValue(name).trim();
  }
}

export const theme = new Theme();
