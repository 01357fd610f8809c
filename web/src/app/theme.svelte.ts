/** Light or dark theme: the system's theme until a person chooses a theme; the browser stores the choice. */

export type ThemeChoice = 'system' | 'light' | 'dark';

const STORAGE_KEY = 'gcs-theme';
const CHOICES: readonly ThemeChoice[] = ['system', 'light', 'dark'];

function storedChoice(): ThemeChoice {
  try {
    const value = localStorage.getItem(STORAGE_KEY);
    return CHOICES.find((c) => c === value) ?? 'system';
  } catch {
    return 'system'; // storage is disabled
  }
}

class Theme {
  choice = $state<ThemeChoice>(storedChoice());
  private systemDark = $state(matchMedia('(prefers-color-scheme: dark)').matches);
  readonly shown: 'light' | 'dark' = $derived(this.choice === 'system' ? (this.systemDark ? 'dark' : 'light') : this.choice);

  constructor() {
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', (event) => {
      this.systemDark = event.matches;
      this.apply();
    });
    this.apply();
  }

  /** Switches between light and dark. If the new theme is the system's theme, the page follows the system again. */
  toggle(): void {
    const newTheme = this.shown === 'dark' ? 'light' : 'dark';
    this.choice = newTheme === (this.systemDark ? 'dark' : 'light') ? 'system' : newTheme;
    try {
      localStorage.setItem(STORAGE_KEY, this.choice);
    } catch {
      // storage is disabled: the choice applies until the page closes
    }
    this.apply();
  }

  private apply(): void {
    document.documentElement.dataset['theme'] = this.shown;
  }
}

export const theme = new Theme();
